"""Other libraries: models of Pinocchio, states of MuJoCo and Drake, names of calls."""

"""Other libraries: models of Pinocchio, and states as MuJoCo and Drake write them."""

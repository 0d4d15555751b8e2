"""Control: paths to follow, control laws and their gains, inverse kinematics, observers, monitors of stability."""

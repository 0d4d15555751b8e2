"""Laws, observers and paths of control, and inverse kinematics."""

"""What acts at the joints beside the torque of the caller: friction, and the limits of motors."""

"""Torques at the joints beside that of the caller: friction, springs, and the limits of motors."""

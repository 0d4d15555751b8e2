"""What acts in joints: friction, motors, springs."""

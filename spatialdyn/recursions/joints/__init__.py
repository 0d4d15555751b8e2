"""Torques in joints: friction, motors, springs."""

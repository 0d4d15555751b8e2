"""Configurations as elements of a Lie group: integrate, difference, and their derivatives."""

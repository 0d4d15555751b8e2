"""Recursions over the tree: inverse and forward dynamics, the mass matrix and its factors, kinematics."""

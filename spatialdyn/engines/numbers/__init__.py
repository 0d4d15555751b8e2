"""Recursions on other numbers: exact, symbolic, double-double, stochastically rounded."""

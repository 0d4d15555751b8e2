"""Lagrange and Hamilton: what people build on M, C and g."""

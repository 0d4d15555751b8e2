"""What Lagrange and Hamilton make of M, C and g."""

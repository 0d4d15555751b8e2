"""Lagrangian and Hamiltonian mechanics on M, C and g: Coriolis matrices, conserved quantities, closed forms."""

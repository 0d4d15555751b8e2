"""What follows from the Lagrangian T(q, v) - V(q): the constructions of C, and what tells them apart."""

from __future__ import annotations

from .christoffel import ChristoffelC, SkewSymmetry, structure_constants, verify_skew_symmetry

__all__ = ["ChristoffelC", "SkewSymmetry", "structure_constants", "verify_skew_symmetry"]

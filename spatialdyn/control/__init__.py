"""Control: paths to follow, control laws by name and their gains, inverse kinematics, observers, monitors of stability.

This package imports ``simulation``: it makes runs and examines them. The package ``laws``, which ``simulation``
imports, defines what a run takes as a law: any Spec with values.
"""

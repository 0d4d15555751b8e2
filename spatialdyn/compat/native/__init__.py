"""Compiled calls and operators that only ``compat`` uses."""

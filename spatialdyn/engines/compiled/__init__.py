"""Numba kernels over the table of bodies, builtins of CPython, and compiled code on disk."""

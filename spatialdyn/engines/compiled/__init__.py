"""Numba kernels over the table of bodies, CPython builtins, and the disk cache of compiled code."""

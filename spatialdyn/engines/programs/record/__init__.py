"""Recursions recorded as programs: the tracer, programs, and what is changed in a table before."""

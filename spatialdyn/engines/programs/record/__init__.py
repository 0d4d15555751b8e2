"""Recursions recorded as programs: the tracer, programs, and changes to a table before it is recorded."""

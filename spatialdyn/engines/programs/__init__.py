"""Recursions recorded for one model and compiled as straight-line programs on SIMD lanes."""

"""Loops and other constraints: their rows, motion under them, derivatives."""

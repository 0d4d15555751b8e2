"""Compiled calls over spatial types, for the faces alone."""

"""Identification of a model's parameters from recorded motions, and of those that a recording does not determine."""

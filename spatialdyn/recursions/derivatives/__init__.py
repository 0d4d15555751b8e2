"""Derivatives of dynamics, motion and steps."""

"""Stands for ``pinocchio.visualize``, which is out of scope: importing it says what to use instead."""

from .coverage import missing_module

missing_module(__name__)

"""Stands for ``pinocchio.serialization``, which is out of scope: importing it says what to use instead."""

from .coverage.coverage import missing_module

missing_module(__name__)

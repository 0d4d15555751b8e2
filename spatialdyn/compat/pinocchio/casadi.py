"""``pinocchio.casadi`` is out of scope: importing it raises an error that says what to use instead."""

from .coverage.coverage import missing_module

missing_module(__name__)

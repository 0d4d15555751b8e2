"""``pinocchio.serialization`` is out of scope: importing it raises an error that says what to use instead."""

from .coverage.coverage import OutOfScopeImportError, instead

raise OutOfScopeImportError(f"pinocchio.serialization is not supported: {instead('serialization')}")

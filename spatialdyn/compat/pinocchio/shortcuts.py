"""``pinocchio.shortcuts``: models and data in one call."""

from __future__ import annotations

from .algorithms.dynamics import nle
from .model.geometry import buildModelsFromUrdf, createDatas

__all__ = ["buildModelsFromUrdf", "createDatas", "nle"]

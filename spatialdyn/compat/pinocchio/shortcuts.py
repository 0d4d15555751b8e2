"""``pinocchio.shortcuts``: models and data in one call."""

from __future__ import annotations

from .algorithms.calls import nle
from .model.geometry import createDatas
from .model.geometry_from_mjcf import buildModelsFromMJCF
from .model.geometry_from_urdf import buildModelsFromUrdf

__all__ = ["buildModelsFromMJCF", "buildModelsFromUrdf", "createDatas", "nle"]

"""The functions of the table of names; ``calls.pyi`` has their types."""

from __future__ import annotations

from ..data.face import function
from .table import FACES

__all__ = [face.name for face in FACES] + ["nle"]
globals().update({face.name: function(face, __name__) for face in FACES})
nle = globals()["nonLinearEffects"]

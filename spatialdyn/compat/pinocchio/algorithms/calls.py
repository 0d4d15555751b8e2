"""The functions of the table of names; ``calls.pyi`` has their types."""

from __future__ import annotations

from ..data.face import function
from ..types.frame import Convention as Convention  # of defaults in signatures
from ..types.frame import ReferenceFrame as ReferenceFrame
from .table import FACES

__all__ = [face.name for face in FACES] + ["nle"]
globals().update({face.name: function(face, __name__, k, len(FACES)) for k, face in enumerate(FACES)})
nle = globals()["nonLinearEffects"]

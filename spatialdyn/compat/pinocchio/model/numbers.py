"""The numbers of a Model in one block of memory, of which its values are views: an edit shows as a change of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..types.arguments import Array


class Numbers:
    """Views of a block, one after the other: gravity (6,), placements (njoints, 4, 4) and inertias (njoints, 10) of the
    joints, armature (nv,).
    """

    __slots__ = ("armature", "block", "gravity", "inertias", "masses", "placements")

    def __init__(self, njoints: int, nv: int, block: Any = None) -> None:
        """Of a block, which may be its bytes; by default of a new one of zeros."""
        first, second = 6 + 16 * njoints, 6 + 26 * njoints
        if isinstance(block, bytes):
            block = np.frombuffer(block)
        self.block: Array = np.zeros(second + nv) if block is None else block
        self.gravity: Array = self.block[:6]
        self.placements: Array = self.block[6:first].reshape(-1, 4, 4)
        self.inertias: Array = self.block[first:second].reshape(-1, 10)
        self.masses: Array = self.inertias[1:, 0]  # without the universe's
        self.armature: Array = self.block[second:]

    def grown(self, placement: Array, freedoms: int) -> Numbers:
        """Those with one more joint, without inertia and armature."""
        njoints, nv = len(self.placements), len(self.armature)
        found = Numbers(njoints + 1, nv + freedoms)
        found.gravity[:], found.placements[:njoints] = self.gravity, self.placements
        found.placements[njoints] = placement
        found.inertias[:njoints], found.armature[:nv] = self.inertias, self.armature
        return found

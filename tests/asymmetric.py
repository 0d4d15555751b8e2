"""Numbers without symmetry: no swap, transposition, sign, shared factor or shared sum leaves a result as it was."""

from __future__ import annotations

import itertools
import math

import numpy as np

Array = np.ndarray


def primes(*shape: int, after: int = 1) -> Array:
    """Distinct primes above ``after``, of a shape: products of different ones differ, whichever are taken."""
    found = (n for n in itertools.count(max(2, after + 1)) if all(n % k for k in range(2, math.isqrt(n) + 1)))
    return np.array(list(itertools.islice(found, math.prod(shape))), float).reshape(shape)


def roots(*shape: int, after: int = 1) -> Array:
    """Square roots of distinct primes, of alternating sign: sums of different ones differ too."""
    found = np.sqrt(primes(*shape, after=after))
    signs = np.where(np.arange(found.size) % 3 == 1, -1.0, 1.0)  # a period that divides no side of usual matrices
    return found * signs.reshape(found.shape)

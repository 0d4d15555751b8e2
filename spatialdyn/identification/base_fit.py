"""Least squares of base parameters that a recording excites, without those that it hardly determines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..errors import IdentificationError
from .base import Base, pivoted
from .least_squares import Factors, Solution, solve

Array = NDArray[np.float64]
UNSEEN = 1e-7  # relative to the largest pivot of columns of norm 1: a column with a smaller one is not excited


class BaseFit:
    """β (rank,) and its statistics, 0 for columns that were removed or are not seen."""

    def __init__(self, factors: Factors, rank: int, kept: NDArray[np.intp], extra: int, solution: Solution) -> None:
        own = len(kept)
        self.solution, self.kept = solution, kept
        self.beta, self.deviation = np.zeros(rank), np.zeros(rank)
        self.covariance = np.zeros((rank, rank))
        self.beta[kept] = solution.beta[:own]
        self.covariance[np.ix_(kept, kept)] = solution.covariance[:own, :own]
        self.deviation = np.sqrt(self.covariance.diagonal())
        self.late = float(np.sqrt(solution.covariance[-1, -1])) if extra else 0.0
        T = solution.R[:own, :own]
        self.values = np.linalg.svd(T / np.sqrt((T * T).sum(0)), compute_uv=False)
        self.removed: list[int] = []
        self.seen = np.ones(rank, bool)


def fit_base(
    factors: Factors, base: Base, extra: int, weighted: bool, share: float | None, method: str,
    inflation: Array | None = None, before: BaseFit | None = None,
) -> BaseFit:  # fmt: skip
    """β of the columns that are seen and not removed. Raises IdentificationError."""
    tail = np.arange(base.rank, base.rank + extra)
    if before is not None:
        columns = np.concatenate([before.kept, tail]).astype(np.intp)
        made = BaseFit(factors, base.rank, before.kept, extra, solve(factors.part(columns), weighted, inflation))
        made.removed, made.seen = before.removed, before.seen
        made.deviation = np.where(made.seen, made.deviation, np.inf)
        return made
    R = factors.joined(np.ones(len(factors.R)))[: base.rank, : base.rank]
    size = np.sqrt((R * R).sum(0))
    used = np.flatnonzero(size > UNSEEN * size.max(initial=0.0))
    order, T = pivoted(R[:, used] / size[used])
    pivots = abs(T.diagonal())
    seen = np.zeros(base.rank, bool)
    seen[used[order[: int((pivots > UNSEEN * pivots[0]).sum())]]] = True
    if not seen.all() and method in ("ols", "wls") and share is None:
        lost = [base.text(int(k)) for k in np.flatnonzero(~seen)]
        table = "\n".join(f"  {x}" for x in lost[:20])
        raise IdentificationError(
            f"recording tells {int(seen.sum())} of {base.rank} base parameters, expected all: a motion that moves "
            f'these too, method="log_cholesky", whose prior has them, or remove= to leave them out\n{table}'
        )
    kept, removed = np.flatnonzero(seen), []
    while True:
        columns = np.concatenate([kept, tail]).astype(np.intp)
        made = BaseFit(factors, base.rank, kept, extra, solve(factors.part(columns), weighted))
        if share is None or not len(kept):
            break
        with np.errstate(divide="ignore"):
            worst = made.deviation[kept] / abs(made.beta[kept])
        if worst.max() <= share:
            break
        removed.append(int(kept[worst.argmax()]))
        kept = np.delete(kept, worst.argmax())
    made.removed = [*np.flatnonzero(~seen).tolist(), *removed] if share is not None else removed
    made.seen = seen
    return made

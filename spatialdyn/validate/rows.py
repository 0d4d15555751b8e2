"""What a comparison says: a row per call, and all rows of a robot."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import SpatialDynError
from .measures import size


@dataclass(frozen=True)
class Row:
    """What came of one call.

    call      its name, and what is special about the way it was called
    error     scaled error, nan or infinite where a result is not finite or refused; None if nothing was compared
    bound     what the error may be
    ok        whether it is at most that
    note      why an identity stands in for Pinocchio, or what went wrong; empty otherwise
    ours_us, pin_us  time of one call from Python [µs], None if not taken
    """

    call: str
    error: float | None
    bound: float
    ok: bool
    note: str = ""
    ours_us: float | None = None
    pin_us: float | None = None

    @property
    def ratio(self) -> float | None:
        """Our time over Pinocchio's, None if not taken."""
        return self.ours_us / self.pin_us if self.ours_us and self.pin_us else None

    @property
    def badness(self) -> tuple[bool, float]:
        """What orders rows: failed ones last, then by error in units of the bound."""
        return not self.ok, size(self.error) / self.bound


@dataclass(frozen=True)
class Comparison:
    """One robot with one kind of root against Pinocchio, a row per call."""

    robot: str
    root: str
    nq: int
    nv: int
    samples: int
    rows: tuple[Row, ...] = field(repr=False)

    @property
    def ok(self) -> bool:
        """Whether every row is within its bound."""
        return all(row.ok for row in self.rows)

    @property
    def worst(self) -> Row:
        """The row whose error is largest in units of its bound; a failed one before all others."""
        return max(self.rows, key=lambda row: row.badness)

    def row(self, call: str) -> Row:
        """The row of a call. Raises SpatialDynError if there is none of that name."""
        for row in self.rows:
            if row.call == call:
                return row
        raise SpatialDynError(f'call is "{call}", expected one of {", ".join(row.call for row in self.rows)}')


def judged(label: str, error: float, bound: float, note: str = "", times: tuple[float, float] | None = None) -> Row:
    """A row whose error says whether it is ok."""
    ours, theirs = times or (None, None)
    return Row(label, error, bound, bool(error <= bound), note, ours, theirs)

"""The result of a comparison: a row per call, and all rows of a robot."""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import SpatialDynError
from .measures import sort_key


@dataclass(frozen=True)
class Row:
    """The comparison of one call.

    call      name of the call, and a variant in brackets
    error     scaled error, nan or infinite if a result is not finite or a call raised; None if nothing was compared
    bound     largest allowed error
    ok        whether the error is at most that
    note      why an identity replaces Pinocchio, or what failed; empty otherwise
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
        """Sort key: failed rows last, then by error in units of the bound."""
        return not self.ok, sort_key(self.error) / self.bound


@dataclass(frozen=True, repr=False)
class Comparison:
    """One robot with one kind of root against Pinocchio, a row per call."""

    robot: str
    root: str
    nq: int
    nv: int
    samples: int
    rows: tuple[Row, ...] = field(repr=False)

    def __repr__(self) -> str:
        failed = [row.call for row in self.rows if not row.ok]
        verdict = f"disagrees in {', '.join(failed)}" if failed else f"agrees in {len(self.rows)} rows"
        return f"<Comparison of {self.robot}, {self.root} root, nv {self.nv}, {self.samples} states: {verdict}>"

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

    def _repr_html_(self) -> str:
        from ..pictures.notebook import comparison_html

        return comparison_html(self)


def judged(label: str, error: float, bound: float, note: str = "", times: tuple[float, float] | None = None) -> Row:
    """A row that is ok if its error is within its bound."""
    ours, theirs = times or (None, None)
    return Row(label, error, bound, bool(error <= bound), note, ours, theirs)

"""The integration methods: their cost, order and invariants."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from . import explicit, symplectic, variational

KEEPS_NOTHING = "nothing"
SYMPLECTIC = "Ω"
SYMMETRIC = "Ω, time reversal"
MOMENTA = "Ω, time reversal, momenta of symmetries"


@dataclass(frozen=True)
class Family:
    """Methods that share a state: how to observe and start it, their kernels, their rows of scratch.

    moves  "v" or "p", which they integrate beside q
    start  None if they integrate q and v or p themselves
    wide   whether rows of scratch hold 2 nv numbers rather than nv
    """

    moves: str
    kernels: Callable[[bool], Any]
    observe: Callable[..., None]
    rows: int
    start: Callable[..., None] | None = None
    wide: bool = False


@dataclass(frozen=True)
class Method:
    """An integration method.

    name         as ``simulate`` takes it
    order        the global error is O(dt^order); that of SciPy's methods is governed by rtol and atol instead
    evaluations  of forward dynamics per step; for implicit methods per sweep, 5 to 20 of which make a step
    preserves    up to rounding: Ω, the symplectic form; "time reversal", a step of -dt undoes a step of dt; "momenta of
                 symmetries", such as those of a free-floating robot. No method preserves the energy itself; the energy
                 error of a method that preserves Ω stays bounded over very long times. With armatures on planar or
                 floating joints the equations have no Lagrangian (``lagrangian.hamiltonian``): only time reversal holds
    note         advice in a few words
    """

    name: str
    order: int
    evaluations: int
    preserves: str
    note: str
    family: Family | None = None
    advance: Callable[..., None] | None = None

    @property
    def symplectic(self) -> bool:
        """Whether the method preserves the symplectic form."""
        return self.preserves.startswith(SYMPLECTIC)


EXPLICIT = Family("v", explicit.kernels, explicit.observe, 10)
CANONICAL = Family("p", symplectic.kernels, symplectic.observe, symplectic.ROWS, symplectic.start, wide=True)
DISCRETE = Family("p", variational.kernels, variational.observe, variational.ROWS)

_ALL = (
    Method(
        "explicit_euler", 1, 1, KEEPS_NOTHING, "gains energy; for teaching",
        EXPLICIT, explicit.explicit_euler,
    ),
    Method(
        "semi_implicit_euler", 1, 1, KEEPS_NOTHING, "symplectic only where M is constant; else energy drifts",
        EXPLICIT, explicit.semi_implicit_euler,
    ),
    Method(
        "velocity_verlet", 2, 2, KEEPS_NOTHING,
        "symplectic only where M is constant: with M(q) the forces depend on v, and its energy drifts worse than RK4's",
        EXPLICIT, explicit.velocity_verlet,
    ),
    Method(
        "rk4", 4, 4, KEEPS_NOTHING, "accurate and cheap over short times; energy drifts like dt^5 per step",
        EXPLICIT, explicit.rk4,
    ),
    Method(
        "symplectic_euler", 1, 1, SYMPLECTIC, "implicit in p",
        CANONICAL, symplectic.symplectic_euler,
    ),
    Method(
        "stormer_verlet", 2, 2, SYMMETRIC, "generalised to M(q), implicit in p and then in q (HLW VI.3)",
        CANONICAL, symplectic.stormer_verlet,
    ),
    Method(
        "implicit_midpoint", 2, 1, SYMMETRIC, "implicit in q and p; compensated summation",
        CANONICAL, symplectic.implicit_midpoint,
    ),
    Method(
        "gauss4", 4, 2, SYMMETRIC, "Gauss's collocation in 2 stages; compensated summation",
        CANONICAL, symplectic.gauss4,
    ),
    Method(
        "gauss6", 6, 3, SYMMETRIC, "Gauss's collocation in 3 stages; compensated summation: for long, accurate runs",
        CANONICAL, symplectic.gauss6,
    ),
    Method(
        "variational", 2, 1, MOMENTA, "discrete mechanics on the group of the joints, O(n)",
        DISCRETE, variational.variational,
    ),
    Method("dop853", 8, 12, KEEPS_NOTHING, "SciPy's, step by tolerance; best for high accuracy up to 1000 s"),
    Method("radau", 5, 3, KEEPS_NOTHING, "SciPy's, step by tolerance; for stiff torques; takes energy away"),
)  # fmt: skip


SCIPY_METHODS = tuple(x.name for x in _ALL if x.family is None)
EXPLICIT_METHODS = {x.name: x.advance for x in _ALL if x.family is EXPLICIT and x.advance is not None}


class Integrators(Mapping[str, Method]):
    """The integration methods by name: ``integrators["gauss4"].order``; prints as a table of costs and invariants.

    >>> import spatialdyn as sd
    >>> sd.integrators["gauss4"].order, sd.integrators["rk4"].symplectic
    (4, False)
    """

    def __getitem__(self, name: str) -> Method:
        return _TABLE[name]

    def __iter__(self) -> Iterator[str]:
        return iter(_TABLE)

    def __len__(self) -> int:
        return len(_TABLE)

    def __repr__(self) -> str:
        rows = [("method", "order", "evaluations", "preserves")]
        rows += [
            (x.name, str(x.order), f"{x.evaluations}{' a sweep' if x.symplectic else ''}", x.preserves) for x in _ALL
        ]
        widths = [max(len(row[k]) for row in rows) for k in range(4)]
        return "\n".join("  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows)


_TABLE = {method.name: method for method in _ALL}
integrators = Integrators()

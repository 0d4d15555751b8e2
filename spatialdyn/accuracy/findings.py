"""What a diagnosis says: findings with a severity, the thing they are about and a remedy."""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

SEVERITIES = ("note", "warning", "error")


class Finding(NamedTuple):
    """One thing that is odd about a model.

    severity  "note", "warning" or "error": good to know, costs digits, results are wrong or refused
    kind      inertia, units, mass ratio, condition, unfelt, singular, digits, programs, range or time step
    link      name of the link it is about
    message   what was found, with its figure
    remedy    what to do about it
    """

    severity: str
    kind: str
    link: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f'{self.severity}: link "{self.link}" {self.message}; {self.remedy}'


class Stiffest(NamedTuple):
    """What the largest eigenvalue of M⁻¹ diag(damping) says to an explicit integrator.

    joint    name of the joint that takes most part in it
    inertia  [kg m² | kg] that it moves, all other joints free: 1 / (M⁻¹)_jj
    rate     λ [1/s], 0 without damping
    dt       2 / λ [s], above which explicit Euler grows (rk4: 2.79 / λ); infinite without damping
    """

    joint: str
    inertia: float
    rate: float
    dt: float


class Diagnosis(NamedTuple):
    """What ``diagnose`` has found of a model.

    name       of the model
    findings   tuple of Finding, the worst first
    condition  {"neutral" or "given", "sampled"}: condition of M scaled to a unit diagonal, the worst of each
    digits     {method: {"float64": digits, "float32": digits}} to expect of ``forward_dynamics``, at worst
    stiffest   Stiffest, or None if nothing moves
    programs   {call: {"single": digits, "batch": digits}}, at worst, of calls that run as programs on SIMD lanes
    states     how many states digits are of
    """

    name: str
    findings: tuple[Finding, ...]
    condition: dict[str, float]
    digits: dict[str, dict[str, float]]
    stiffest: Stiffest | None
    programs: dict[str, dict[str, float]]
    states: int

    @property
    def severity(self) -> str:
        """Of the worst finding; "ok" if there is none."""
        return self.findings[0].severity if self.findings else "ok"

    def of(self, kind: str) -> tuple[Finding, ...]:
        """The findings of one kind."""
        return tuple(f for f in self.findings if f.kind == kind)

    def to_dict(self) -> dict[str, Any]:
        """All of it as what JSON holds; what is infinite is None."""
        return {
            "name": self.name,
            "severity": self.severity,
            "findings": [f._asdict() for f in self.findings],
            "condition": {where: _finite(x) for where, x in self.condition.items()},
            "digits": self.digits,
            "programs": self.programs,
            "states": self.states,
            "stiffest": None if self.stiffest is None else {**self.stiffest._asdict(), "dt": _finite(self.stiffest.dt)},
        }

    def to_json(self) -> str:
        """All of it as JSON text."""
        return json.dumps(self.to_dict(), indent=2, ensure_ascii=False, allow_nan=False)

    def __repr__(self) -> str:
        return f"<Diagnosis {self.name}: {self.severity}, {len(self.findings)} findings>"

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.severity}"]
        for where, x in self.condition.items():
            lines.append(f"condition of M, scaled, {where}: {x:.2g}")
        if self.digits:
            lines += ["digits of forward dynamics   float64  float32"]
            for method, found in self.digits.items():
                lines.append(f"  {method:<26} {found['float64']:>7.1f}  {found['float32']:>7.1f}")
            lines.append(f"  the worst of {self.states} states")
        if self.programs:
            lines += ["digits of programs             single    batch"]
            for call, found in self.programs.items():
                lines.append(f"  {call:<26} {found['single']:>7.1f}  {found['batch']:>7.1f}")
        s = self.stiffest
        if s is not None:
            limit = f"dt {s.dt:.3g} s" if s.rate > 0.0 else f"dt = {2.0 * s.inertia:.3g} / damping"
            lines.append(f'stiffest joint "{s.joint}" moves {s.inertia:.3g}: explicit Euler is stable to {limit}')
        return "\n".join([*lines, *map(str, self.findings)])


def _finite(x: float) -> float | None:
    """A number that JSON can hold."""
    return x if math.isfinite(x) else None

"""The result of a diagnosis: findings, each with a severity, a link, a message and a remedy."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..calls.json_numbers import finite_or_none, json_text
from ..model.model import Model
from ..waiting import watch

SEVERITIES = ("note", "warning", "error")


class Finding(NamedTuple):
    """One oddity of a model.

    severity  "note": worth knowing, "warning": costs digits, "error": results are wrong or refused
    kind      inertia, units, mass ratio, condition, unfelt, singular, digits, programs, range, time step or friction
    link      name of the link
    message   the finding, with its figure
    remedy    the advice
    """

    severity: str
    kind: str
    link: str
    message: str
    remedy: str

    def __str__(self) -> str:
        return f'{self.severity}: link "{self.link}" {self.message}; {self.remedy}'


class Stiffest(NamedTuple):
    """The stability limit of an explicit integrator, from the largest eigenvalue λ of M⁻¹ diag(damping).

    joint    name of the joint with the largest part in its eigenvector
    inertia  [kg m² | kg] of that joint with all others free: 1 / (M⁻¹)_jj
    rate     λ [1/s], 0 without damping
    dt       2 / λ [s], above which explicit Euler grows (rk4: 2.79 / λ); infinite without damping
    """

    joint: str
    inertia: float
    rate: float
    dt: float


class Diagnosis(NamedTuple):
    """The result of ``diagnose``.

    name       name of the model
    findings   tuple of Finding, the worst first
    condition  {"neutral" or "given", "sampled"}: condition number of M scaled to a unit diagonal, the worst of each
    digits     {method: {"float64": digits, "float32": digits}} of ``forward_dynamics`` in the worst state;
               "extended" has float64 alone
    stiffest   Stiffest, or None without joints that move
    programs   {call: {"single": digits, "batch": digits}} in the worst state, of calls that run on SIMD lanes
    states     number of states in which digits were measured
    subject    the Model; None if it is not known
    """

    name: str
    findings: tuple[Finding, ...]
    condition: dict[str, float]
    digits: dict[str, dict[str, float]]
    stiffest: Stiffest | None
    programs: dict[str, dict[str, float]]
    states: int
    subject: Model | None = None

    @property
    def severity(self) -> str:
        """The worst severity; "ok" without findings."""
        return self.findings[0].severity if self.findings else "ok"

    def of(self, kind: str) -> tuple[Finding, ...]:
        """The findings of one kind."""
        return tuple(f for f in self.findings if f.kind == kind)

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON types; infinite numbers are None."""
        stiff = self.stiffest
        return {
            "name": self.name,
            "severity": self.severity,
            "findings": [f._asdict() for f in self.findings],
            "condition": {where: finite_or_none(x) for where, x in self.condition.items()},
            "digits": self.digits,
            "programs": self.programs,
            "states": self.states,
            "stiffest": None if stiff is None else {**stiff._asdict(), "dt": finite_or_none(stiff.dt)},
        }

    def to_json(self) -> str:
        """All of it as JSON text."""
        return json_text(self.to_dict())

    def __repr__(self) -> str:
        return f"<Diagnosis {self.name}: {self.severity}, {len(self.findings)} findings>"

    def __str__(self) -> str:
        lines = [f"{self.name}: {self.severity}"]
        for where, x in self.condition.items():
            lines.append(f"condition of M, scaled, {where}: {x:.2g}")
        if self.digits:
            lines += ["digits of forward dynamics   float64  float32"]
            for method, found in self.digits.items():
                narrow = f"  {found['float32']:>7.1f}" if "float32" in found else ""
                lines.append(f"  {method:<26} {found['float64']:>7.1f}{narrow}")
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

    @watch.call("Diagnosis.report")
    def report(self, path: Any) -> None:
        """Write one HTML page of the diagnosis, which needs no network: robot, findings, digits, how to reproduce it.

        path  a name that ends in .html, or an open file

        Raises  SpatialDynError for another ending, if the file cannot be written, or where matplotlib is not installed.
        """
        from ..pictures.page import report_diagnosis

        report_diagnosis(self, path)

    def _repr_html_(self) -> str:
        from ..pictures.notebook import diagnosis_html

        return diagnosis_html(self)

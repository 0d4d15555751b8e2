"""The Spec of a public call, and the values of its static inputs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ..bodies.static_table import StaticTable
from ..errors import ModelError, SpatialDynError, literal
from ..model.model import Frame, Model
from ..recursions import SPECS
from ..recursions.spec import Spec
from .arguments import REFERENCES, as_flag, frame_row_and_placement, reference_code
from .dynamics import calls as public
from .dynamics import python_calls

CHOOSERS = {"forward_dynamics": "aba, crba_solve, aba_refined or aba_square_root"}  # name -> calls to name in errors


def expected_call(function: Any, example: str) -> str:
    """The text of an error for a function that is no call of one recursion."""
    name = getattr(function, "__name__", literal(function))
    return f"{name}, expected {f'its method: {CHOOSERS[name]}' if name in CHOOSERS else example}"


def spec_of(call: Any) -> Spec | None:
    """The spec of a public call: the attribute ``spec`` of a call with a table of constraints, ``torque_spec`` of a
    control law. Returns None if not applicable.
    """
    named = getattr(call, "torque_spec", None) or getattr(call, "spec", None)
    if isinstance(named, Spec):
        return named
    name = getattr(call, "__name__", None)
    if not isinstance(name, str) or name not in SPECS:
        return None
    known = (public.get(name), python_calls.get(name))  # ``get`` makes no function: only used ones exist
    return SPECS[name] if any(x is call for x in known) else None


def specs_of(calls: Any) -> tuple[Spec, ...]:
    """The specs of a public call or several. Raises SpatialDynError for anything else."""
    listed = [calls] if callable(calls) else calls
    if not isinstance(listed, (list, tuple)) or not listed:
        raise SpatialDynError(
            f"calls is {literal(calls)}, expected a public call such as spatialdyn.rnea or a list of such"
        )
    specs: list[Spec] = []
    for function in listed:
        spec = spec_of(function)
        if spec is None:
            raise SpatialDynError(f"calls has {expected_call(function, 'public calls such as spatialdyn.rnea')}")
        if spec in specs:
            raise SpatialDynError(f"calls has {spec.name} twice, expected it once")
        specs.append(spec)
    return tuple(specs)


def static_of(
    model: Model,
    names: Iterable[str],
    frame: str | Frame | None,
    reference: str,
    classical: bool,
    constraints: Any = None,
) -> dict[str, Any]:
    """Values of the static inputs (row, placement, reference, classical, constraints or contacts).

    Raises if one is given but no call takes it.
    """
    values: dict[str, Any] = {}
    names = set(names)
    if "row" in names:
        if frame is None:
            raise ModelError("frame is None, expected the name of one: a call takes it")
        values["row"], values["placement"] = frame_row_and_placement(model, frame)
    elif frame is not None:
        raise SpatialDynError(f"frame is {literal(frame)}, expected None: no call takes one")
    code = reference_code(reference)
    if "reference" in names:
        values["reference"] = code
    elif code != REFERENCES["local"]:
        raise SpatialDynError(f"reference is {literal(reference)}, expected the default: no call takes one")
    classical = as_flag("classical", classical)
    if "classical" in names:
        values["classical"] = int(classical)
    elif classical:
        raise SpatialDynError("classical is True, expected the default: no call takes it")
    table = getattr(constraints, "table", None)
    touches = hasattr(constraints, "terrain")
    for name, kind in (("constraints", "Constraints"), ("contacts", "Contacts on a Plane")):
        if name in names:
            fits = isinstance(table, StaticTable) and constraints.model == model and touches == (name == "contacts")
            if not fits or (touches and len(constraints.tables) > 1):
                raise SpatialDynError(
                    f"constraints are {literal(constraints)}, expected {kind} of this model: a call takes them"
                )
            values[name] = table
    if constraints is not None and not names & {"constraints", "contacts"}:
        raise SpatialDynError(f"constraints are {literal(constraints)}, expected None: no call takes them")
    return values

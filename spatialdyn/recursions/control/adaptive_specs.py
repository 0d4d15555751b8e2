"""The Specs of adaptive laws: of both kinds, with friction or without, composite or not."""

from __future__ import annotations

from typing import Any

from ..joints.friction import DT
from ..spec import TAU, Argument, Q, Spec, V, made_once
from .adaptive_laws import (
    TABLE,
    WORK,
    Aim,
    Euclidean,
    Natural,
    NaturalScratch,
    Scratch,
    Wear,
    euclidean,
    euclidean_with_friction,
    natural,
    natural_with_friction,
)
from .composite_laws import (
    Ends,
    Filters,
    Prediction,
    WornEnds,
    composite,
    composite_with_friction,
    natural_composite,
    natural_composite_with_friction,
)
from .control_laws import A_REF, DIAGONAL, MATRIX, Q_REF, V_REF

_UNIT = "kg | kg m | kg m²"

DEADZONE = Argument("deadzone", (1,), "rad/s", "|s| up to which nothing is learnt")
WEAR = Wear(
    Argument("smoothing", ("nv",), "rad/s | m/s", "velocity over which friction changes its sign"),
    Argument("friction", (2, "nv"), "N m | N, N m s/rad | N s/m", "first estimates of dry friction and damping"),
    Argument("friction_step", (2, "nv"), "", "how fast they are learnt"),
)
WORN = Argument("worn", (2, "nv"), "N m | N, N m s/rad | N s/m", "learnt friction less the first", start=0.0)
WORN_AFTER = Argument("worn_after", (2, "nv"), WORN.unit, WORN.meaning)


PREDICTED = Prediction(
    Argument("composite", (1,), "", "c, the weight of the error of prediction"),
    Argument("bandwidth", (1,), "1/s", "ω of the filters"),
)
FILTERS = Filters(
    Argument("filtered", ("nv", "njoints", 10), "", "F", start=0.0),
    Argument("filtered_torque", ("nv",), "N m | N", "T", start=0.0), Argument("begun", (1,), "", "1", start=0.0),
)  # fmt: skip
FILTERS_AFTER = Filters(*[Argument(f"{x.name}_after", x.shape, x.unit, x.meaning) for x in FILTERS])
RECURSIONS: dict[tuple[bool, bool, bool], Any] = {  # by whether they are natural, composite, and learn friction
    (False, False, False): euclidean, (False, False, True): euclidean_with_friction,
    (False, True, False): composite, (False, True, True): composite_with_friction,
    (True, False, False): natural, (True, False, True): natural_with_friction,
    (True, True, False): natural_composite, (True, True, True): natural_composite_with_friction,
}  # fmt: skip


@made_once()
def adaptive_spec(
    natural_law: bool, matrix_rates: bool, matrix_gain: bool, friction: bool, predicts: bool = False
) -> Spec:  # fmt: skip
    """The Spec of an adaptive law: whether it is natural, Λ and K are matrices, it learns friction, it is composite."""
    shape: tuple[Any, ...] = ("njoints", 4, 4) if natural_law else TABLE
    first = Argument("first", shape, "" if natural_law else _UNIT, "the first estimate")
    by: Any = Natural(first, Argument("step", ("njoints",), "", "1/γ of each body"), DEADZONE)
    if not natural_law:
        step = Argument("step", TABLE, "", "Γ of each parameter")
        least, most = (Argument(x, TABLE, _UNIT, "of the estimates") for x in ("least", "most"))
        by = Euclidean(first, step, least, most, DEADZONE)
    aim = Aim(
        Argument("rates", MATRIX if matrix_rates else DIAGONAL, "1/s", "Λ"),
        Argument("gain", MATRIX if matrix_gain else DIAGONAL, "N m s/rad | N s/m", "K"), Q_REF, V_REF, A_REF,
    )  # fmt: skip
    learnt = Argument("learnt", shape, first.unit, "the estimate less the first estimate", start=0.0)
    end = Argument("learnt_after", shape, learnt.unit, learnt.meaning)
    name = ("natural_adaptation" if natural_law else "slotine_li") + "_composite" * predicts
    shapes = "".join("M" if x else "d" for x in (matrix_rates, matrix_gain)) + "f" * friction
    inputs: list[Any] = [Q, V, DT, aim, by, *[PREDICTED] * predicts, *[WEAR] * friction, learnt]
    scratch: tuple[Any, ...] = (Scratch(), NaturalScratch()) if natural_law else (Scratch(),)
    ends: Any = (TAU, end, *[WORN_AFTER] * friction)
    if predicts:
        ends = WornEnds(TAU, end, *FILTERS_AFTER, WORN_AFTER) if friction else Ends(TAU, end, *FILTERS_AFTER)
    return Spec(
        f"{name}_{shapes}", RECURSIONS[natural_law, predicts, friction], WORK,
        (*inputs, *[FILTERS] * predicts, *[WORN] * friction), TAU, "Adaptive control.", "see adaptive_laws",
        parts=ends,
        scratch=(*scratch, *[("nv", "njoints", 10)] * predicts), composed=True,
    )  # fmt: skip

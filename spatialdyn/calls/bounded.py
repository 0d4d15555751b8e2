"""Calls that also return a bound on their rounding error."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..errors import SpatialDynError, literal
from ..model.model import Frame, Model
from .specialize_request import Names, read_request
from .specialized import Specialized, check_program, of_request


def bounded(
    model: Model,
    call: Callable[..., Any],
    dtype: DTypeLike = np.float64,
    fixed: Mapping[str, Any] | None = None,
    inputs: Names = (),
    outputs: str | int | Sequence[str | int] | None = None,
    frame: str | Frame | None = None,
    reference: str = "local",
    classical: bool = False,
    constraints: Any = None,
    exact_inputs: bool = False,
) -> Specialized:
    """A call of one model as a compiled program that returns (result, bound): no entry's error exceeds its bound.

    Source: Wilkinson, Rounding errors in algebraic processes (1963); Higham, Accuracy and stability of numerical
    algorithms, 2nd ed. (2002), section 3.3, for every line of the program. The solution of a linear system (aba,
    crba_solve, aba_refined, minverse) is bounded by its residual instead, |M⁻¹| (|rnea(q, v, a) - tau| + rnea's bound),
    which is sharper. This bound includes one on M⁻¹, and so grows with M's condition number, up to infinity.

    Errors are measured from the exact result for the model's numbers and the given inputs. In float32 the exact inputs
    may be any numbers that round to the given ones; the bound includes this unless ``exact_inputs``. For calls that
    solve (aba, ...) the exact result is the solution of exact rnea, or crba: rotations by 1.5708 are orthogonal to
    rounding only, so exact recursions on them agree to rounding only. A sample beyond the program's range (angles whose
    root sum of squares is above 1e5, joints of hardly any articulated inertia, numbers beyond float32's safe range) has
    an infinite bound; in float32 the first batch with infinite bounds in most samples raises a UserWarning. A sample
    that the call itself refuses (a joint of no articulated inertia, a result out of range) is refused here with the
    same message. A sample with NaN has the result NaN and an infinite bound. Angles of 1e4 loosen no bound, but
    prismatic joints far out do: aba's bound is a thousand times its error for a panda whose fingers are 100 m out,
    some 200 times elsewhere.

    Along a chain of bodies bounds grow with every turn: by 1.4 a body where joints turn about axes of its frame, by 2.4
    where placements are turned too, while errors hardly grow. In float64 bounds of rnea are below 1e-3 of the largest
    torque up to 80 and 30 bodies in a row, whatever the number of branches. Longer chains have bounds that hold but say
    nothing, up to 1e130, and take half a minute to compile; ``sd.exact`` computes the error itself there, in 0.3 s a
    sample of 468 joints.

    model, dtype, fixed, inputs, outputs, frame, reference, classical, constraints   as of ``specialize``
    call   a public call such as ``sd.rnea``
    exact_inputs  True: float32 inputs are exact, not rounded from other numbers; bounds are then a third smaller

    Returns a Specialized of two results: that of the call, and a bound on each of its entries, in the same units.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> tau, bound = sd.bounded(model, sd.rnea)([0.3, 0.1], [1.0, 2.0], [0.0, 0.0])
    >>> bool((bound < 1e-13).all())
    True

    Raises
        SpatialDynError for a call that has no program (it branches on values, or the robot is too large), and under
            NUMBA_DISABLE_JIT; for inputs that float32 rounds with ``exact_inputs``; and as ``specialize``
        when called, the errors of the call, naming the first failed sample and their number
    """
    if not callable(call):
        raise SpatialDynError(f"call is {literal(call)}, expected one public call, such as sd.rnea")
    constants = {} if fixed is None else fixed
    words = (inputs, outputs, frame, reference, classical, constraints)
    request = read_request(model, call, dtype, constants, *words, bounds=True, exact_inputs=exact_inputs)
    arguments = (model, call, dtype, fixed, *words, exact_inputs)
    return check_program(of_request(request, bounded, arguments), "bounds")

"""Friction of a robot's joints: its coefficients, and its torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, check_model
from ..calls.dynamics import checked_call
from ..calls.failures import joint_of_velocity
from ..errors import ModelError, ShapeError
from ..model.model import Model
from ..recursions.friction import AT_ONCE, FRICTION_REGRESSOR, FRICTION_TORQUE

Array = NDArray[np.float64]
POSITIVE = ("stribeck_velocity", "smoothing")  # the others may be 0


@dataclass(frozen=True, eq=False, repr=False)
class Friction:
    """Coefficients of the friction of each freedom; compared and hashed by content. ``of(model)``: the URDF's.

    coulomb            (nv,)  dry friction of a joint that moves, F_c [N m | N]
    viscous            (nv,)  damping b [N m s/rad | N s/m]
    static             (nv,)  largest dry friction of a joint at rest, F_s at least F_c [N m | N]; F_c if left out
    stribeck_velocity  (nv,)  v_s of the fall F(v) = F_c + (F_s - F_c) exp(-(v/v_s)²) [rad/s | m/s]; if left out, F is
                              F_s at rest and F_c in any motion
    smoothing          (nv,)  ε of the sign tanh(v/ε), for smooth friction [rad/s | m/s]
    bristle_stiffness  (nv,)  σ0 of LuGre's bristles [N m/rad | N/m]
    bristle_damping    (nv,)  σ1 of the bristles [N m s/rad | N s/m]; 0 if left out

    A coefficient may be one number for all freedoms if another is an array.
    Raises  ShapeError for arrays that do not broadcast to (nv,). Values are checked where a model is there, by
            ``of``, ``friction_torque``, ``simulate`` and ``rollout``: ModelError naming the joint for a coefficient
            that is negative or not finite, a static friction below Coulomb's, and a velocity that is not above 0.

    >>> import spatialdyn as sd
    >>> friction = sd.Friction(coulomb=[1.0, 0.5], viscous=0.1, static=[1.2, 0.6])
    >>> friction.viscous
    array([0.1, 0.1])
    >>> friction == sd.Friction([1.0, 0.5], [0.1, 0.1], [1.2, 0.6])
    True
    """

    coulomb: Array
    viscous: Array
    static: Array
    stribeck_velocity: Array | None
    smoothing: Array | None
    bristle_stiffness: Array | None
    bristle_damping: Array | None

    def __init__(
        self,
        coulomb: ArrayLike,
        viscous: ArrayLike,
        static: ArrayLike | None = None,
        stribeck_velocity: ArrayLike | None = None,
        smoothing: ArrayLike | None = None,
        bristle_stiffness: ArrayLike | None = None,
        bristle_damping: ArrayLike | None = None,
    ) -> None:
        """Keep copies of the coefficients."""
        if bristle_damping is None and bristle_stiffness is not None:
            bristle_damping = 0.0
        arrays = {"coulomb": as_array("coulomb", coulomb), "viscous": as_array("viscous", viscous)}
        arrays["static"] = arrays["coulomb"] if static is None else as_array("static", static)
        rest = (stribeck_velocity, smoothing, bristle_stiffness, bristle_damping)
        arrays |= {x.name: as_array(x.name, y) for x, y in zip(fields(self)[3:], rest, strict=True) if y is not None}
        shapes = {name: x.shape for name, x in arrays.items()}
        try:
            shape = np.broadcast_shapes((1,), *shapes.values())
        except ValueError:
            shape = ()
        if len(shape) != 1:
            listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ShapeError(f"coefficients of friction have shapes {listed}, expected (nv,) or one number")
        for x in fields(self):
            value = None
            if x.name in arrays:
                value = np.array(np.broadcast_to(arrays[x.name], shape))
                value.flags.writeable = False
            object.__setattr__(self, x.name, value)

    @classmethod
    def of(cls, model: Model, **changes: ArrayLike | None) -> Friction:
        """The friction and damping of the model's joints, as its URDF has them; ``changes`` are coefficients by name.

        Raises  ModelError naming the joint for a coefficient out of its range, ShapeError.

        >>> import spatialdyn as sd
        >>> builder = sd.ModelBuilder("arm").add_body("rod", None, "revolute", (0, 0, 1), friction=0.2, damping=0.1)
        >>> model = builder.build()
        >>> sd.Friction.of(model, smoothing=0.01)
        <Friction of 1 freedom: coulomb [0.2], viscous [0.1], static [0.2], smoothing [0.01]>
        """
        check_model(model)
        return cls(**{"coulomb": model.friction, "viscous": model.damping, **changes}).check(model)  # type: ignore[arg-type]

    @property
    def law(self) -> tuple[Array, Array, Array, Array]:
        """F_c, b, F_s and v_s as the recursions take them."""
        fall = np.full(len(self.coulomb), AT_ONCE) if self.stribeck_velocity is None else self.stribeck_velocity
        return self.coulomb, self.viscous, self.static, fall

    def check(self, model: Model) -> Friction:
        """This friction, if it is one of the model's joints. Raises ShapeError, ModelError naming the joint."""
        n = check_model(model).nv
        if len(self.coulomb) != n:
            raise ShapeError(f'friction has {len(self.coulomb)} freedoms, expected the {n} of robot "{model.name}"')
        for name, x in self._given():
            expected = "a finite number above 0" if name in POSITIVE else "a finite number of 0 or more"
            self._refuse(model, name, x, ~((x > 0.0) if name in POSITIVE else (x >= 0.0)) | np.isinf(x), expected)
        least = [f"at least its Coulomb friction of {x:g}" for x in self.coulomb]
        self._refuse(model, "static", self.static, self.static < self.coulomb, least)
        return self

    def _refuse(self, model: Model, name: str, x: Array, bad: NDArray[np.bool_], expected: str | list[str]) -> None:
        if bad.any():
            k = int(np.argmax(bad))
            wanted = expected if isinstance(expected, str) else expected[k]
            what = name.replace("_", " ")
            raise ModelError(
                f'friction of joint "{joint_of_velocity(model, k).name}": {what} is {x[k]:g}, expected {wanted}'
            )

    def _given(self) -> list[tuple[str, Array]]:
        """Names and values of the coefficients that there are."""
        return [(x.name, getattr(self, x.name)) for x in fields(self) if getattr(self, x.name) is not None]

    def _content(self) -> tuple[tuple[str, bytes], ...]:
        return tuple((name, (x + 0.0).tobytes()) for name, x in self._given())

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Friction) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def __reduce__(self) -> tuple[Callable[..., Friction], tuple[Any, ...]]:
        return Friction, tuple(getattr(self, x.name) for x in fields(self))

    def __repr__(self) -> str:
        n = len(self.coulomb)
        text = ", ".join(f"{name} {np.array2string(x, separator=', ', threshold=8)}" for name, x in self._given())
        return f"<Friction of {n} freedom{'s' * (n != 1)}: {text}>"


def check_friction(model: Model, friction: Any) -> Friction:
    """The Friction of an argument: one that fits the model, or for True the URDF's. Raises ModelError, ShapeError."""
    if isinstance(friction, (bool, np.bool_)) and friction:
        return Friction.of(model)
    if not isinstance(friction, Friction):
        raise ModelError(f"friction is {friction!r}, expected a Friction, or True for that of the URDF")
    return friction.check(model)


def friction_torque(model: Model, v: ArrayLike, friction: Friction | bool, out: Any = None) -> Array:
    """Friction torques τ = -F(v) sgn v - b v of joints that move, F(v) = F_c + (F_s - F_c) exp(-(v/v_s)²).

    Source: Armstrong-Hélouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and compensation methods for
    the control of machines with friction (1994), for F(v).

    model     Model
    v         (..., nv)  joint velocities [rad/s | m/s]
    friction  Friction, or True for that of the URDF; with ``smoothing`` ε its sign is tanh(v/ε)
    out       (..., nv)  written in place if given: float64, C order, the shape of the result

    At rest, and without smoothing, the dry part is 0 here: what keeps a joint at rest depends on all other torques,
    and ``simulate`` and ``rollout`` find it.

    Returns friction (..., nv): torques to add to those of the motors [N m | N].
    Raises
        ShapeError for shapes that do not match, or an out that overlaps an input
        ModelError naming the joint with a coefficient out of its range, or for mimic joints
        NaN in a sample gives NaN in what depends on it, in no other sample.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> sd.friction_torque(model, [0.5, -2.0], sd.Friction([1.0, 1.0], [0.1, 0.1]))
    array([-1.05,  1.2 ])
    """
    if check_model(model).mimic_matrix is not None:
        raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False)')
    x = check_friction(model, friction)
    made: Array = checked_call(FRICTION_TORQUE, model, (v, *x.law, x.smoothing), (), out)
    return made


def friction_regressor(model: Model, v: ArrayLike, out: Any = None) -> Array:
    """Regressor F of joint friction in inverse dynamics: motors give F (F_c, b) more, F_c sgn v + b v.

    Source: the definition; with it the columns of ``joint_torque_regressor`` go on to friction.

    model  Model
    v      (..., nv)  joint velocities [rad/s | m/s]
    out    (..., nv, 2, nv)  written in place if given: float64, C order, the shape of the result

    Flat, F stands beside Y: (Y, F) (π, F_c, b) = rnea - armature a + friction's torque, as in the example. A joint at
    rest has 0 for Coulomb's friction: what keeps it there is no function of v.

    Returns F (..., nv, 2, nv): of each joint's torque, sgn v by F_c and v by b of each joint [1 | rad/s | m/s].
    Raises
        ShapeError for shapes that do not match, or an out that overlaps an input
        ModelError for mimic joints
        NaN in a sample gives NaN in what depends on it, in no other sample.

    >>> import numpy as np, spatialdyn as sd
    >>> model, (q, v, a) = sd.load_urdf("two_link"), np.array([[0.5, -0.3], [1.0, -2.0], [0.2, 0.4]])
    >>> friction = sd.Friction([0.5, 0.3], [0.1, 0.2])
    >>> Y, F = sd.joint_torque_regressor(model, q, v, a), sd.friction_regressor(model, v)
    >>> columns = np.concatenate([Y.reshape(2, -1), F.reshape(2, -1)], axis=1)
    >>> parameters = np.concatenate([np.ravel(sd.inertial_parameters(model)), friction.coulomb, friction.viscous])
    >>> bool(np.allclose(columns @ parameters, sd.rnea(model, q, v, a) - sd.friction_torque(model, v, friction)))
    True
    """
    if check_model(model).mimic_matrix is not None:
        raise ModelError(f'model "{model.name}" has mimic joints, expected one without (mimic=False)')
    made: Array = checked_call(FRICTION_REGRESSOR, model, (v,), (), out)
    return made

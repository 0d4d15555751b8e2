"""Friction of a robot's joints: its coefficients, and its torque."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..calls.arguments import as_array, as_number, check_model
from ..calls.dynamics import checked_call
from ..calls.failures import joint_of_velocity
from ..errors import ModelError, ShapeError, literal
from ..model.model import Model
from ..recursions.joints.friction import AT_ONCE, FRICTION_REGRESSOR, FRICTION_TORQUE

Array = NDArray[np.float64]
POSITIVE = ("stribeck_velocity", "smoothing")  # the others may be 0
Coefficient = ArrayLike | Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Friction:
    """Friction coefficients of each freedom; ``Friction.of(model)`` has those of the URDF. Compared by content.

    coulomb            (nv,)  dry friction of a joint that moves, F_c [N m | N]; 0 if left out
    viscous            (nv,)  damping b [N m s/rad | N s/m]; 0 if left out
    static             (nv,)  largest dry friction of a joint at rest, F_s at least F_c [N m | N]; F_c if left out
    stribeck_velocity  (nv,)  v_s of the Stribeck curve F(v) = F_c + (F_s - F_c) exp(-(v/v_s)²) [rad/s | m/s]; if left
                              out, F is F_s at rest and F_c in any motion
    smoothing          (nv,)  ε of the sign tanh(v/ε), for smooth friction [rad/s | m/s]
    bristle_stiffness  (nv,)  σ0 of LuGre's bristles [N m/rad | N/m]
    bristle_damping    (nv,)  σ1 of the bristles [N m s/rad | N s/m]; 0 if left out

    A coefficient may be one number for all freedoms, or {joint name: number}, in which joints that are left out have 0;
    ``stribeck_velocity`` and ``smoothing`` must name every joint. The attributes keep such coefficients as arrays (1,)
    and dicts; ``check(model)`` converts them to (nv,).
    Raises  ShapeError for arrays that do not broadcast to (nv,); ModelError naming a coefficient that is negative or
            not finite, a static friction below Coulomb's, and a velocity that is not above 0.

    >>> import spatialdyn as sd
    >>> friction = sd.Friction(coulomb=[1.0, 0.5], viscous=0.1, static=[1.2, 0.6])
    >>> friction.viscous
    array([0.1, 0.1])
    >>> friction == sd.Friction([1.0, 0.5], [0.1, 0.1], [1.2, 0.6])
    True
    >>> sd.Friction(viscous={"joint2": 5.0}).check(sd.load_urdf("two_link")).viscous
    array([0., 5.])
    """

    coulomb: Any
    viscous: Any
    static: Any
    stribeck_velocity: Any
    smoothing: Any
    bristle_stiffness: Any
    bristle_damping: Any

    def __init__(
        self,
        coulomb: Coefficient = 0.0,
        viscous: Coefficient = 0.0,
        static: Coefficient | None = None,
        stribeck_velocity: Coefficient | None = None,
        smoothing: Coefficient | None = None,
        bristle_stiffness: Coefficient | None = None,
        bristle_damping: Coefficient | None = None,
    ) -> None:
        """Keep copies of the coefficients."""
        if bristle_damping is None and bristle_stiffness is not None:
            bristle_damping = 0.0
        rest = (stribeck_velocity, smoothing, bristle_stiffness, bristle_damping)
        given = (coulomb, viscous, coulomb if static is None else static, *rest)
        named = zip((x.name for x in fields(self)), given, strict=True)
        read = {name: _read(name, y) for name, y in named if y is not None or name in ("coulomb", "viscous")}
        arrays = {name: x for name, x in read.items() if not isinstance(x, dict)}
        shapes = {name: x.shape for name, x in arrays.items()}
        try:
            shape = np.broadcast_shapes((1,), *shapes.values())
        except ValueError:
            shape = ()
        if len(shape) != 1:
            listed = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
            raise ShapeError(f"coefficients of friction have shapes {listed}, expected (nv,) or one number")
        for x in fields(self):
            value = read.get(x.name)
            if x.name in arrays:
                value = np.array(np.broadcast_to(arrays[x.name], shape))
                value.flags.writeable = False
            object.__setattr__(self, x.name, value)
        for name, values in self._given():
            _refuse_values(name, values)
        if not isinstance(self.static, dict) and not isinstance(self.coulomb, dict):
            self._refuse_static(None)

    @classmethod
    def of(cls, model: Model, **changes: Coefficient | None) -> Friction:
        """The friction and damping of the model's joints, from its URDF; ``changes`` are coefficients by name.

        Friction of mimic joints acts on their leaders: Σ |ratio| F_c and Σ ratio² b.

        Raises  ModelError naming the joint for a coefficient out of its range, ShapeError.

        >>> import spatialdyn as sd
        >>> builder = sd.ModelBuilder("arm").add_body("rod", None, "revolute", (0, 0, 1), friction=0.2, damping=0.1)
        >>> model = builder.build()
        >>> sd.Friction.of(model, smoothing=0.01)
        <Friction of each freedom: coulomb [0.2], viscous [0.1], static [0.2], smoothing [0.01]>
        """
        coulomb, viscous = check_model(model).friction.copy(), model.damping.copy()
        sources = {x.name: x for x in model.robot.joints}
        for joint in model.joints[1:]:
            if joint.mimic is not None:
                ratio, source = joint.mimic[1], sources[joint.name]
                coulomb[joint.idx_v] += abs(ratio) * source.friction
                viscous[joint.idx_v] += ratio * ratio * source.damping
        given: dict[str, Any] = {"coulomb": coulomb, "viscous": viscous, **changes}
        for name, value in given.items():
            read = None if value is None else _read(name, value)
            if isinstance(read, np.ndarray) and read.shape in ((), (model.nv,)):
                each = np.broadcast_to(read, model.nv)
                _refuse_values(name, each, model)  # the constructor knows no names of joints
        return cls(**given).check(model)

    @property
    def law(self) -> tuple[Array, Array, Array, Array]:
        """F_c, b, F_s and v_s for the recursions."""
        fall = np.full(len(self.coulomb), AT_ONCE) if self.stribeck_velocity is None else self.stribeck_velocity
        return self.coulomb, self.viscous, self.static, fall

    def check(self, model: Model) -> Friction:
        """This friction with a number for each freedom of the model. Raises ShapeError, ModelError naming the joint."""
        n = check_model(model).nv
        sizes = [len(x) for _, x in self._given() if not isinstance(x, dict)]
        if any(size not in (1, n) for size in sizes):
            raise ShapeError(f'friction has {max(sizes)} freedoms, expected the {n} of robot "{model.name}"')
        if len(sizes) == len(self._given()) and max(sizes) == n:
            whole = self
        else:
            whole = object.__new__(Friction)
            for x in fields(self):
                value = _of_freedoms(model, x.name, getattr(self, x.name))
                object.__setattr__(whole, x.name, value)
        whole._refuse_static(model)
        return whole

    def _refuse_static(self, model: Model | None) -> None:
        """Raise ModelError for a static friction below Coulomb's, with the joint's name if there is a model."""
        bad = self.static < self.coulomb
        if bad.any():
            k = int(np.argmax(bad))
            where = "" if model is None else f' of joint "{joint_of_velocity(model, k).name}"'
            least = f"at least its Coulomb friction of {self.coulomb[k]:g}"
            raise ModelError(f"friction{where}: static is {self.static[k]:g}, expected {least}")

    def _given(self) -> list[tuple[str, Any]]:
        """Names and values of the given coefficients."""
        return [(x.name, getattr(self, x.name)) for x in fields(self) if getattr(self, x.name) is not None]

    def _content(self) -> tuple[tuple[str, Any], ...]:
        return tuple(
            (name, tuple(sorted(x.items())) if isinstance(x, dict) else (x + 0.0).tobytes())
            for name, x in self._given()
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Friction) and self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def __reduce__(self) -> tuple[Callable[..., Friction], tuple[Any, ...]]:
        return Friction, tuple(getattr(self, x.name) for x in fields(self))

    def __repr__(self) -> str:
        shown = [
            f"{name} {x if isinstance(x, dict) else np.array2string(x, separator=', ', threshold=8)}"
            for name, x in self._given()
        ]
        n = max((len(x) for _, x in self._given() if not isinstance(x, dict)), default=1)
        of = "each freedom" if n == 1 else f"{n} freedoms"
        return f"<Friction of {of}: {', '.join(shown)}>"


def _read(name: str, value: Any) -> Any:
    """A coefficient as an array, or as a dict of numbers by joint. Raises ModelError, ShapeError."""
    if not isinstance(value, Mapping):
        return as_array(name, value)
    for joint, x in value.items():
        if not isinstance(joint, str) or (math.isnan(as_number(x)) and not isinstance(x, (float, np.floating))):
            raise ModelError(
                f"friction has {name} {literal(joint)}: {literal(x)}, expected the name of a joint and a number"
            )
    return {joint: float(x) for joint, x in value.items()}


def _refuse_values(name: str, values: Any, model: Model | None = None) -> None:
    """Raise ModelError for a value out of the coefficient's range, naming its joint, or its index without a model."""
    least, expected = (0.0, "a finite number above 0") if name in POSITIVE else (None, "a finite number of 0 or more")
    places = values.items() if isinstance(values, dict) else enumerate(values.tolist())
    for where, x in places:
        if not (x >= 0.0 and x != least and math.isfinite(x)):
            if model is not None and not isinstance(where, str):
                where = joint_of_velocity(model, where).name
            of = f' of joint "{where}"' if isinstance(where, str) else f" of freedom {where}" if len(values) > 1 else ""
            raise ModelError(f"friction{of}: {name.replace('_', ' ')} is {x:g}, expected {expected}")


def _of_freedoms(model: Model, name: str, value: Any) -> Array | None:
    """A coefficient (nv,), read-only. Raises ModelError for an unknown joint, or a joint that is missing."""
    if value is None:
        return None
    if isinstance(value, dict):
        made = np.zeros(model.nv)
        for joint, x in value.items():
            found = model.joint(joint)
            if found.nv == 0 or found.mimic is not None:
                raise ModelError(f'friction has {name} of joint "{joint}", expected a joint with velocities of its own')
            made[found.idx_v : found.idx_v + found.nv] = x
        if name in POSITIVE and not made.all():
            joint = joint_of_velocity(model, int(np.argmin(made != 0.0))).name
            raise ModelError(f'friction has no {name} of joint "{joint}", expected one of every joint, or one number')
    else:
        made = np.array(np.broadcast_to(value, model.nv))
    made.flags.writeable = False
    return made


def check_friction(model: Model, friction: Any) -> Friction:
    """The Friction of an argument, checked for the model; for True the URDF's. Raises ModelError, ShapeError."""
    if isinstance(friction, (bool, np.bool_)) and friction:
        return Friction.of(model)
    if not isinstance(friction, Friction):
        raise ModelError(f"friction is {literal(friction)}, expected a Friction, or True for that of the URDF")
    return friction.check(model)


def friction_torque(model: Model, v: ArrayLike, friction: Friction | bool, out: Any = None) -> Array:
    """Friction torques τ = -F(v) sgn v - b v of joints that move, F(v) = F_c + (F_s - F_c) exp(-(v/v_s)²).

    Source: Armstrong-Hélouvry, Dupont, Canudas de Wit, A survey of models, analysis tools and compensation methods for
    the control of machines with friction (1994), for F(v).

    model     Model
    v         (..., nv)  joint velocities [rad/s | m/s]
    friction  Friction, or True for that of the URDF; with ``smoothing`` ε its sign is tanh(v/ε)
    out       (..., nv)  written in place if given: float64, C order, the shape of the result

    At rest, without smoothing, the dry part is 0 here, because the friction that keeps a joint at rest depends on all
    other torques; ``simulate`` and ``rollout`` compute it.

    Returns friction (..., nv): torques to add to those of the motors [N m | N].
    Raises
        ShapeError for shapes that do not match, or an out that overlaps an input
        ModelError naming the joint with a coefficient out of its range
        NaN in a sample gives NaN in what depends on it, in no other sample.

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> sd.friction_torque(model, [0.5, -2.0], sd.Friction([1.0, 1.0], [0.1, 0.1]))
    array([-1.05,  1.2 ])
    """
    x = check_friction(check_model(model), friction)
    made: Array = checked_call(FRICTION_TORQUE, model, (v, *x.law, x.smoothing), (), out)
    return made


def friction_regressor(model: Model, v: ArrayLike, out: Any = None) -> Array:
    """Regressor F of joint friction: motors must add F (F_c, b) = F_c sgn v + b v to the inverse dynamics.

    Source: the definition; it extends the columns of ``joint_torque_regressor`` to friction.

    model  Model
    v      (..., nv)  joint velocities [rad/s | m/s]
    out    (..., nv, 2, nv)  written in place if given: float64, C order, the shape of the result

    Flattened, F extends Y: (Y, F) (π, F_c, b) = rnea - armature a + the friction that motors overcome, as in the
    example. A joint at rest has 0 for Coulomb's friction, which is not a function of v there.

    Returns F (..., nv, 2, nv): derivatives of each joint's torque by F_c (sgn v) and b (v) of each joint
            [1 | rad/s | m/s].
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

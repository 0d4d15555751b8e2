"""``Scene``: a robot and what acts on it, checked when it is made; simulations, steps and derivatives take it."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Collection
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..actuation.friction import Friction, check_friction
from ..actuation.motors import Motor, check_motor
from ..calls.arguments import as_array, as_flag, as_word, check_model
from ..constraints.contact_points import Contacts, check_contacts
from ..constraints.dynamics import stabilization_time
from ..constraints.table import Constraints, check_constraints
from ..errors import NonFiniteError, ShapeError, SimulationError, literal
from ..model.model import Model
from ..model.motion_limits import position_limits
from .effects.effect import Effect
from .effects.friction import IMPLICIT, STEPPED, friction_effects
from .effects.motor import CURRENT
from .effects.springs import spring_effects
from .methods.constrained_symplectic import UNDER, unfit
from .methods.methods import EXPLICIT_METHODS, SCIPY_METHODS, integrators

Array = NDArray[np.float64]
P = ParamSpec("P")
T = TypeVar("T")
EFFECTS = ("constraints", "contacts", "friction", "limits", "motor", "fext")  # the other options say how these act
FIELDS = (
    "model", "constraints", "stabilization", "contacts", "friction", "friction_method", "limits", "motor", "drive",
    "fext",
)  # fmt: skip

SYMPLECTIC = tuple(UNDER)  # symplectic methods that take constraints
DEFAULTS = {"stabilization": None, "friction_method": IMPLICIT, "limits": False, "drive": CURRENT, "fext": None}


class Scene:
    """A robot and what acts on it: immutable, hashed by content; conflicts are refused when it is made.

    model            Model
    constraints      Constraints of this model: loops, held points, rolling
    stabilization    T [s]: errors of the constraints decay like exp(-t/T). None: each step ends with a projection onto
                     the constraints, one Newton step of q, then the nearest v, in the metric of M. With implicit
                     friction, contacts or limits v is not projected: that would move joints that stick
    contacts         Contacts of this model: points that touch the ground, with Coulomb's exact cone
    friction         friction and damping of the joints: True for that of the URDF, or a ``Friction``. None: no
                     friction, and a run warns if the URDF has some; False: no friction
    friction_method  "implicit": Coulomb's law and damping hold at the end of a step, at any dt; a joint that sticks has
                     a velocity of exactly 0. "lugre": LuGre's bristles, a state of the run. "smooth": a torque
                     -F(v) tanh(v/smoothing) - viscous v, by any method; nothing sticks
    limits           whether joints of one coordinate stop at their position limits
    motor, drive     Motor through which the torques of a run act, with implicit friction. "current": a torque is the n
                     k_t i of a commanded current, within the motor's limits. "voltage": a torque is the n k_t u / R of
                     a voltage u; it acts in full at rest, and in motion the back EMF reduces it
    fext             (njoints, 6)  constant force on each joint's body, in the joint's frame [N | N m]

    Springs of series-elastic joints (``ModelBuilder.add_series_elastic``) always act. Wherever a Scene is expected, a
    Model stands for a scene on which nothing else acts.

    methods          names of the ``integrators`` that can step it
    method           the default method of a run: rk4, or semi_implicit_euler if impulses act

    Raises  SimulationError for options that contradict each other; ModelError, ConstraintError and ShapeError for
            options of another robot or out of range

    >>> import spatialdyn as sd
    >>> model = sd.load_urdf("two_link")
    >>> scene = sd.Scene(model, friction=sd.Friction(viscous=0.1), limits=True)
    >>> scene.method, scene.with_(limits=False, friction=None) == sd.Scene(model)
    ('semi_implicit_euler', True)
    """

    __slots__ = (*FIELDS, "effects", "_plans")
    model: Model
    constraints: Constraints | None
    stabilization: float | None
    contacts: Contacts | None
    friction: Friction | bool | None
    friction_method: str
    limits: bool
    motor: Motor | None
    drive: str
    fext: Array | None
    effects: tuple[Effect, ...]  # of friction, motor and springs: not part of the content, like the fields below
    _plans: dict[Any, Any]  # plans of its runs: see ``plan``

    def __init__(
        self,
        model: Model,
        *,
        constraints: Constraints | None = None,
        stabilization: float | None = None,
        contacts: Contacts | None = None,
        friction: Friction | bool | None = None,
        friction_method: str = IMPLICIT,
        limits: bool = False,
        motor: Motor | None = None,
        drive: str = CURRENT,
        fext: ArrayLike | None = None,
    ) -> None:
        """See the class."""
        check_model(model)
        if constraints is not None:
            check_constraints(model, constraints)
        if stabilization is not None:
            if constraints is None:
                raise SimulationError(
                    f"stabilization is {literal(stabilization)}, expected None: no constraints are given"
                )
            stabilization = stabilization_time(stabilization)
        if contacts is not None:
            check_contacts(model, contacts)
        if as_flag("limits", limits):
            position_limits(model)
        effects = *friction_effects(model, friction, friction_method, motor, drive), *spring_effects(model)
        given: dict[str, Any] = {
            "model": model, "constraints": constraints, "stabilization": stabilization, "contacts": contacts,
            "friction": _friction(model, friction), "friction_method": friction_method,
            "limits": as_flag("limits", limits), "motor": None if motor is None else check_motor(model, motor),
            "drive": drive, "fext": None if fext is None else _forces(model, fext),
        }  # fmt: skip
        for name, value in {**given, "effects": effects, "_plans": {}}.items():
            object.__setattr__(self, name, value)

    @classmethod
    def of(cls, model: Model) -> Scene:
        """The scene with everything that the robot's file declares: damping, friction, position limits, mimic joints.

        Mimic joints that the model does not move with their leaders (``mimic=False``) become ``CouplerConstraint``.
        MJCF (``sd.load``) also gives its loops, the contacts of feet with its ground, and its DC motors. Loops and
        contacts on frames that ``Model.reduced`` has fixed to the world are left out.

        >>> import spatialdyn as sd
        >>> builder = sd.ModelBuilder("arm").add_body("rod", None, "revolute", (0, 0, 1), damping=0.1)
        >>> sd.Scene.of(builder.build()).friction
        <Friction of each freedom: coulomb [0.], viscous [0.1], static [0.]>
        """
        from ..sources import declared_scene

        model = model.model if isinstance(model, Scene) else check_model(model)  # the same object, not an equal one
        return cls(model, **declared_scene.options_of(model))

    @classmethod
    def from_toml(cls, model: Model, text: str) -> Scene:
        """The scene of a TOML text, such as a file beside the URDF: the constructor's options by name.

        ``friction`` is true, false or a table of ``Friction``'s coefficients; ``[motor]`` has those of ``Motor``,
        ``[contacts]`` points, friction, restitution, tolerance, steps, rounds, and ``[contacts.terrain]`` with kind
        "plane" or "heightfield"; ``[[constraint]]`` entries are those of ``Constraints.of_toml``.

        Raises  SimulationError naming the key for any other text; SpatialDynError before Python 3.11, which cannot read
                TOML; otherwise as the class

        >>> import spatialdyn as sd
        >>> model = sd.load_urdf("two_link")
        >>> scene = sd.Scene.from_toml(model, 'limits = true\\n[contacts]\\npoints = {tip = 0.02}')
        >>> scene.acts, sd.Scene.from_toml(model, scene.to_toml()) == scene
        (('contacts', 'limits'), True)
        """
        from ..sources import scene_toml

        return cls(scene_of(model).model, **scene_toml.read(model, text))

    def to_toml(self) -> str:
        """The scene, without its model, as a TOML text, which ``from_toml`` reads to the same bits."""
        from ..sources import scene_toml

        return scene_toml.write(self._given(), DEFAULTS)

    def with_(self, **changes: Any) -> Scene:
        """This scene with other options, by the names of the constructor; None or False removes an effect.

        Removing an effect also removes the options that say how it acts. Raises SimulationError for an unknown name.
        """
        unknown = [name for name in changes if name not in FIELDS]
        if unknown:
            raise SimulationError(f"a scene has no {unknown[0]}, expected some of {', '.join(FIELDS)}")
        given = {**self._given(), **changes}
        if given["constraints"] is None and "stabilization" not in changes:
            given["stabilization"] = None
        if given["motor"] is None and "drive" not in changes:
            given["drive"] = CURRENT
        if given["motor"] is None and given["friction"] is None and "friction_method" not in changes:
            given["friction_method"] = IMPLICIT
        return Scene(**given)

    @property
    def acts(self) -> tuple[str, ...]:
        """Names of the effects that act: some of ``EFFECTS``, and "springs"."""
        names = [name for name in EFFECTS if getattr(self, name) is not None and getattr(self, name) is not False]
        return (*names, *(x.name for x in self.effects if x.name == "springs"))

    @property
    def unilateral(self) -> Contacts:
        """The effects that act in one direction: contacts, possibly without points, and joint limits if they act."""
        given = Contacts(self.model, {}) if self.contacts is None else self.contacts
        return given.with_limits() if self.limits else given

    @property
    def solves(self) -> bool:
        """Whether a step finds velocities and impulses together: contacts, limits, dry friction, motors."""
        return self.contacts is not None or self.limits or any(x.solves for x in self.effects)

    @property
    def methods(self) -> tuple[str, ...]:
        """Names of the methods that can step the scene."""
        if self.solves:
            return (STEPPED,)
        if self.constraints is None:
            return tuple(integrators)
        adaptive = () if self.stabilization is None else SCIPY_METHODS  # which end no step with a projection
        return (*EXPLICIT_METHODS, *(x for x in SYMPLECTIC if not self.unfit(x)), *adaptive)

    def unfit(self, method: str) -> str:
        """Why a symplectic method cannot take the constraints; "" if it can."""
        if self.constraints is None or method not in SYMPLECTIC:
            return ""
        return unfit(self.model, self.constraints, self.stabilization, method)

    @property
    def method(self) -> str:
        """The default method of a run."""
        return STEPPED if self.solves else "rk4"

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a Scene is immutable, {name} cannot be set; with_({name}=...) makes another")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a Scene is immutable, {name} cannot be deleted")

    def _given(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in FIELDS}

    def _content(self) -> tuple[Any, ...]:
        forces = None if self.fext is None else (self.fext + 0.0).tobytes()
        return tuple(forces if name == "fext" else getattr(self, name) for name in FIELDS)

    def __eq__(self, other: object) -> bool:
        return self is other or (isinstance(other, Scene) and self._content() == other._content())

    def __hash__(self) -> int:
        return hash(self._content())

    def __reduce__(self) -> tuple[Callable[..., Scene], tuple[Any, ...]]:
        return functools.partial(Scene, **self._given()), ()

    def __str__(self) -> str:
        from .scene_text import described

        return described(self, DEFAULTS)

    def __repr__(self) -> str:
        return f"<Scene of {self.model.name}: {', '.join(self.acts) or 'nothing acts'}>"


def scene_of(given: Any) -> Scene:
    """A Scene unchanged, or the scene of a Model on which nothing else acts. Raises ModelError."""
    if isinstance(given, Scene):
        return given
    bare = _bare(check_model(given))
    return bare if bare.model is given else Scene(given)  # equal models may come from two files


@functools.lru_cache(maxsize=64)
def _bare(model: Model) -> Scene:
    return Scene(model)


def _friction(model: Model, friction: Any) -> Friction | bool | None:
    """The friction that the scene keeps: for True that of the URDF."""
    if friction is None or (isinstance(friction, (bool, np.bool_)) and not friction):
        return None if friction is None else False
    return check_friction(model, friction)


def _forces(model: Model, fext: ArrayLike) -> Array:
    """A read-only copy of constant forces. Raises ShapeError, NonFiniteError."""
    x = as_array("fext", fext)
    if x.shape != (model.njoints, 6):
        what = "; forces that vary with steps or samples are an argument of the run" if x.ndim > 2 else ""
        raise ShapeError(f"fext has shape {x.shape}, expected {(model.njoints, 6)}{what}")
    if not np.isfinite(x).all():
        raise NonFiniteError(f"fext is {x.tolist()}, expected finite numbers")
    kept = np.array(x, order="C")
    kept.flags.writeable = False
    return kept


# --- arguments of a run ----------------------------------------------------------------------------------


def effects_in_scene(call: str) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """A decorator: an effect passed as an argument of the call is an error, which shows the line to write instead."""

    def wrap(function: Callable[P, T]) -> Callable[P, T]:
        known = function.__code__.co_varnames[: function.__code__.co_argcount + function.__code__.co_kwonlyargcount]

        @functools.wraps(function)
        def named(*args: P.args, **kwargs: P.kwargs) -> T:
            if "pd" in kwargs and "pd" not in known:
                raise SimulationError(f"pd is given, expected sd.{call}(..., control=sd.PD(kp, kd, q_ref, v_ref))")
            moved = [name for name in kwargs if name not in known and name in (*FIELDS[1:], "record_contacts")]
            if moved:
                raise SimulationError(_moved(call, moved))
            return function(*args, **kwargs)

        return named

    return wrap


def _moved(call: str, names: list[str]) -> str:
    """The message that effects belong to the scene, with the line to write."""
    if names == ["record_contacts"]:
        return f'record_contacts is given, expected sd.{call}(..., record="contacts")'
    options = ", ".join(f"{name}={name}" for name in names if name != "record_contacts")
    more = ', record="contacts"' if "record_contacts" in names else ""
    acts = "is an option" if len(names) == 1 else "are options"
    return f"{', '.join(names)} {acts} of the scene, expected sd.{call}(sd.Scene(model, {options}), ...{more})"


def check_method(scene: Scene, method: Any, known: Collection[str]) -> str:
    """The method of a run, one that a call knows. Raises SpatialDynError, SimulationError with the possible methods."""
    name, fit = as_word("method", method, known), scene.methods
    if name not in fit:
        if not scene.solves and (reason := scene.unfit(name)):
            raise SimulationError(reason)
        acts, why = list(scene.acts), "; impulses and velocities are found together" if scene.solves else ""
        plural = len(acts) > 1 or acts[0].endswith("s")
        listed = f"{', '.join(acts)} act{'' if plural else 's'}"
        several = "one of " * (len(fit) > 1)
        raise SimulationError(f'method is "{name}" and {listed}, expected {several}{", ".join(fit)}{why}')
    return name


def warn_of_friction(scene: Scene, call: str) -> None:
    """Warn of joint damping and friction in the file that do not act because the scene has no ``friction`` option."""
    model = scene.model
    if scene.friction is None and (model.damping.any() or model.friction.any()):
        text = f'robot "{model.name}" has joint damping or friction, which {call} ignores unless friction=True'
        warnings.warn(f"{text}: sd.Scene(model, friction=True), or False", stacklevel=4)

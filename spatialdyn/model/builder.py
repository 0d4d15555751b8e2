"""``ModelBuilder``: a robot built by calls."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, ParamSpec, TypeVar

from numpy.typing import ArrayLike

from ..bodies.kinds import kind_of
from ..errors import ModelError, literal
from .model import Model, assemble
from .robot import JointLimits, Link, Mimic, Robot, RobotJoint, Rotor, Spring
from .robot_checks import check_inertias, check_tree, floats, make_joint, make_link, pose_matrix

P = ParamSpec("P")
T = TypeVar("T")


def _bounds_in_limits(call: Callable[P, T]) -> Callable[P, T]:
    """``add_body``, which refuses what is a field of its limits by the line to write."""

    @functools.wraps(call)
    def named(*args: P.args, **kwargs: P.kwargs) -> T:
        given = [f"{name}={kwargs[name]!r}" for name in ("velocity", "effort") if name in kwargs]
        if given:
            pair = kwargs.get("limits", ())
            first = [repr(x) for x in pair] if isinstance(pair, (tuple, list)) else []
            raise ModelError(f"{', '.join(given)} is given, expected limits=sd.JointLimits({', '.join(first + given)})")
        return call(*args, **kwargs)

    return named


class ModelBuilder:
    """Builds a robot by calls; its Model equals that of a URDF of the same robot.

    >>> b = ModelBuilder("pendulum")
    >>> _ = b.add_body("rod", joint="revolute", axis=(0, 1, 0), inertia=(1.0, (0, 0, -0.5), np.diag([1/12, 1/12, 0])))
    >>> b.build().nv
    1
    """

    def __init__(self, name: str = "robot", root: str = "base") -> None:
        """A robot of one link, the root, without inertia until ``set_inertia``."""
        _check_text("name of the robot", name)
        _check_text("root", root)
        self.name = name
        self._links: dict[str, Link] = {root: Link(root)}
        self._joints: list[RobotJoint] = []
        self._root = root

    def set_inertia(self, link: str, inertia: tuple[float, ArrayLike, ArrayLike]) -> ModelBuilder:
        """Give a link its inertia: (mass [kg], com (3,) [m], rotational inertia (3, 3) about the com [kg m²])."""
        if not isinstance(link, str) or link not in self._links:
            shown = f'"{link}"' if isinstance(link, str) else literal(link)
            raise ModelError(f'link {shown} is not in robot "{self.name}"')
        self._links[link] = make_link(link, inertia)
        return self

    @_bounds_in_limits
    def add_body(
        self,
        name: str,
        parent: str | None = None,
        joint: str = "revolute",
        axis: ArrayLike = (0.0, 0.0, 1.0),
        placement: Any = None,
        inertia: tuple[float, ArrayLike, ArrayLike] | None = None,
        joint_name: str | None = None,
        limits: JointLimits | tuple[float, float] = (-math.inf, math.inf),
        *,
        damping: float = 0.0,
        friction: float = 0.0,
        armature: float = 0.0,
        mimic: Mimic | Mapping[str, Any] | None = None,
        pitch: float = 0.0,
        rotor: Rotor | None = None,
    ) -> ModelBuilder:
        """Add a link and the joint that connects it to its parent; returns the builder.

        parent      parent link, by default the root
        joint       one of fixed, revolute, continuous, prismatic, spherical, floating, planar, helical
        axis        (3,) in the joint's frame, any length but 0
        placement   of the joint in the parent: xyz (3,) [m], a pair (xyz, rpy [rad]) or a pose (4, 4)
        inertia     (mass [kg], com (3,) [m], rotational inertia (3, 3) about the com [kg m²]), in the link's frame
        joint_name  by default ``name + "_joint"``
        limits      JointLimits, or the lower and the upper position alone [rad | m]
        damping     viscous coefficient [N m s/rad | N s/m];  friction  dry friction [N m | N]
        armature    rotor inertia of every freedom [kg m² | kg], added to the diagonal of M; see ``RobotJoint``
        mimic       Mimic, or a mapping with its fields
        pitch       of a helical joint: travel along its axis per radian [m/rad], of either sign
        rotor       of a joint of one freedom: the motor's rotor, in place of an armature

        Raises ModelError, InertiaError naming the link or joint and the value.
        """
        parent = self._root if parent is None else parent
        _check_text("name of a link", name)
        joint_name = f"{name}_joint" if joint_name is None else joint_name
        for what, given in {"name": name, "parent": parent, "joint": joint, "joint_name": joint_name}.items():
            _check_text(f'{what} of link "{name}"', given)
        if parent not in self._links:
            raise ModelError(f'link "{name}" has parent "{parent}", which robot "{self.name}" does not have')
        if name in self._links:
            raise ModelError(f'robot "{self.name}" has two links named "{name}", expected distinct names')
        what = f'joint "{joint_name}"'
        bounds = limits if isinstance(limits, JointLimits) else JointLimits(*floats(limits, 2, f"{what} has limits"))
        placed = pose_matrix(placement, f"placement of {what}").ravel().tolist()
        scalars = {
            "lower": bounds.lower,
            "upper": bounds.upper,
            "velocity": bounds.velocity,
            "effort": bounds.effort,
            "damping": damping,
            "friction": friction,
            "armature": armature,
            "pitch": pitch,
        }
        values: dict[str, Any] = {label: floats(value, 1, f"{what} has {label}")[0] for label, value in scalars.items()}
        along = floats(axis, 3, f"{what} has axis")
        made = make_joint(
            RobotJoint(
                joint_name,
                joint,
                parent,
                name,
                tuple(placed),
                along,
                mimic=_mimic(mimic, what),
                rotor=rotor,
                **values,
            )
        )
        self._links[name] = Link(name) if inertia is None else make_link(name, inertia)
        self._joints.append(made)
        return self

    def add_series_elastic(
        self,
        joint: str,
        stiffness: float,
        damping: float = 0.0,
        rotor: float = 0.0,
        ratio: float = 1.0,
        axis: ArrayLike | None = None,
    ) -> ModelBuilder:
        """Drive a joint through a spring by a rotor that is a freedom of its own; returns the builder.

        joint      name of a joint of one coordinate that the builder has
        stiffness  k of the spring, at the joint [N m/rad | N/m]
        damping    d of the spring, at the joint [N m s/rad | N s/m]
        rotor      inertia J of the rotor about its axis [kg m²]
        ratio      n of the gear before the spring: turns of the rotor per unit of the joint [1 | rad/m]
        axis       (3,) of the rotor in the joint's frame at q = 0; the joint's own if left out

        The rotor is a revolute joint called ``joint + "_rotor"``, at θ, on the joint's parent link. That link has to
        include the rotor's mass, and its inertia as if locked, as with every ``Rotor``. The motor's torque is the
        torque of the rotor's freedom. The spring gives k (θ/n - q) + d (θ̇/n - q̇) to the joint (``spring_torque``);
        ``simulate`` and ``rollout`` add it, the calls of the equation of motion take it in tau.

        Source: after Spong, Modeling and control of elastic joint robots (1987), with the rotor's momentum exact.

        Raises ModelError naming the joint and the value, also for a rotor without inertia, which has no motion of its
        own: for a rigid joint use an armature.
        """
        _check_text("joint", joint)
        driven = next((j for j in self._joints if j.name == joint), None)
        if driven is None:
            raise ModelError(f'joint "{joint}" is not in robot "{self.name}"')
        what = f'joint "{joint}"'
        given = {"stiffness": stiffness, "damping": damping, "rotor": rotor, "ratio": ratio}
        values = {label: floats(value, 1, f"{what} has {label}")[0] for label, value in given.items()}
        if driven.kind == "fixed" or kind_of(driven.kind).nq != 1:
            raise ModelError(f"{what} is {driven.kind}, expected one of one coordinate to drive by a spring")
        J = values.pop("rotor")
        if not (J > 0.0 and math.isfinite(J)):
            raise ModelError(
                f"{what} has a rotor of inertia {J} behind a spring, expected a finite number above 0; a joint without "
                "a spring has it as its armature"
            )
        name = f"{joint}_rotor"
        if name in self._links:
            raise ModelError(f'robot "{self.name}" has two links named "{name}", expected distinct names')
        along = driven.axis if axis is None else floats(axis, 3, f"rotor of {what} has axis")
        self._joints.append(
            make_joint(
                RobotJoint(
                    name,
                    "revolute",
                    driven.parent,
                    name,
                    driven.placement,
                    along,
                    rotor=Rotor(J, 1.0),
                    spring=Spring(joint, **values),
                )
            )
        )
        self._links[name] = Link(name)
        return self

    def robot(self, inertia: str = "warn") -> Robot:
        """The checked robot; ``inertia`` is the policy on inertias that are not physical: warn, strict or repair."""
        return check_inertias(
            check_tree(self.name, tuple(self._links.values()), tuple(self._joints)),
            inertia,
            stacklevel=4,
        )

    def build(self, inertia: str = "warn", **options: Any) -> Model:
        """The Model; ``options`` are those of ``load_urdf``: root, gravity, continuous, mimic."""
        return assemble(self.robot(inertia), **options)


def _check_text(what: str, given: Any) -> None:
    if not isinstance(given, str):
        raise ModelError(f"{what} is {literal(given)}, expected text")


def _mimic(given: Any, what: str) -> Mimic | None:
    if given is None or isinstance(given, Mimic):
        return given
    try:
        return Mimic(**given)
    except TypeError as error:
        raise ModelError(f"{what} has mimic {literal(given)}, expected leader, multiplier and offset") from error

"""The errors of the library: one base class, a subclass where a caller would catch it; and how to install an extra."""

from __future__ import annotations

from typing import Any

EXTRAS: dict[str, tuple[str, ...]] = {  # the packages of each extra of pyproject.toml, but those of the tests
    "rich": ("rich",),
    "validate": ("pin", "example-robot-data"),
    "symbolic": ("sympy",),
    "exact": ("mpmath",),
    "simulation": ("scipy",),
    "plot": ("matplotlib",),
    "casadi": ("casadi",),
    "jax": ("jax",),
    "torch": ("torch",),
    "view": ("viser", "pycollada"),
    "collision": ("coal",),
    "meshcat": ("meshcat",),
    "mujoco": ("mujoco",),
    "ros": ("xacrodoc",),
    "descriptions": ("robot_descriptions",),
    "identification": ("cvxpy", "clarabel"),
    "wbc": ("qpsolvers", "daqp"),
    "cluster": ("dask", "distributed"),
    "cuda": ("cuda-bindings",),
    "docs": ("sphinx", "myst-parser", "furo"),
}


def pip_install(extra: str) -> str:
    """The command that installs the packages of an extra, for messages: it works wherever this library came from."""
    return " ".join(["pip install", *EXTRAS[extra]])


def literal(value: object) -> str:
    """The value as messages show it: its ``repr``, or its type where that raises, as of an int of 4301 digits."""
    try:
        return repr(value)
    except Exception:  # of any class of the caller's
        return f"<{type(value).__name__} that cannot be printed>"


class SpatialDynError(ValueError):
    """Base of every error on bad input; the message names the thing, its value and what was expected."""


class UrdfError(SpatialDynError):
    """A robot description that cannot be read; the message names file, line, element and attribute."""


class ModelError(SpatialDynError):
    """Links and joints that do not form a robot, or a name that is not in the robot."""


class InertiaError(SpatialDynError):
    """An inertia that no body can have, or a joint whose articulated inertia is zero."""


class ShapeError(SpatialDynError):
    """An array of the wrong shape or dtype."""


class ConfigurationError(SpatialDynError):
    """A quaternion or (cos, sin) pair that is not of unit norm; ``sd.normalize`` is the cure."""


class ConstraintError(SpatialDynError):
    """Constraints that do not determine their forces, or a parameter of a contact that is out of range."""


class IdentificationError(SpatialDynError):
    """A recording that does not tell what is asked of it; what it tells is the message's table."""


class NonFiniteError(SpatialDynError):
    """A result that is not finite, from finite input."""


class SimulationError(SpatialDynError):
    """A simulation that cannot go on; its ``trajectory`` is what was recorded so far, None if nothing was."""

    trajectory: Any = None


class StudyError(SpatialDynError):
    """A study that cannot be what was asked: its arguments, its folder, what its function returns, its workers."""


class SimulationInterrupt(KeyboardInterrupt):
    """Ctrl-C during a simulation; its ``trajectory`` is what was recorded so far.

    It is a KeyboardInterrupt, so it ends a loop around simulations as any Ctrl-C does, unless the loop catches it.
    """

    trajectory: Any = None

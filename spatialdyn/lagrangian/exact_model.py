"""A robot in exact numbers: its decimals as fractions, its angles as fractions of π, its parameters as symbols.

A Robot holds floats. A float read from a file is the double nearest to its text, and the shortest decimal that rounds
to the same double is that text. Rotations and rotated inertias are computed, so the Reader looks for their origin:
roll, pitch and yaw that are a fraction of π to ten digits, an axis in whole numbers, entries of at most twelve digits.
``assumptions`` lists the floats that it replaces by another number.

The steps that make a Model (``assembly.walk``, ``joint_rows.put_joint``) process the exact robot, on Numbers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..algebra.euclidean import Mat3, Sym, Vec, matmul, rotate, scale
from ..algebra.records import put_inertia, put_vec
from ..algebra.rotations import turn
from ..algebra.spatial import Inertia, Pose
from ..engines.numbers.symbolic import Number, Ring, need_sympy
from ..engines.programs.record.parameters import body, point
from ..engines.programs.record.tracer import Row, table
from ..errors import ModelError
from ..model.assembly import walk
from ..model.joint_rows import put_joint, subspace
from ..model.model import Model
from ..model.robot import WITH_AXIS
from ..model.robot_checks import rpy_of

Expr = Any  # sympy.Expr
STEPS = 360  # per π: an angle within ANGLE of a multiple of half a degree is replaced by this multiple
ANGLE = 1e-10  # rad: rounding to ten digits
COMPUTED = 1e-14  # relative: above the rounding of a product of rotations
DIGITS = 12  # a decimal with at most this many digits, within COMPUTED of a number, counts as its origin
WHOLE = 1000  # largest whole number in an axis such as (1, 2, 2)


@dataclass
class ExactRobot:
    """A robot in Numbers of one Ring.

    ring         ring of constants: rationals, radicals, sines and cosines of angles that are not fractions of π
    moving       (kind, axis, pitch, pose in the parent's body) of each joint, without the world
    rotors       {index of a joint: (ratio, axis in the joint's frame) of its rotor}
    couplings    {index of a joint: inertia that it shares with the joint before it}
    values       by name: mass ``m_1``, com ``c_1x``, inertia about it ``I_1xx``, origin of the joint in the body that
                 carries it ``l_1x``, armature ``J_1``, for joint 1's body with all that is fixed to it; ``g_x`` ...
    frames       "kind:name" -> pose in the body of its joint
    assumptions  floats replaced by other numbers, in words
    """

    ring: Ring
    moving: list[tuple[str, tuple[Any, ...], Any, Pose]]
    rotors: dict[int, tuple[Any, tuple[Any, ...]]]
    couplings: dict[int, Any]
    values: dict[str, Number]
    frames: dict[str, Pose]
    assumptions: list[str]


class Reader:
    """Reads floats as exact expressions; ``notes`` lists floats replaced by other numbers."""

    def __init__(self) -> None:
        """Nothing read yet."""
        self.sympy = need_sympy()
        self.notes: list[str] = []

    def decimal(self, x: float) -> Expr:
        """The shortest decimal of a float, as a fraction."""
        return self.sympy.Rational(repr(float(x)))

    def angle(self, x: float, where: str) -> Expr:
        """A fraction of π if the angle equals one to ten digits, else a decimal."""
        steps = round(x * STEPS / math.pi)
        if abs(x - steps * math.pi / STEPS) <= ANGLE * max(1.0, abs(x)):
            found = self.sympy.Rational(steps, STEPS) * self.sympy.pi
            if steps:
                self.notes.append(f"{where}: angle {x:.13g} rad is taken for {found}")
            return found
        return self.decimal(_short(x, COMPUTED * max(1.0, abs(x))))

    def axis(self, u: Sequence[float], where: str) -> list[Expr]:
        """Whole numbers over their norm if the axis has this form, else decimals."""
        largest = max(map(abs, u))
        whole = [Fraction(x / largest).limit_denominator(WHOLE) for x in u]
        if all(abs(float(w) - x / largest) <= COMPUTED for w, x in zip(whole, u, strict=True)):
            common = math.lcm(*(w.denominator for w in whole))
            n = [int(w * common) for w in whole]
            if sum(k * k for k in n) <= 3 * WHOLE * WHOLE:
                if sum(map(bool, n)) > 1:
                    self.notes.append(f"{where}: axis is taken for {tuple(n)} made a unit vector")
                return [k / self.sympy.sqrt(sum(k * k for k in n)) for k in n]
        self.notes.append(f"{where}: axis is taken as the decimals {tuple(u)}, a unit vector to rounding only")
        return [self.decimal(x) for x in u]

    def entries(self, values: Sequence[float], where: str) -> list[Expr]:
        """Decimals of at most twelve digits from which the values may have been computed, else the values' decimals."""
        scale = COMPUTED * max(map(abs, values), default=0.0)
        short = [_short(x, scale) for x in values]
        changed = [f"{x!r} for {s!r}" for x, s in zip(values, short, strict=True) if x != s]
        if changed:
            self.notes.append(f"{where}: entries are taken rounded: {', '.join(dict.fromkeys(changed))}")
        return [self.decimal(x) for x in short]


def _short(x: float, tolerance: float) -> float:
    """The decimal of at most twelve digits within a tolerance of x, shortest first; x if there is none."""
    if abs(x) <= tolerance:
        return 0.0
    for digits in range(1, DIGITS + 1):
        s = float(f"{x:.{digits}g}")
        if abs(s - x) <= tolerance:
            return s
    return x


def exact_robot(model: Model) -> ExactRobot:
    """The exact form of a Model's robot, its gravity and base included."""
    read, robot = Reader(), model.robot
    sympy = read.sympy
    turns = {"": [read.angle(x, "base") for x in rpy_of(np.reshape(model.options.base, (4, 4))[:3, :3])]}
    axes = {}
    for joint in robot.joints:
        where = f'joint "{joint.name}"'
        turns[f"joint {joint.name}"] = [
            read.angle(x, where) for x in rpy_of(np.reshape(joint.placement, (4, 4))[:3, :3])
        ]
        if joint.kind in WITH_AXIS:
            axes[joint.name] = read.axis(joint.axis, where)
        if joint.rotor is not None:
            axes[f"rotor of {joint.name}"] = read.axis(joint.rotor.axis or joint.axis, f"rotor of {where}")
    constants = {abs(a) for rpy in turns.values() for a in rpy if a and not (12 * a / sympy.pi).is_Integer}
    oblique = any((2 * a / sympy.pi).is_noninteger for rpy in turns.values() for a in rpy if abs(a) not in constants)
    roots = {2, 3} if oblique else set()
    for power in {power for u in axes.values() for x in u for power in x.atoms(sympy.Pow)}:
        roots |= set(sympy.factorint(int(power.base)))
    ring = Ring(angles=sorted(constants, key=str), primes=sorted(roots))

    def placed(name: str, X: Sequence[float]) -> tuple[Any, ...]:
        R = _rotation(ring, turns[name])
        p = [ring.of(read.decimal(X[k])) for k in (3, 7, 11)]
        return (*R[:3], p[0], *R[3:6], p[1], *R[6:], p[2], 0.0, 0.0, 0.0, 1.0)

    change: Any = replace  # fields declared float receive Numbers
    links = tuple(
        change(
            link,
            mass=ring.of(read.decimal(link.mass)),
            com=tuple(ring.of(read.decimal(x)) for x in link.com),
            inertia=tuple(ring.of(x) for x in read.entries(link.inertia, f'link "{link.name}": inertia')),
        )
        for link in robot.links
    )
    joints = tuple(
        change(
            joint,
            placement=placed(f"joint {joint.name}", joint.placement),
            axis=tuple(ring.of(x) for x in axes.get(joint.name, ())),
            pitch=ring.of(read.decimal(joint.pitch)),
        )
        for joint in robot.joints
    )
    X = placed("", model.options.base)
    base = Pose(_rotation(ring, turns[""]), Vec(X[3], X[7], X[11]))
    moving, inertias, frames = walk(replace(robot, links=links, joints=joints), base, model.options.root)
    values = {f"g_{x}": ring.of(read.decimal(g)) for x, g in zip("xyz", model.options.gravity, strict=True)}
    rotors: dict[int, tuple[Any, tuple[Any, ...]]] = {}
    for k, m in enumerate(moving, start=1):
        rotor = m.joint.armature
        if isinstance(rotor, tuple):
            raise ModelError(f'joint "{m.joint.name}" has armatures {rotor}, expected one for all its freedoms')
        reflected = read.decimal(rotor)
        if m.joint.rotor is not None:
            ratio = read.decimal(m.joint.rotor.ratio)
            reflected = ratio**2 * read.decimal(m.joint.rotor.inertia)
            rotors[k] = ring.of(ratio), tuple(ring.of(x) for x in axes[f"rotor of {m.joint.name}"])
        values |= _values(ring, k, inertias[k], m.X, reflected)
    return ExactRobot(
        ring,
        [(m.joint.kind, m.joint.axis, m.joint.pitch, m.X) for m in moving],
        rotors,
        {k: ring.of(read.decimal(m.joint.shared[1])) for k, m in enumerate(moving, 1) if m.joint.shared is not None},
        values,
        {f"{kind}:{name}": X for name, kind, _, X in frames},
        read.notes,
    )


def _rotation(ring: Ring, rpy: Sequence[Expr]) -> Any:
    """Rotation of URDF's roll, pitch, yaw: about z, then y, then x."""
    one = (Vec(1.0, 0.0, 0.0), Vec(0.0, 1.0, 0.0), Vec(0.0, 0.0, 1.0))
    X, Y, Z = (turn(u, *ring.turn(angle)) for u, angle in zip(one, rpy, strict=True))
    return matmul(matmul(Z, Y), X)


def _values(ring: Ring, k: int, I: Inertia, X: Pose, armature: Expr) -> dict[str, Number]:
    """The parameters of body k by name, from its inertia about its origin."""
    zero = ring.of(0)
    m = zero + I.m
    com = [(zero + x) / m if m.num else zero for x in I.h]
    values = {f"m_{k}": m}
    values |= {f"c_{k}{x}": c for x, c in zip("xyz", com, strict=True)}
    values |= {f"I_{k}{x}": zero + a - b for x, a, b in zip(Sym._fields, I.I, point(m, Vec(*com)).I, strict=True)}
    values |= {f"l_{k}{x}": zero + at for x, at in zip("xyz", X.p, strict=True)}
    values[f"J_{k}"] = ring.of(armature)
    return values


def exact_table(model: Model, known: ExactRobot, ring: Ring, chosen: Mapping[str, Expr]) -> Any:
    """The table of bodies in Numbers of a ring that extends ``known.ring``; ``chosen`` replaces values by name."""
    rows: Any = table(model.bodies)
    values = {name: ring.of(chosen[name]) if name in chosen else ring.taken(x) for name, x in known.values.items()}
    put_vec(rows[0].gravity, Vec(*(values[f"g_{x}"] for x in "xyz")))
    for k, (kind, axis, pitch, X) in enumerate(known.moving, start=1):
        last, joint = model.joints[k].row, model.joints[k]
        first = rows[last - joint.nv + 1]
        parent = first.parent
        R = Mat3(*(ring.taken(x) for x in X.R))
        S = subspace(kind, [ring.taken(x) for x in axis], ring.taken(pitch))
        placed = Pose(R, Vec(*(values[f"l_{k}{x}"] for x in "xyz")))
        put_joint(rows, last - joint.nv + 1, first.kind, placed, S, first.q_index)
        first.parent = parent
        for row in rows[last - joint.nv + 1 : last + 1]:
            row.armature = values[f"J_{k}"]
        if first.coupled:
            first.coupling = ring.taken(known.couplings[k])
        if first.geared:
            ratio, along = known.rotors[k]
            e = rotate(R, Vec(*(ring.taken(x) for x in along)))
            put_vec(first.rotor, scale(values[f"J_{k}"] / ring.taken(ratio), e))
        com = [values[f"c_{k}{x}"] for x in "xyz"]
        about = [values[f"I_{k}{x}"] for x in Sym._fields]
        put_inertia(rows[last].inertia, body([values[f"m_{k}"]], com, about))
    for row in rows:
        _lighten(row)
    return rows


def _lighten(row: Row) -> None:
    """Write zeros and ones as floats, which products simplify."""
    for name, x in row.__dict__.items():
        if isinstance(x, Row):
            _lighten(x)
        elif isinstance(x, Number) and x.den is None and (not x.num or x.num == 1):
            row.__dict__[name] = 1.0 if x.num else 0.0

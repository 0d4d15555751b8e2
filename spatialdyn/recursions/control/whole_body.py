"""A whole body's quadratic program, min ½ xᵀP x + gᵀx in x = (a, f), and the terms of its tasks.

With n freedoms and three force components on each contact point, along the ground's normal and across it,

    rows      equation or limit                                                 of
    n         ± limit - s h  bounds  s (M a - Jᵀ f)                             bodies: 0 for those without a motor
    ns        B J_c a = -B (J̇_c v + D J_c v), over the brake                    feet that stand
    4 np      ± f_t - μ/√2 f_n <= 0                                             pyramids within the cones

and the bounds of x are position and velocity limits, see below, and normal forces between 0 and the largest. Forces are
in shares of the weight. A foot of one point keeps its point of contact at rest; a foot of several points, the points.

At a step h, a takes v to v + h a and q to q + h v + ½ h² a. Below the upper limit b with brakes ā,

    v + h a <= v_max,    h v + ½ h² a <= b - q,    (v + h a)² <= 2 ā (b - q - h v - ½ h² a)  or  v + h a <= 0,

and a >= -ā is always allowed: a joint that ā cannot stop before its limit is braked by ā, not harder.
Source: for the program, after Del Prete, Mansard, Ramos, Stasse and Nori, Implementing torque control with high-ratio
gear boxes and without joint-torque sensors (2016); for limits, after Del Prete, Joint position and velocity bounds in
discrete-time acceleration/torque control of robot manipulators (2018).
"""

from __future__ import annotations

from typing import NamedTuple

from ...algebra.euclidean import Mat3, Vec, add, cross, identity, rotate, scale, unrotate
from ...algebra.public_arrays import read_motion, write_motion, write_pose, write_vec
from ...algebra.records import mat3_of, pose_of, put_mat3, table_dtype
from ...algebra.scalars import Scalar, inline, select, sqrt
from ...algebra.spatial import Force, Inertia, Motion, Pose
from ...bodies.task_table import SIZES, TASKS
from ..constraints.constraint_rows import carry_axes
from ..contact.contact_rows import CONTACTS_ARGUMENT, GAP, HEIGHTS_ARGUMENT, MU, times, write_gaps, write_rows
from ..coordinates.configuration import difference
from ..momenta.centroidal import center_of_mass, center_of_mass_acceleration, center_of_mass_jacobian
from ..signatures import Array, Bodies, Config, Matrix, Record, Vector, Work
from ..spec import LOCAL, LOCAL_WORLD_ALIGNED, Argument, Q, Spec, V
from ..tree.crba import crba
from ..tree.kinematics import classical_acceleration, express_in, frame_jacobian, frame_motion
from ..tree.rnea import rnea
from .inverse_kinematics import put_error

WORK = table_dtype(
    X=Pose,  # pose of the row in its parent, of crba and rnea; then of frames, then of the centre of mass
    Ic=Inertia,  # of crba
    w=Vec,  # of rnea, as are the fields that follow
    dw=Vec,
    dv=Vec,
    f=Force,
    R=Mat3,  # of contact rows, in the ground's axes, as is the field that follows
    o=Vec,
    v=Motion,  # of frames, then of the centre of mass, as are the fields that follow
    a=Motion,
    I=Inertia,
    dI=Inertia,
    m=float,
    h=Vec,
)
FAR = 1e30  # a bound that does not hold


class Settings(NamedTuple):
    """Numbers of the program.

    bounds   (5, nv) of each freedom: its lower and upper coordinate, its largest speed, the factor s of its row of
             torques, and the limit of that row
    numbers  (7,) weight of the robot, brake, D, h, largest normal force over the weight, small weights in P of a and f
    """

    bounds: Matrix
    numbers: Vector


class Goals(NamedTuple):
    """Goals of the tasks, a* = a_d + Kp e - Kd ẋ, where a_d includes the terms of velocities to follow.

    rows     (4, nt) for rows of frames and the centre of mass: weight, Kp, Kd, a_d
    targets  (nf + 1, 4, 4) poses for frames; the first holds the place for the centre of mass
    joints   (4, nv) the same four numbers for joints
    rest     (nq) rest configuration of the joints
    """

    rows: Matrix
    targets: Array
    joints: Matrix
    rest: Config


class Ground(NamedTuple):
    """The points that may touch, and the ground."""

    contacts: Record  # the table of points and joints
    heights: Record  # of the ground; None: a plane
    mu: Vector  # (np)


class Terms(NamedTuple):
    """The outputs, flat: the program, bias h, and J, J̇ v and a* of the tasks, those of joints last."""

    P: Vector
    g: Vector
    rows: Vector
    low: Vector
    high: Vector
    bias: Vector
    J: Vector
    drift: Vector
    wanted: Vector
    joints: Vector
    gap: Vector
    tilt: Vector


class Scratch(NamedTuple):
    """Scratch of the recursion."""

    M: Matrix = ("nv", "nv")
    T: Array = ("np", 3, 3)
    pull: Matrix = ("np+np+np+nl+nd", "nv")
    J: Array = ("nf+1", 6, "nv")
    drift: Matrix = ("nf+1", 6)
    rate: Matrix = ("nf+1", 6)
    e: Matrix = ("nf+1", 6)
    heavy: Matrix = ("nt", "nv")
    place: Vector = (3,)
    rest: Vector = ("nv",)
    P: Matrix = (4, 4)


@inline
def least(x: Scalar, y: Scalar) -> Scalar:
    """The smaller of two."""
    return select(y - x, x, y)


@inline
def most(x: Scalar, y: Scalar) -> Scalar:
    """The larger of two."""
    return select(x - y, x, y)


@inline
def viable(gap: Scalar, v: Scalar, fastest: Scalar, brake: Scalar, h: Scalar) -> Scalar:
    """The largest acceleration where ``gap`` is left to the limit."""
    inside = brake * h * h * brake - 4.0 * brake * h * v + 8.0 * brake * gap
    stopped = -v / h
    root = sqrt(select(inside, inside, 0.0))
    by_braking = most((root - 2.0 * v - brake * h) / (2.0 * h), stopped)
    by_braking = select(inside, by_braking, stopped)
    within = select(-gap, FAR, 2.0 * (gap - h * v) / (h * h))  # the step itself ends before the limit
    by_position = select(gap - 0.1 * FAR, FAR, least(by_braking, within))
    return most(least(by_position, (fastest - v) / h), -brake)


@inline
def write_accelerations(bodies: Bodies, q: Config, v: Vector, by: Settings, low: Vector, high: Vector) -> None:
    """Bounds of a."""
    brake, h = by.numbers[1], by.numbers[3]
    for i in range(len(v)):
        b = bodies[i + 1]
        if b.dofs == 1:
            at = q[b.q_index]
            up, down = by.bounds[1, i] - at, at - by.bounds[0, i]
        else:
            up, down = FAR, FAR
        high[i] = viable(up, v[i], by.bounds[2, i], brake, h)
        low[i] = -viable(down, -v[i], by.bounds[2, i], brake, h)


@inline
def write_frames(
    bodies: Bodies, work: Work, q: Config, v: Vector, tasks: Record, goals: Goals, s: Scratch
) -> None:  # fmt: skip
    """J, J̇ v and J v of every frame, in its reference, and e."""
    for k in range(1, tasks[0].nf + 1):
        t = tasks[k]
        write_pose(s.P, pose_of(t.X))
        frame_jacobian(bodies, work, q, t.row, s.P, t.reference, s.J[k])
        X, seen, total = frame_motion(bodies, work, q, v, None, t.row, s.P)
        seen, total = express_in(X, seen, t.reference), express_in(X, total, t.reference)
        if t.reference == LOCAL_WORLD_ALIGNED:
            total = classical_acceleration(total, seen)
        write_motion(s.drift[k], total)
        write_motion(s.rate[k], seen)
        write_pose(s.P, X)
        put_error(s.P, goals.targets[k], 0, True, s.e[k])
        if t.reference == LOCAL:
            way = read_motion(s.e[k])
            write_motion(s.e[k], Motion(unrotate(X.R, way.w), unrotate(X.R, way.v)))


@inline
def point_drift(
    bodies: Bodies, work: Work, q: Config, v: Vector, ground: Ground, p: int, axis: int, s: Scratch
) -> Scalar:  # fmt: skip
    """The acceleration of a sphere's point of contact, at zero joint acceleration, along an axis of the ground."""
    c = ground.contacts[1 + p]
    write_pose(s.P, Pose(identity(), Vec(c.p.x, c.p.y, c.p.z)))
    X, seen, total = frame_motion(bodies, work, q, v, None, c.row, s.P)
    axes = mat3_of(ground.contacts[0].axes)
    a = rotate(axes, rotate(X.R, classical_acceleration(total, seen).v))
    turn = rotate(axes, rotate(X.R, total.w))
    if ground.heights is None:
        write_vec(s.place, add(a, cross(turn, Vec(-c.radius, 0.0, 0.0))))
    else:
        down = scale(-c.radius, Vec(s.T[p, 0, 0], s.T[p, 0, 1], s.T[p, 0, 2]))
        write_vec(s.place, times(s.T[p], add(a, cross(turn, down))))
    return s.place[axis]


@inline
def write_standing(
    bodies: Bodies, work: Work, q: Config, v: Vector, ground: Ground, tasks: Record, by: Settings, out: Terms,
    s: Scratch,
) -> None:  # fmt: skip
    """The equations of feet."""
    n, nf, ns = len(v), tasks[0].nf, tasks[0].ns
    width = n + 3 * ground.contacts[0].np
    brake, damping = 1.0 / by.numbers[1], by.numbers[2]
    for r in range(ns):
        t = tasks[1 + nf + r]
        at = (n + r) * width
        if t.frame > 0:
            J, k = s.J[t.frame], t.frame
            f, m = t.F.f, t.F.n
            for i in range(n):
                out.rows[at + i] = brake * (
                    f.x * J[0, i] + f.y * J[1, i] + f.z * J[2, i] + m.x * J[3, i] + m.y * J[4, i] + m.z * J[5, i]
                )
            d, u = s.drift[k], s.rate[k]
            drift = f.x * d[0] + f.y * d[1] + f.z * d[2] + m.x * d[3] + m.y * d[4] + m.z * d[5]
            rate = f.x * u[0] + f.y * u[1] + f.z * u[2] + m.x * u[3] + m.y * u[4] + m.z * u[5]
        else:
            k = 3 * t.point + t.axis
            rate = 0.0 * v[0]
            for i in range(n):
                out.rows[at + i] = brake * s.pull[k, i]
                rate = rate + s.pull[k, i] * v[i]
            drift = point_drift(bodies, work, q, v, ground, t.point, t.axis, s)
        b = -brake * (drift + damping * rate)
        out.low[width + n + r] = b
        out.high[width + n + r] = b


@inline
def write_com(
    bodies: Bodies, work: Work, q: Config, v: Vector, tasks: Record, goals: Goals, s: Scratch
) -> None:  # fmt: skip
    """The same for the centre of mass, as frame 0, if a task uses it."""
    asked = 0
    for r in range(tasks[0].nt):
        if tasks[1 + tasks[0].nf + tasks[0].ns + r].frame == 0:
            asked = 1
    if asked == 1:
        center_of_mass(bodies, work, q, s.place)
        for i in range(len(v)):
            s.rest[i] = 0.0
        center_of_mass_acceleration(bodies, work, q, v, s.rest, s.drift[0])
        center_of_mass_jacobian(bodies, work, q, s.J[0])
        for k in range(3):
            rate = 0.0 * v[0]
            for i in range(len(v)):
                rate = rate + s.J[0, k, i] * v[i]
            s.rate[0, k] = rate
            s.e[0, k] = goals.targets[0, k, 3] - s.place[k]


@inline
def write_tasks(v: Vector, width: int, tasks: Record, by: Settings, goals: Goals, out: Terms, s: Scratch) -> None:
    """The rows of tasks, from their terms in ``s``; P and g of tasks, of joints, and of small weights."""
    n, nf, ns, nt = len(v), tasks[0].nf, tasks[0].ns, tasks[0].nt
    for k in range(width):
        out.g[k] = 0.0
        for j in range(width):
            out.P[k * width + j] = 0.0
    for r in range(nt):
        t = tasks[1 + nf + ns + r]
        f, k = t.frame, t.axis
        out.drift[r] = s.drift[f, k]
        out.wanted[r] = goals.rows[3, r] + goals.rows[1, r] * s.e[f, k] - goals.rows[2, r] * s.rate[f, k]
        for i in range(n):
            out.J[r * n + i] = s.J[f, k, i]
            s.heavy[r, i] = goals.rows[0, r] * s.J[f, k, i]
            out.g[i] = out.g[i] - s.heavy[r, i] * (out.wanted[r] - out.drift[r])
    for i in range(n):
        for j in range(i + 1):
            total = 0.0 * v[0]
            for r in range(nt):
                total = total + s.heavy[r, i] * out.J[r * n + j]
            out.P[i * width + j] = total
            out.P[j * width + i] = total
        weight, kp, kd, feed = goals.joints[0, i], goals.joints[1, i], goals.joints[2, i], goals.joints[3, i]
        out.joints[i] = feed + kp * out.joints[i] - kd * v[i]
        out.P[i * width + i] = out.P[i * width + i] + (weight + by.numbers[5])
        out.g[i] = out.g[i] - weight * out.joints[i]
    for k in range(n, width):
        out.P[k * width + k] = by.numbers[6]


@inline
def whole_body(
    bodies: Bodies, work: Work, q: Config, v: Vector, by: Settings, goals: Goals, ground: Ground, tasks: Record,
    out: Terms, s: Scratch,
) -> None:  # fmt: skip
    """The program, and the terms of the tasks."""
    contacts, n, points = ground.contacts, len(bodies) - 1, ground.contacts[0].np
    ns, width, rows, low, high = tasks[0].ns, n + 3 * points, out.rows, out.low, out.high
    crba(bodies, work, q, s.M)
    rnea(bodies, work, q, v, None, None, out.bias)
    put_mat3(work[0].R, mat3_of(contacts[0].axes))
    carry_axes(bodies, work)
    write_gaps(bodies, work, contacts, ground.heights, out.gap, s.T)
    write_rows(bodies, work, contacts, ground.heights, s.T, s.pull)
    for k in range(len(rows)):
        rows[k] = 0.0
    for i in range(n):
        unit, limit = by.bounds[3, i], by.bounds[4, i]
        for j in range(n):
            rows[i * width + j] = unit * s.M[i, j]
        for k in range(3 * points):
            rows[i * width + n + k] = -(by.numbers[0] * unit) * s.pull[k, i]
        low[width + i] = -limit - unit * out.bias[i]
        high[width + i] = limit - unit * out.bias[i]
    write_accelerations(bodies, q, v, by, low, high)
    for p in range(points):
        k = n + 3 * p
        low[k], low[k + 1], low[k + 2] = 0.0, -FAR, -FAR
        high[k], high[k + 1], high[k + 2] = by.numbers[4], FAR, FAR
        for j in range(4):
            at = n + ns + 4 * p + j
            rows[at * width + k] = -0.5 * sqrt(2.0) * ground.mu[p]
            rows[at * width + k + 1 + j // 2] = 1.0 if j % 2 == 0 else -1.0
            low[width + at], high[width + at] = -FAR, 0.0
        for i in range(3):
            for j in range(3):
                out.tilt[9 * p + 3 * i + j] = s.T[p, i, j] if ground.heights is not None else 1.0 if i == j else 0.0
    difference(bodies, q, goals.rest, out.joints)
    write_frames(bodies, work, q, v, tasks, goals, s)
    write_standing(bodies, work, q, v, ground, tasks, by, out, s)
    write_com(bodies, work, q, v, tasks, goals, s)
    write_tasks(v, width, tasks, by, goals, out, s)


WIDTH = "nv+np+np+np"
HEIGHT = "nv+ns+np+np+np+np"
_SETTINGS = Settings(
    Argument("bounds", (5, "nv"), "", "of each freedom, see Settings"),
    Argument("numbers", (7,), "", "of the program, see Settings"),
)
_GOALS = Goals(
    Argument("goals", (4, "nt"), "", "weight, Kp, Kd and feedforward of each row of a task"),
    Argument("targets", ("nf+1", 4, 4), "m", "of the centre of mass and of frames"),
    Argument("joint_goals", (4, "nv"), "", "weight, Kp, Kd and feedforward of each freedom"),
    Argument("rest", ("nq",), "rad | m", "where joints rest"),
)
_TABLE = Argument("tasks", (), "", "frames, equations of feet and rows of tasks", static=True, table=TASKS, sizes=SIZES)
PARTS = Terms(
    Argument("P", (WIDTH, WIDTH), "", "of the program"), Argument("g", (WIDTH,), "", "of the program"),
    Argument("rows", (HEIGHT, WIDTH), "", "of the program"),
    Argument("low", (f"{WIDTH}+{HEIGHT}",), "", "bounds of x, then of the rows"),
    Argument("high", (f"{WIDTH}+{HEIGHT}",), "", "the same"),
    Argument("bias", ("nv",), "N m | N", "C v + g"),
    Argument("J", ("nt", "nv"), "m/rad | 1", "of tasks"),
    Argument("drift", ("nt",), "m/s² | rad/s²", "J̇ v of tasks"),
    Argument("wanted", ("nt",), "m/s² | rad/s²", "a* of tasks"),
    Argument("joints", ("nv",), "rad/s² | m/s²", "a* of joints"), GAP,
    Argument("tilt", ("np", 3, 3), "1", "normal and tangents of the ground, in the axes of the table"),
)  # fmt: skip


def _spec(name: str, heights: Argument | None) -> Spec:
    return Spec(
        name, whole_body, WORK, (Q, V, _SETTINGS, _GOALS, Ground(CONTACTS_ARGUMENT, heights, MU), _TABLE),
        Argument("terms", ("total",), "", "the program, and terms of tasks"),
        "A whole body's quadratic program, and terms of its tasks.", "see whole_body", parts=PARTS,
        scratch=(Scratch(),), composed=True, large=True,
    )  # fmt: skip


WHOLE_BODY = _spec("whole_body", None)
WHOLE_BODY_OVER = _spec("whole_body_over", HEIGHTS_ARGUMENT)

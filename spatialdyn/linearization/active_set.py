"""States of points and joints at the solution of a step by impulses; solution and derivatives of their equations.

A point p with velocities u, c in the normal, and impulse λ has

    separates  λ = 0
    sticks     u = 0
    slides     u_n = 0,    λ_t + μ λ_n u_t / |u_t| = 0

and a joint, with velocity x and impulse λ, has x = 0 or x at a limit, or slides with λ = ±F, 0 without friction. A
projection (Alart and Curnier 1991) decides: a point touches if p_n = λ_n - u_n / B_nn is above 0, and slides if
|λ_t - u_t/B| is above μ λ_n. In a phase of a bounce λ_n is at least λ_0, and above it for a point that touches; a point
that bounces has λ_n = λ_0, with friction if it glances.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
SEPARATES, STICKS, SLIDES = "separates", "sticks", "slides"
BOUNCES, GLANCES = "bounces", "glances"  # without and with sliding
FREE, LOWER, UPPER = "free", "lower limit", "upper limit"
STEPS = 30  # limit of Newton steps; a solved step needs a few
SETTLED = 1e-13  # relative change of velocities at which Newton steps end
SOLVED = 1e-6  # largest relative residual of the laws of points and joints
SHARED = 1e-8  # relative singular value of impulses that others can replace, and their least part in such a change
RANK = 1e-11  # relative singular value of an equation that depends on others
CONTRADICTS = 1e-7  # relative to the terms of an equation: residual after the others are met
SMALL = 1e-300
RESTS = 1e-5  # [m/s | rad/s] of a point that rests: some tolerances of a step
EVEN = 1e-2  # how much less loads weigh than friction where both may be shared


@dataclass
class ActiveSet:
    """The equations of one step, linear but for friction, about a solution to some tolerance.

    x, impulse, reaction    of that solution, then of the refined solution
    M, J, C                 (nv, nv), (rows, nv), (nc, nv): slopes of momentum, velocity and closing by x
    momentum, velocity, closing  residuals there
    gap, level, least, most  see ``impulse_balance``
    mu                      (np)
    joints                  (nl + nd) freedoms of the joints
    lower                   (np) λ_0
    kept                    (nc) equations of constraints that are independent
    switch                  margin [m/s | rad/s] below which a state is at a switch
    """

    x: Array
    impulse: Array
    reaction: Array
    M: Array
    J: Array
    C: Array
    momentum: Array
    velocity: Array
    closing: Array
    gap: Array
    level: Array
    least: Array
    most: Array
    mu: Array
    lower: Array
    joints: Array
    kept: NDArray[np.bool_]
    switch: float
    dt: float
    names: list[str] = field(default_factory=list)
    switching: list[bool] = field(default_factory=list)

    def __post_init__(self) -> None:
        # impulses of joints act along unit rows
        self.start = self.x, self.impulse, self.reaction
        self.scale = 1.0 / np.sqrt(np.diagonal(self.M))
        answers = np.linalg.solve(self.M, self.J.T)
        self.own = np.maximum(np.einsum("ki,ik->k", self.J, answers), SMALL)
        self.points = len(self.mu)
        self.friction = np.zeros(self.points)  # the largest response across the normal
        for p in range(self.points):
            t = slice(3 * p + 1, 3 * p + 3)
            self.friction[p] = max(float(np.linalg.eigvalsh(self.J[t] @ answers[:, t])[-1]), SMALL)
            self.own[t] = self.friction[p]  # one scale, so that no result depends on where the two axes lie

    # --- where it is ---

    def state(self) -> tuple[Array, Array, Array]:
        """The residual of momentum, u, and the residual of constraints, at the present solution."""
        dx = self.x - self.start[0]
        impulse, reaction = self.impulse - self.start[1], self.reaction - self.start[2]
        momentum = self.momentum + self.M @ dx - self.J.T @ impulse - self.C.T @ reaction
        return momentum, self.velocity + self.J @ dx, self.closing + self.C @ dx

    def classify(self, u: Array) -> tuple[list[str], list[float]]:
        """The states, and the distance of each from another state, in units of velocity."""
        names, margins = [], []
        for p in range(self.points):
            k = 3 * p
            push = (self.impulse[k] - self.lower[p]) * self.own[k] - u[k]
            t = self.impulse[k + 1 : k + 3] * self.friction[p] - u[k + 1 : k + 3]
            most = self.mu[p] * max(self.impulse[k], 0.0) * self.friction[p]
            over = float(np.linalg.norm(t)) - most
            near = abs(push)
            across = self.friction[p] > SMALL  # otherwise the point moves only along its normal
            slides = across and over > 0.0
            if not push > 0.0 and self.lower[p] == 0.0:
                names.append(SEPARATES)
            elif not push > 0.0:
                names.append(GLANCES if slides else BOUNCES)
                near = min(near, abs(over) if across else near)
            else:
                names.append(SLIDES if slides else STICKS)
                near = min(near, abs(over) if across else near, abs(self.gap[p]) / self.dt)
            margins.append(near)
        for j, i in enumerate(self.joints):
            k = 3 * self.points + j
            level, x = self.level[j] * self.own[k], self.x[i]
            free = x - self.impulse[k] * self.own[k]
            moved = free - min(max(free, -level), level)
            low, high = (self.least[j], self.most[j]) if j < len(self.least) else (-np.inf, np.inf)
            if moved < low or moved > high:
                names.append(LOWER if moved < low else UPPER)
            elif level == 0.0:
                names.append(FREE)
            else:
                names.append(STICKS if moved == 0.0 else SLIDES)
            near = [abs(moved - low), abs(moved - high)]
            if level > 0.0:
                near.append(abs(abs(free) - level))
            margins.append(min(near))
        return names, margins

    # --- equations ---

    def system(self, names: list[str], u: Array) -> tuple[Array, Array]:
        """Slopes (n, n) of the states' equations by x, λ and μ, with rows of one scale, and the scales of unknowns."""
        nv, rows = len(self.x), len(self.impulse)
        held = np.flatnonzero(self.kept)
        size = nv + rows + len(held)
        K = np.zeros((size, size))
        K[:nv, :nv], K[:nv, nv : nv + rows], K[:nv, nv + rows :] = self.M, -self.J.T, -self.C[held].T
        K[nv + rows :, :nv] = self.C[held]
        for p in range(self.points):
            at, k = nv + 3 * p, slice(3 * p, 3 * p + 3)
            if names[p] == SEPARATES:
                K[at : at + 3, at : at + 3] = np.diag(self.own[k])
                continue
            K[at : at + 3, :nv] = self.J[k]
            if names[p] in (BOUNCES, GLANCES):
                K[at, :nv], K[at, at] = 0.0, self.own[3 * p]
            if names[p] in (SLIDES, GLANCES):
                direction, each = self.direction(p, u)
                across = np.eye(2) - np.outer(direction, direction)
                K[at + 1 : at + 3, :nv] = each * across @ self.J[3 * p + 1 : 3 * p + 3]
                K[at + 1 : at + 3, at] = self.friction[p] * self.mu[p] * direction
                K[at + 1 : at + 3, at + 1 : at + 3] = self.friction[p] * np.eye(2)
        for j, i in enumerate(self.joints):
            at, name = nv + 3 * self.points + j, names[self.points + j]
            if name in (FREE, SLIDES):
                K[at, at] = self.own[3 * self.points + j]
            else:
                K[at, i] = 1.0
        return K, held

    def direction(self, p: int, u: Array) -> tuple[Array, float]:
        """The direction u_t / |u_t| of a sliding point, and μ λ_n B / |u_t|, the rate at which friction turns."""
        t = u[3 * p + 1 : 3 * p + 3]
        size = float(np.linalg.norm(t))
        if size > 0.0:
            return t / size, self.mu[p] * self.impulse[3 * p] * self.friction[p] / size
        f = self.impulse[3 * p + 1 : 3 * p + 3]
        force = float(np.linalg.norm(f))
        return (-f / force if force > 0.0 else np.array([1.0, 0.0])), 0.0

    def left(self, names: list[str], u: Array, momentum: Array, closing: Array) -> Array:
        """The residual of the equations of the states."""
        found = [momentum]
        for p in range(self.points):
            if names[p] == SEPARATES:
                rows = slice(3 * p, 3 * p + 3)
                found.append(self.own[rows] * self.impulse[rows])
                continue
            normal, across = u[3 * p], u[3 * p + 1 : 3 * p + 3]
            if names[p] in (BOUNCES, GLANCES):
                normal = self.own[3 * p] * (self.impulse[3 * p] - self.lower[p])
            if names[p] in (SLIDES, GLANCES):
                direction, _ = self.direction(p, u)
                f = self.impulse[3 * p + 1 : 3 * p + 3] + self.mu[p] * self.impulse[3 * p] * direction
                across = self.friction[p] * f
            found.append(np.r_[normal, across])
        for j, i in enumerate(self.joints):
            k, name = 3 * self.points + j, names[self.points + j]
            if name in (FREE, SLIDES):
                sign = np.sign(self.x[i] - self.impulse[k] * self.own[k]) if name == SLIDES else 0.0
                found.append(np.array([self.own[k] * (self.impulse[k] + sign * self.level[j])]))
            else:
                wanted = {STICKS: 0.0, LOWER: self.least[j : j + 1], UPPER: self.most[j : j + 1]}[name]
                found.append(np.atleast_1d(self.x[i] - wanted))
        return np.concatenate([*found, closing[self.kept]])

    def solve(self, K: Array, right: Array) -> Array:
        """Solve K y = right, with the least change in the metric of M if equations depend on others."""
        S, equations, unknowns = self.scaled(K)
        scaled = right * (equations if right.ndim == 1 else equations[:, None])
        made: Array = np.linalg.lstsq(S, scaled, rcond=RANK)[0] * (unknowns if right.ndim == 1 else unknowns[:, None])
        return made

    def undetermined(self) -> list[bool]:
        """For points and joints: whether it is a sliding point whose load others could take."""
        found = [False] * len(self.names)
        sliding = [p for p in range(self.points) if self.names[p] in (SLIDES, GLANCES) and self.mu[p] > 0.0]
        if sliding:
            shared = self.shared()
            for p in sliding:
                found[p] = bool(shared[p])
        return found

    def shared(self) -> NDArray[np.bool_]:
        """(np) whether others could take the load of a point."""
        return np.asarray((abs(self.free_impulses()[:, :, 0]) > SHARED).any(axis=0), np.bool_)

    def free_impulses(self) -> Array:
        """(ways, np, 3) how impulses of points, times the root of what they answer to, may change alone."""
        _, u, _ = self.state()
        _, sizes, ways = np.linalg.svd(self.scaled(self.system(self.names, u)[0])[0])
        first, found = len(self.x), ways[sizes <= SHARED * sizes[0]]
        made: Array = found[:, first : first + 3 * self.points].reshape((len(found), self.points, 3))
        return made

    def gives_back_apart(self, each: Array) -> NDArray[np.bool_]:
        """(np) of points that share impulses: whether shares ``each`` (np) of their loads act otherwise as these do.

        They do not where loads alone are shared and all give back the same share. Friction that is shared turns with
        the body, and loads with it; friction along which a point cannot move, as of planar legs, is shared with none.
        """
        normal, free = 3 * np.arange(self.points), self.free_impulses()
        for p in range(self.points):
            rows = slice(3 * p + 1, 3 * p + 3)
            across = self.J[rows] * self.scale / np.sqrt(self.own[rows, None])
            ways, sizes, _ = np.linalg.svd(across, full_matrices=False)
            still = ways[:, sizes <= SHARED]
            free[:, p, 1:] -= free[:, p, 1:] @ still @ still.T
        back = (free[:, :, 0] * each / np.sqrt(self.own[normal])) @ self.J[normal] * self.scale
        apart = (np.linalg.norm(back, axis=1) > SHARED) | (abs(free[:, :, 1:]) > SHARED).any(axis=(1, 2))
        return np.asarray((abs(free[apart]) > SHARED).any(axis=(0, 2)), np.bool_)

    def scaled(self, K: Array) -> tuple[Array, Array, Array]:
        """K scaled, and the scales of equations and unknowns."""
        nv, size = len(self.x), len(K)
        unknowns = np.ones(size)
        unknowns[:nv] = self.scale
        forces = 1.0 / np.sqrt(self.own)
        unknowns[nv : nv + len(forces)] = forces
        equations = np.ones(size)
        equations[:nv] = self.scale
        S = K * unknowns
        equations[nv:] = 1.0 / np.maximum(np.linalg.norm(S[nv:], axis=1), SMALL)
        return equations[:, None] * S, equations, unknowns

    # --- what is asked ---

    def relax(self) -> None:
        """Take friction away by which points at rest press against each other, where that leaves all of them sticking.

        No law determines it, and no velocity depends on it; sweeps may leave such points at the edge of their cones,
        where they would slide at no speed.
        """
        _, u, _ = self.state()
        rest = [p for p in range(self.points) if self.rests(p, u)]
        if not any(np.linalg.norm(self.impulse[3 * p + 1 : 3 * p + 3]) > 0.0 for p in rest):
            return
        rows = np.concatenate([np.arange(3 * p, 3 * p + 3) for p in rest])
        _, sizes, ways = np.linalg.svd(self.scale[:, None] * self.J[rows].T)
        free = ways[(sizes > SHARED * sizes[0]).sum() :]
        weights = np.where(rows % 3 == 0, EVEN, 1.0)
        more = np.linalg.lstsq(weights[:, None] * free.T, -weights * self.impulse[rows])[0] @ free
        relaxed = (self.impulse[rows] + more).reshape((-1, 3))
        if (np.linalg.norm(relaxed[:, 1:], axis=1) < self.mu[rest] * relaxed[:, 0]).all():
            self.impulse = self.impulse.copy()
            self.impulse[rows] = relaxed.ravel()

    def rests(self, p: int, u: Array) -> bool:
        """Whether a point is at rest, to the tolerance of a step, and nothing but its law says by which impulse."""
        still = abs(u[3 * p : 3 * p + 3]).max() <= RESTS
        return bool(still and self.lower[p] == 0.0 and self.impulse[3 * p] > 0.0)

    def settle(self) -> bool:
        """Take Newton's steps to the solution; returns whether they reach it."""
        nv, rows = len(self.x), len(self.impulse)
        self.relax()
        for _ in range(STEPS):
            momentum, u, closing = self.state()
            names, _ = self.classify(u)
            K, held = self.system(names, u)
            change = -self.solve(K, self.left(names, u, momentum, closing))
            self.x = self.x + change[:nv]
            self.impulse = self.impulse + change[nv : nv + rows]
            self.reaction = self.reaction.copy()
            self.reaction[held] += change[nv + rows :]
            size = np.linalg.norm(change[:nv] / self.scale)
            whole = np.linalg.norm(self.x / self.scale) + np.linalg.norm(self.impulse * np.sqrt(self.own))
            if size <= SETTLED * whole and self.names == names:
                break
            self.names = names
        else:
            return False
        momentum, u, closing = self.state()
        left = self.left(self.names, u, momentum, closing)[nv : nv + rows]  # of a sliding direction that reverses
        if abs(left).max(initial=0.0) > SOLVED * (
            abs(u).max(initial=0.0) + (self.own * abs(self.impulse)).max(initial=0.0)
        ):
            return False
        names, margins = self.classify(u)
        self.switching = [bool(x <= self.switch) for x in margins]
        return True

    def derivative(self, by: Any, by_lower: Array) -> tuple[Array, Array]:
        """Derivatives (nv, m) of x and (rows, m) of impulses, from those of the residuals and of λ_0: ``by`` has their
        rows, as in ``impulse_balance``.
        """
        _, u, _ = self.state()
        K, held = self.system(self.names, u)
        right = [by.momentum]
        for p in range(self.points):
            rate = by.velocity[3 * p : 3 * p + 3]
            if self.names[p] == SEPARATES:
                right.append(0.0 * rate)
                continue
            normal, turned = rate[:1], rate[1:]
            if self.names[p] in (BOUNCES, GLANCES):
                normal = -self.own[3 * p] * by_lower[p : p + 1]
            if self.names[p] in (SLIDES, GLANCES):
                direction, each = self.direction(p, u)
                turned = each * (np.eye(2) - np.outer(direction, direction)) @ rate[1:]
            right.append(np.concatenate([normal, turned]))
        for j, i in enumerate(self.joints):
            k, name = 3 * self.points + j, self.names[self.points + j]
            if name == SLIDES:
                sign = np.sign(self.x[i] - self.impulse[k] * self.own[k])
                right.append(sign * self.own[k] * by.level[j : j + 1])
            elif name in (LOWER, UPPER):
                right.append(-(by.least if name == LOWER else by.most)[j : j + 1])
            else:
                right.append(np.zeros((1, by.momentum.shape[1])))
        whole = np.concatenate([*right, by.closing[held]])
        found = -self.solve(K, whole)
        self.note_contradictions(K, found, whole)
        nv = len(self.x)
        return found[:nv], found[nv : nv + len(self.impulse)]

    def note_contradictions(self, K: Array, found: Array, right: Array) -> None:
        """Mark as switching the states whose equations depend on others and contradict them as the state moves."""
        sizes = np.maximum(np.linalg.norm(K, axis=1, keepdims=True), SMALL)
        left, terms = abs(K @ found + right) / sizes, (abs(K) @ abs(found) + abs(right)) / sizes
        off = (left > CONTRADICTS * terms.max(axis=0)).any(axis=1)[len(self.x) :]
        for p in range(self.points):
            self.switching[p] |= bool(off[3 * p : 3 * p + 3].any())
        for j in range(len(self.joints)):
            self.switching[self.points + j] |= bool(off[3 * self.points + j])

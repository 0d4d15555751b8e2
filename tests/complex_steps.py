"""Derivatives along ``integrate(q, h)`` by complex steps, and two pieces of URDF for mimic joints.

Importing it teaches sin and cos to take complex numbers.
"""

from __future__ import annotations

import cmath
from typing import Any

import numpy as np
from dense import Array

from spatialdyn.algebra import scalars
from spatialdyn.algebra.rotations import rotation
from spatialdyn.bodies.kinds import FLOATING, PLANAR_CS, REVOLUTE_CS, SPHERICAL

EPS = np.finfo(float).eps
CLOSE = 256 * EPS  # of the largest entry: sums over a dozen bodies, each of a few rounded products
STEP = 1e-30  # of complex steps: its square vanishes beside 1
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><axis xyz="{3}"/>
  <origin xyz="0.2 0.1 0.3" rpy="0.3 0 0.2"/><limit lower="-3" upper="3" effort="1" velocity="1"/>{4}</joint>"""
LINK = """<link name="{0}"><inertial><origin xyz="0.1 {1} 0.05"/><mass value="{2}"/>
  <inertia ixx="0.3" ixy="0" ixz="0.01" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>"""

scalars.sin.register(complex)(cmath.sin)
scalars.cos.register(complex)(cmath.cos)


def close(x: Any, y: Any, bound: float = CLOSE) -> None:
    x, y = np.asarray(x), np.asarray(y)
    assert x.shape == y.shape
    assert abs(x - y).max(initial=0.0) <= bound * max(1.0, abs(y).max(initial=0.0))


def tangent(model: Any, q: Array) -> Array:
    """∂/∂h of integrate(q, h e_k) at h = 0, (nv, nq)."""
    T = np.zeros((model.nv, model.nq))

    def quaternion(row: int, at: int) -> None:
        x, y, z, w = q[at : at + 4]
        T[row : row + 3, at : at + 4] = 0.5 * np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]])

    def pair(row: int, at: int) -> None:
        T[row, at : at + 2] = -q[at + 1], q[at]

    for joint in model.joints[1:]:
        kind, row, at = model.bodies[joint.row - joint.nv + 1].kind, joint.idx_v, joint.idx_q
        if kind == SPHERICAL:
            quaternion(row, at)
        elif kind == FLOATING:
            T[row : row + 3, at : at + 3] = np.reshape(rotation(*q[at + 3 : at + 7].tolist()), (3, 3)).T
            quaternion(row + 3, at + 3)
        elif kind == REVOLUTE_CS:
            pair(row, at)
        elif joint.kind == "planar":
            c, s = q[at + 2 : at + 4] if kind == PLANAR_CS else (np.cos(q[at + 2]), np.sin(q[at + 2]))
            T[row : row + 2, at : at + 2] = [[c, s], [-s, c]]
            if kind == PLANAR_CS:
                pair(row + 2, at + 2)
            else:
                T[row + 2, at + 2] = 1.0
        else:
            T[row, at] = 1.0
    return T

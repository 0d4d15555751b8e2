"""Cosines and sines of table kernels, and their scratch."""

from __future__ import annotations

import math
import resource

import mpmath
import numpy as np
import pytest

import spatialdyn as sd
from spatialdyn.engines.compiled.numba_kernels import batch_kernel, sample_kernel, variant
from spatialdyn.engines.compiled.numba_settings import PLAIN
from spatialdyn.engines.polynomials import MAX_ANGLE
from spatialdyn.recursions import SPECS

compiled = pytest.mark.skipif(PLAIN, reason="plain Python has no kernels")


def turned(angles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """cos and sin of angles by the kernel of forward_kinematics: the rotation of a pendulum about y."""
    model = sd.load_urdf("pendulum")
    q, poses = np.ascontiguousarray(angles.reshape(-1, 1)), np.empty((len(angles), 2, 4, 4))
    batch_kernel(SPECS["forward_kinematics"])(model.address, len(q), q, 1, poses, np.empty(len(q), np.int8))
    return poses[:, 1, 0, 0], poses[:, 1, 0, 2]


@compiled
def test_within_15_ulp_of_40_digits() -> None:
    """Near multiples of π/2, where one of both vanishes, at the ends of quadrants, small and evenly."""
    rng = np.random.default_rng(5)
    near = rng.integers(-60000, 60000, 300) * (math.pi / 2)
    angles = np.concatenate([
        near, near + math.pi / 4, rng.uniform(-MAX_ANGLE, MAX_ANGLE, 300), rng.uniform(-4.0, 4.0, 300),
        10.0 ** rng.uniform(-300, 0, 50), [0.0, MAX_ANGLE, -MAX_ANGLE],
    ])  # fmt: skip
    angles = angles[abs(angles) <= MAX_ANGLE]
    with mpmath.workdps(40):
        for found, exact in zip(turned(angles), (mpmath.cos, mpmath.sin), strict=True):
            for x, value in zip(angles, found, strict=True):
                right = exact(mpmath.mpf(float(x)))
                assert abs(mpmath.mpf(float(value)) - right) <= 1.5 * np.spacing(abs(float(right))), x


@compiled
@pytest.mark.parametrize("angle", [1.5e5, -3e8, 1e22])
def test_larger_angles_are_those_of_the_c_library(angle: float) -> None:
    assert turned(np.array([0.5, angle]))[0][1] == math.cos(angle)
    assert turned(np.array([0.5, angle]))[1][1] == math.sin(angle)


@compiled
@pytest.mark.parametrize("angle", [math.inf, -math.inf, math.nan])
def test_infinite_angles_give_nan(angle: float) -> None:
    c, s = turned(np.array([0.5, angle]))
    assert math.isnan(c[1])
    assert math.isnan(s[1])


@compiled
def test_scratch_of_long_chains_is_given_back() -> None:
    """600 bodies take more than the stack has for a kernel; of 300 calls nothing remains."""
    joints = "".join(
        f'<link name="l{k}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        f'</inertial></link><joint name="j{k}" type="continuous"><parent link="l{k - 1}"/><child link="l{k}"/>'
        f'<axis xyz="0 {k % 2} {1 - k % 2}"/></joint>'
        for k in range(1, 601)
    )
    model = sd.load_urdf(f'<robot name="chain"><link name="l0"/>{joints}</robot>')
    q, v, tau, a, found = (np.full(600, x) for x in (0.1, 0.2, 0.3, 0.0, 0.0))
    aba, rnea = (sample_kernel(variant(SPECS[name], ())) for name in ("aba", "rnea"))
    assert aba(model.address, q, v, tau, a) == 0 == rnea(model.address, q, v, a, found)
    assert found == pytest.approx(tau, abs=1e-6)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(300):
        aba(model.address, q, v, tau, a)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 20_000  # kB; a leak takes 90 MB

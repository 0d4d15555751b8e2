"""Where shapes stand: by numbers without symmetry, so that no transposed or mirrored rotation looks the same."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from asymmetric import primes, roots

from spatialdyn.model.robot_checks import rpy_matrix
from spatialdyn.pictures.inertia_shapes import bar, turned_to

pytest.importorskip("trimesh")

from spatialdyn.pictures.shapes import urdf_shapes


def test_an_origin_takes_every_corner_to_its_place() -> None:
    size, xyz, rpy = primes(3), roots(3), (0.3, -0.5, 0.9)
    box = f'<geometry><box size="{" ".join(map(str, size))}"/></geometry>'
    origin = f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
    (shape,), *_ = urdf_shapes(f'<robot name="r"><link name="a"><visual>{origin}{box}</visual></link></robot>')
    corners = np.array([*itertools.product((-0.5, 0.5), repeat=3)]) * size
    wanted = corners @ rpy_matrix(*rpy).T + xyz
    apart = np.linalg.norm(shape.vertices[:, None] - wanted, axis=2)
    assert apart.min(axis=1).max() < 1e-6  # each vertex is a corner
    assert apart.min(axis=0).max() < 1e-6  # and each corner there


@pytest.mark.parametrize("direction", [*np.eye(3), *-np.eye(3), roots(3), -primes(3)], ids=str)
def test_what_stands_along_a_direction_is_turned_there_and_not_mirrored(direction: np.ndarray) -> None:
    R = turned_to(direction)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R[:, 2], direction / np.linalg.norm(direction), atol=1e-15)
    start = roots(3, after=20)
    vertices, _ = bar(start, start + direction, 0.01)
    along = (vertices - start) @ direction / (direction @ direction)
    assert (along.min(), along.max()) == pytest.approx((0.0, 1.0))
    assert np.linalg.norm(vertices - start - along[:, None] * direction, axis=1).max() <= 0.01 + 1e-12

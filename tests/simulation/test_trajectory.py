"""Files of trajectories: what is damaged, missing or something else is refused, and nothing of it is read."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scenes
from combinations import options, robot, start

import spatialdyn as sd

FLIPS = 300


@pytest.fixture
def run() -> sd.Trajectory:
    """With states and contacts."""
    model = sd.load_urdf("two_link")
    touching = sd.Contacts(model, {"tip": 0.1}, terrain=sd.Plane(height=-3.0))
    method = "semi_implicit_euler"
    given = {"contacts": touching, "record": ("work", "contacts")}
    return scenes.simulate(model, [0.5, -0.3], [1.0, 2.0], 0.05, 0.01, method, **given)  # type: ignore[arg-type]


def same(a: Any, b: Any) -> bool:
    """Whether two trajectories hold the same numbers."""
    plain = all(
        np.array_equal(getattr(a, x), getattr(b, x), equal_nan=True) for x in ("t", "q", "v", "p", "tau", "energy")
    )
    words = all(getattr(a, x) == getattr(b, x) for x in ("method", "dt", "robot", "interrupted"))
    states = a.states.keys() == b.states.keys() and all(np.array_equal(x, b.states[k]) for k, x in a.states.items())
    return plain and words and states and all(map(np.array_equal, a.contacts, b.contacts))


def test_a_flipped_bit_is_refused_or_changes_nothing(run: sd.Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    run.save(path)
    assert same(sd.Trajectory.load(path), run)
    whole, rng, refused = path.read_bytes(), np.random.default_rng(0), 0
    for k in range(FLIPS):
        damaged = bytearray(whole)
        for at in rng.integers(len(whole), size=1 + k % 3):
            damaged[at] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        try:
            assert same(sd.Trajectory.load(path), run)
        except sd.SpatialDynError:
            refused += 1
    assert refused > FLIPS // 2


def test_a_file_that_ends_early_is_refused(run: sd.Trajectory, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    run.save(path)
    whole = path.read_bytes()
    for end in range(0, len(whole), max(1, len(whole) // 50)):
        path.write_bytes(whole[:end])
        with pytest.raises(sd.SpatialDynError, match="holds no trajectory"):
            sd.Trajectory.load(path)


OTHER: dict[str, Callable[[dict[str, Any]], Any]] = {
    "q has dtype": lambda x: x.update(q=x["q"].astype(complex)),
    "of text": lambda x: x.update(q=x["q"].astype(str)),
    "of other rows": lambda x: x.update(v=x["v"][1:]),
    "of other axes": lambda x: x.update(t=x["t"][:, None]),
    "of other columns": lambda x: x.update(v=x["v"][:, :1]),
    "without one": lambda x: x.pop("tau"),
    "with one more": lambda x: x.update(extra=np.zeros(3)),
    "a number for a name": lambda x: x.update(method=np.array(3)),
    "a name for a number": lambda x: x.update(dt=np.array("x")),
    "several steps": lambda x: x.update(dt=np.ones(2)),
    "states of other rows": lambda x: x.update({"state work_torque": np.zeros((2, 2))}),
    "half of the contacts": lambda x: x.pop("contact gap"),
    "springs of other axes": lambda x: x.update(spring_energy=np.zeros((3, 3))),
}


@pytest.mark.parametrize("what", OTHER)
def test_arrays_that_make_no_trajectory_are_refused(run: sd.Trajectory, tmp_path: Path, what: str) -> None:
    path = tmp_path / "run.npz"
    run.save(path)
    with np.load(path) as parts:
        arrays = dict(parts)
    np.savez(path, **arrays)
    assert same(sd.Trajectory.load(path), run)
    OTHER[what](arrays)
    np.savez(path, **arrays)
    with pytest.raises(sd.SpatialDynError, match="holds no trajectory"):
        sd.Trajectory.load(path)


def test_an_archive_of_other_files_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    for how in (zipfile.ZIP_STORED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2):
        with zipfile.ZipFile(path, "w", how) as archive:
            archive.writestr("q.npy", b"no array")
        with pytest.raises(sd.SpatialDynError, match="holds no trajectory"):
            sd.Trajectory.load(path)


def test_what_is_no_file_is_refused_by_name(run: sd.Trajectory, tmp_path: Path) -> None:
    for path in (
        tmp_path / "none.npz",
        tmp_path,
        tmp_path / "no folder" / "run.npz",
        str(tmp_path / "nul\0"),
        "\udc80x",
    ):
        with pytest.raises(sd.SpatialDynError, match="holds no trajectory"):
            sd.Trajectory.load(path)
    (tmp_path / "folder.npz").mkdir()
    for path in (tmp_path / "folder.npz", tmp_path / "no folder" / "run.npz", str(tmp_path / "nul\0.npz")):
        with pytest.raises(sd.SpatialDynError, match="cannot be written"):
            run.save(path)
    with pytest.raises(sd.SpatialDynError, match=r"expected a name that ends in \.npz"):
        run.save(tmp_path)


def test_a_number_is_no_file(run: sd.Trajectory) -> None:
    """It would be an open file of the process, closed behind its back."""
    reading, writing = os.pipe()
    try:
        for call in (sd.Trajectory.load, run.save):
            with pytest.raises(sd.SpatialDynError, match=f"^path is {writing}, expected the name of a file$"):
                call(writing)  # type: ignore[arg-type]
        os.write(writing, b"x")  # still open
        assert os.read(reading, 1) == b"x"
    finally:
        os.close(reading)
        os.close(writing)


@pytest.mark.parametrize("effect", ["couplers", "contacts", "lugre", "current", "fext", "limits"])
def test_a_file_has_the_scene_of_the_run(tmp_path: Path, effect: str) -> None:
    model = robot("arm")
    scene = sd.Scene(model, **{"friction": False, **options(model, effect)})
    run = sd.simulate(scene, *start(model), 5e-3, 1e-3)
    run.save(tmp_path / "run.npz")
    read = sd.Trajectory.load(tmp_path / "run.npz", robot("arm"))
    assert read.scene == scene
    again = sd.simulate(read.scene, *start(model), 5e-3, 1e-3)
    np.testing.assert_array_equal(again.q, read.q)
    assert sd.Trajectory.load(tmp_path / "run.npz").scene is None
    with pytest.raises(sd.ModelError, match='holds a run of robot "arm", expected one of this model "arm" with its nu'):
        sd.Trajectory.load(tmp_path / "run.npz", model.with_(gravity=(0, 0, 0)))
    replace(run, scene=None).save(tmp_path / "bare.npz")
    with pytest.raises(sd.ModelError, match="holds no scene"):
        sd.Trajectory.load(tmp_path / "bare.npz", model)

"""Recordings: what is refused and where, files, saturation, uneven times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spatialdyn as sd

T = np.linspace(0.0, 1.0, 51)
Q = np.stack([np.sin(T), np.cos(T)], 1)


def test_the_row_and_column_of_what_is_no_number_are_named() -> None:
    bad = Q.copy()
    bad[7, 1] = np.nan
    with pytest.raises(sd.IdentificationError, match="tau is nan in row 7, column 1"):
        sd.Recording(T, Q, bad)
    with pytest.raises(sd.IdentificationError, match="row 3, expected times that increase"):
        sd.Recording(np.where(np.arange(51) == 3, T[2], T), Q, Q)
    with pytest.raises(sd.ShapeError, match=r"v has shape \(50, 2\)"):
        sd.Recording(T, Q, Q, Q[1:])
    with pytest.raises(sd.IdentificationError, match="5 or more"):
        sd.Recording(T[:4], Q[:4], Q[:4])


def test_uneven_times_are_refused_or_put_on_a_grid() -> None:
    t = T + 0.004 * np.sin(40.0 * T)
    with pytest.raises(sd.IdentificationError, match="resample=True"):
        sd.Recording(t, Q, Q)
    log = sd.Recording(t, t[:, None], t[:, None], resample=True)
    assert abs(log.q[:, 0] - log.t).max() < 1e-15  # a straight line stays one
    assert abs(np.diff(log.t) - log.dt).max() < 1e-15
    model = sd.load_urdf("two_link")
    assert not sd.Recording(t, Q, Q, resample=True).check(model)
    left = np.delete(np.arange(51), [7, 20, 21, 22])
    (note,) = sd.Recording(T[left], Q[left], Q[left], resample=True).check(model)
    assert "t has 2 gaps, the longest of 0.08 s from 0.38 s on, among steps of 0.02 s: filled" in note


def test_a_torque_that_is_one_number_or_stands_at_its_extreme_is_named() -> None:
    model = sd.load_urdf("two_link")
    tau = Q.copy()
    tau[:, 1] = 3.0
    with pytest.raises(sd.IdentificationError, match='torque of joint "joint2" is 3 in every sample'):
        sd.Recording(T, Q, tau).check(model)
    tau[:, 1] = 0.0
    (note,) = sd.Recording(T, Q, tau).check(model)
    assert 'torque of joint "joint2" is 0 in every sample while it moves' in note
    assert not sd.Recording(T, Q * [1.0, 0.0], tau).check(model)  # at rest
    notes = sd.Recording(T, Q, np.minimum(Q, 0.6)).check(model)
    assert [x for x in notes if "joint1" in x and "saturated" in x]
    assert not sd.Recording(T, Q, Q).check(model)
    with pytest.raises(sd.ShapeError, match="q has 2 columns, expected 1"):
        sd.Recording(T, Q, Q).check(sd.load_urdf("pendulum"))


def test_positions_and_velocities_that_do_not_fit_are_noted() -> None:
    model, slope = sd.load_urdf("two_link"), np.stack([np.cos(T), -np.sin(T)], 1)
    assert not sd.Recording(T, Q, Q, slope).check(model)
    for v in (-slope, np.degrees(slope), slope[:, ::-1], 0.0 * slope):
        notes = sd.Recording(T, Q, Q, v).check(model)
        assert 'velocity of joint "joint1" is not the slope of its position' in notes[0]
    still = 1e-6 * np.random.default_rng(0).normal(size=Q.shape)
    assert not sd.Recording(T, Q * [1.0, 0.0] + still, Q, slope * [1.0, 0.0] + 1e3 * still).check(model)
    limited = sd.ModelBuilder("arm").add_body("b", None, "revolute", (0, 1, 0), limits=(-1.0, 1.0)).build()
    assert not sd.Recording(T, Q[:, :1], Q[:, :1]).check(limited)
    (note,) = sd.Recording(T, np.degrees(Q[:, :1]), Q[:, :1]).check(limited)
    assert 'position of joint "b_joint" goes from 0 to 48.21, beyond its limits -1 to 1: degrees' in note


def test_files_give_the_bits_back(tmp_path: Path) -> None:
    log = sd.Recording(T, Q, 2.0 * Q, 3.0 * Q, 4.0 * Q)
    log.save(tmp_path / "log.csv")
    again = sd.Recording.load(tmp_path / "log.csv")
    for name in ("t", "q", "tau", "v", "a"):
        assert np.array_equal(getattr(again, name), getattr(log, name)), name
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"t": T, "q0": Q[:, 0], "q1": Q[:, 1], "tau0": 2.0 * Q[:, 0], "tau1": 2.0 * Q[:, 1]})
    assert np.array_equal(sd.Recording.from_columns(frame).q, Q)
    pytest.importorskip("pyarrow")
    frame.to_parquet(tmp_path / "log.parquet")
    assert np.array_equal(sd.Recording.load(tmp_path / "log.parquet").tau, log.tau)


def test_columns_may_have_names_of_joints() -> None:
    columns = {"t": T, "q_joint2": Q[:, 1], "q_joint1": Q[:, 0], "tau0": Q[:, 0], "tau1": Q[:, 1]}
    assert np.array_equal(sd.Recording.from_columns(columns, sd.load_urdf("two_link")).q, Q)
    del columns["q_joint1"]
    with pytest.raises(sd.IdentificationError, match="columns have no q_joint1"):
        sd.Recording.from_columns(columns, sd.load_urdf("two_link"))


def test_a_column_twice_a_byte_order_mark_and_an_empty_file(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    sd.Recording(T, Q, 2.0 * Q, 3.0 * Q).save(path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("v1", "q0", 1), encoding="utf-8")
    with pytest.raises(sd.IdentificationError, match="columns have q0 2 times, expected each name once"):
        sd.Recording.load(path)
    path.write_text(text, encoding="utf-8-sig")
    assert np.array_equal(sd.Recording.load(path).tau, 2.0 * Q)
    for nothing in ("", "\n", "t,q0,tau0\n", "t,q0,tau0\n\n"):
        path.write_text(nothing, encoding="utf-8")
        with pytest.raises(sd.SpatialDynError, match="is empty"):
            sd.Recording.load(path)


def test_columns_of_numbers_and_of_joints_are_not_mixed_and_what_is_missing_is_named() -> None:
    model = sd.load_urdf("two_link")
    numbers: dict[str, Any] = {"t": T, "q0": Q[:, 0], "q1": Q[:, 1], "tau0": T, "tau1": T}
    for more, said in (
        ({"q_joint1": Q[:, 0], "q_joint2": Q[:, 1]}, "columns have q0 and q_joint1, expected numbers or names"),
        ({"v1": T}, "columns have no v0, expected it among v0, v1"),
        ({"a0": ["x"] * 51}, "column a0 cannot be read as numbers"),
        ({"t": T.astype("datetime64[s]")}, "column t is of times"),
        ({"wrench_tip_3": T}, "columns have no wrench_tip_0, expected six"),
    ):
        with pytest.raises(sd.IdentificationError, match=said):
            sd.Recording.from_columns({**numbers, **more}, model)
    others: dict[str, Any] = {"state": ["running"] * 51, "q_wanted": T}
    assert np.array_equal(sd.Recording.from_columns({**numbers, **others}, model).q, Q)  # left alone


def test_csv_files_of_other_programs(tmp_path: Path) -> None:
    """Semicolons, tabs, remarks, names as NumPy writes them, columns of words; what is no number has its line."""
    path, log = tmp_path / "log.csv", sd.Recording(T, Q, 2.0 * Q, wrenches={"tip": np.tile(T[:, None], (1, 6))})
    log.save(path)
    assert np.array_equal(sd.Recording.load(path).wrenches["tip"], log.wrenches["tip"])
    sd.Recording(T, Q, 2.0 * Q).save(path)
    text = path.read_text(encoding="utf-8")
    lines = text.splitlines()
    for other in (
        text.replace(",", ";"), text.replace(",", "\t"), "# of a robot\n" + text, "# " + text,
        "\n".join([lines[0] + ",state", *(line + ",on" for line in lines[1:])]),
    ):  # fmt: skip
        path.write_text(other, encoding="utf-8")
        assert np.array_equal(sd.Recording.load(path).tau, 2.0 * Q)
    for wrong, said in (
        (text.replace(lines[7], "0.12,1,,2,3"), "has '' in line 8, column q1, expected a number"),
        (text.replace(lines[7], "0.12,1,2"), "has 3 cells in line 8 under 5 names"),
        ("\n".join(lines[1:]), "begins with 0, expected a line of names"),
        (text.replace(",", ";").replace(".", ","), r"has '0,0\d*' in line 3, column t, expected a number"),
    ):
        path.write_text(wrong, encoding="utf-8")
        with pytest.raises(sd.SpatialDynError, match=said):
            sd.Recording.load(path)


def test_a_simulation_is_a_recording() -> None:
    run = sd.simulate(sd.load_urdf("two_link"), [0.5, -0.3], [0.0, 0.0], 0.1, 0.01)
    log = sd.Recording.of(run)
    assert np.array_equal(log.q, run.q)
    assert log.dt == pytest.approx(0.01)


def test_commanded_torques_of_motors_are_no_measured_ones() -> None:
    motor = sd.Motor([0.1, 0.1], [1.0, 1.0], [24.0, 24.0], 1.0, torque=[15.0, 15.0])
    scene = sd.Scene(sd.load_urdf("two_link"), motor=motor)
    tau = np.stack([40.0 * np.sin(3.0 * T), 20.0 * np.cos(5.0 * T)], 1)[1:]
    log = sd.Recording.of(sd.simulate(scene, [0.5, -0.3], [0.0, 0.0], 1.0, 0.02, torque=tau))
    with pytest.raises(sd.IdentificationError, match="run with motors, whose tau is the commanded torque"):
        sd.identify(log, scene.model, hold="after")

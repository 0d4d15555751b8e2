"""The momentum observer against the filter that it is, and what is made of its residual; the base of a free robot."""

from __future__ import annotations

import numpy as np
import pytest

import spatialdyn as sd

GAIN = 25.0  # 1/s


def satellite(rotor: float | None = None) -> sd.Model:
    """A floating body with an arm of two joints."""
    solid = (1.0, (0.1, 0.2, 0.0), np.diag([0.1, 0.2, 0.15]))
    builder = sd.ModelBuilder("satellite", "world").add_body(
        "bus", None, "floating", inertia=(5.0, (0.1, 0, 0), np.eye(3))
    )
    geared = None if rotor is None else sd.Rotor(rotor, 50.0, (0.0, 0.6, 0.8))
    builder.add_body("upper", "bus", axis=(0, 1, 0), placement=(0.5, 0, 0), inertia=solid, rotor=geared)
    return builder.add_body("fore", "upper", axis=(1, 0, 1), placement=(0, 0.4, 0), inertia=solid).build()


def pushed(
    model: sd.Model, q0: np.ndarray, h: float, push: np.ndarray, duration: float = 0.4
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals of a motion under a constant torque that the observer is not told of, and their times."""
    tau = 0.3 * np.ones(model.nv)
    run = sd.simulate(model, q0, np.zeros(model.nv), duration, h, "rk4", torque=tau + push)
    observer = sd.MomentumObserver(model, GAIN, h)
    found = np.array([observer.update(q, v, tau) for q, v in zip(run.q, run.v, strict=True)])
    return run.t, found


@pytest.mark.parametrize("name", ["two_link", "satellite"])
def test_the_residual_is_the_filtered_torque_to_order_two(name: str) -> None:
    model = satellite() if name == "satellite" else sd.load_urdf(name)
    q0 = sd.integrate(model, sd.neutral(model), 0.3 * np.ones(model.nv))
    push = np.linspace(1.0, -0.5, model.nv)
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        t, found = pushed(model, q0, h, push)
        errors.append(abs(found - push * (1.0 - np.exp(-GAIN * t))[:, None]).max())
    assert errors[-1] < 2e-4  # of a torque of 1 N m
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(2.0, abs=0.15)


def test_an_observer_of_a_batch_is_one_for_each_sample() -> None:
    model, draw = sd.load_urdf("ur5"), np.random.default_rng(0)
    q, v, tau = (draw.normal(size=(5, 3, model.nv)) for _ in range(3))
    together = sd.MomentumObserver(model, GAIN, 1e-3)
    each = [sd.MomentumObserver(model, GAIN, 1e-3) for _ in range(3)]
    for k in range(5):
        found = together.update(q[k], v[k], tau[k])
        alone = [x.update(q[k, j], v[k, j], tau[k, j]) for j, x in enumerate(each)]
        assert (found == alone).all()


@pytest.mark.slow(quick="test_an_observer_of_a_batch_is_one_for_each_sample")
def test_the_kernel_and_the_c_source_are_the_same_step() -> None:
    import numba

    model, draw = sd.load_urdf("two_link"), np.random.default_rng(1)
    q, v, tau = draw.normal(size=(3, 2))
    memory = draw.normal(size=6)
    want = sd.momentum_observer_step(model, q, v, tau, [GAIN, GAIN], 1e-3, memory)
    kernel = sd.MomentumObserver.kernel()

    @numba.njit
    def loop(bodies, q, v, tau, gain, dt, memory, after):  # type: ignore[no-untyped-def]
        kernel(bodies, q, v, tau, gain, dt, memory, after)

    after = np.empty(6)
    loop(model.bodies, q, v, tau, np.full(2, GAIN), 1e-3, memory, after)
    assert abs(after - want).max() < 1e-14 * abs(want).max()
    text = sd.specialize(model, sd.momentum_observer_step).c_code()
    assert "momentum_observer_step" in text


def test_the_force_on_a_tool_is_felt() -> None:
    model, q = sd.load_urdf("ur5"), np.array([0.1, -1.0, 1.2, 0.3, 0.5, 0.2])
    push = np.array([5.0, 1.0, -2.0, 0.1, 0.2, 0.0])
    r = sd.frame_jacobian(model, q, "tool0").T @ push
    found = sd.contact_wrench(model, q, r, "tool0")
    assert abs(found.wrench - push).max() < 1e-12
    assert found.rank == 6
    assert abs(found.error).max() < 1e-12
    batch = sd.contact_wrench(model, np.stack([q, q + 0.1]), r, "tool0")
    assert batch.wrench.shape == (2, 6)


def test_what_joints_cannot_tell_is_named() -> None:
    model, q = sd.load_urdf("two_link"), np.array([0.3, 0.8])
    r = sd.frame_jacobian(model, q, "tip").T @ np.array([1.0, 0, 0, 0, 0, 0])
    with pytest.raises(sd.ConstraintError, match='upstream of "tip" determine 2 of 6 directions'):
        sd.contact_wrench(model, q, r, "tip")
    found = sd.contact_wrench(model, q, r, "tip", least=True)
    assert found.rank == 2
    assert abs(found.error).max() < 1e-12
    assert (abs(found.missing).max(-1) > 0.0).sum() == 4


def test_observers_refuse_what_is_none() -> None:
    model = sd.load_urdf("two_link")
    with pytest.raises(sd.SpatialDynError, match=r"gain is .* expected finite numbers above 0"):
        sd.MomentumObserver(model, [1.0, 0.0], 1e-3)
    with pytest.raises(sd.SpatialDynError, match="dt is -1"):
        sd.MomentumObserver(model, 1.0, -1)
    observer = sd.MomentumObserver(model, 1.0, 1e-3)
    observer.update([0.0, 0.0], [0.0, 0.0], [1.0, 0.0])
    before = observer.memory
    with pytest.raises(sd.NonFiniteError, match="v has numbers"):
        observer.update([0.0, 0.0], [np.nan, 0.0], [0.0, 0.0])
    assert observer.memory is before
    with pytest.raises(sd.ShapeError, match="residuals has shape"):
        sd.detection_thresholds([1.0])


@pytest.mark.parametrize("rotor", [None, 1e-4])
def test_the_base_moves_so_that_momentum_is_what_it_is(rotor: float | None) -> None:
    model, draw = satellite(rotor), np.random.default_rng(2)
    q = sd.integrate(model, sd.neutral(model), draw.normal(size=(20, model.nv)))
    joints, h = draw.normal(size=(20, model.nv - 6)), draw.normal(size=(20, 6))
    v = np.concatenate([sd.base_velocity(model, q, joints, h), joints], -1)
    assert abs(sd.centroidal_momentum(model, q, v) - h).max() < 1e-13
    # the rows of M, with h in the base's frame: E.3 of the chapter
    M, p = sd.crba(model, q), sd.momentum(model, q, v)
    again = np.linalg.solve(M[:, :6, :6], (p[:, :6] - (M[:, :6, 6:] @ joints[..., None])[..., 0])[..., None])[..., 0]
    assert abs(again - v[:, :6]).max() < 1e-12


def test_base_velocity_refuses_a_robot_on_a_pedestal() -> None:
    with pytest.raises(sd.ModelError, match='"two_link" has no floating base'):
        sd.base_velocity(sd.load_urdf("two_link"), [0.0, 0.0], [], np.zeros(6))
    with pytest.raises(sd.ShapeError, match="v_joints has shape"):
        sd.base_velocity(satellite(), sd.neutral(satellite()), [1.0], np.zeros(6))


def test_all_updates_of_an_observer_are_of_the_same_samples() -> None:
    model = sd.load_urdf("two_link")
    for first, then in (((), (3,)), ((3,), ()), ((3,), (2,))):
        observer = sd.MomentumObserver(model, 10.0, 0.01)
        before = observer.update(*np.zeros((3, *first, 2)))
        with pytest.raises(sd.ShapeError, match=r"have axes of samples .* expected those of the updates before"):
            observer.update(*np.ones((3, *then, 2)))
        assert observer.update(*np.zeros((3, *first, 2))).shape == before.shape
        observer.reset()
        assert observer.update(*np.zeros((3, *then, 2))).shape == (*then, 2)

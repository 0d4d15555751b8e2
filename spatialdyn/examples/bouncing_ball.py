"""A ball that bounces: where its impacts are, and when infinitely many of them are over.

Learn    sd.Contacts with restitution, method="semi_implicit_euler", record="contacts", Trajectory.contacts.
Look at  the times: √(2h/g), then twice that, and half as long each time. Their sum is finite, so is the number of
         steps, and the ball comes to rest; no event is searched for, and what an impact takes is in its impulse.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write


def main(save: str | None = None) -> dict[str, np.ndarray]:
    """Drop a ball from 1 m and compare with the geometric series; returns times, heights and impulses."""
    radius, mass, e, dt = 0.05, 0.5, 0.5, 1e-4
    builder = sd.ModelBuilder("ball")
    builder.add_body("ball", None, "floating", inertia=(mass, (0, 0, 0), np.eye(3) * 0.4 * mass * radius**2))
    model = builder.build()
    contacts = sd.Contacts(model, {"ball": radius}, restitution=e)
    q0 = np.array([0.0, 0.0, 1.0 + radius, 0.0, 0.0, 0.0, 1.0])
    run = sd.simulate(
        sd.Scene(model, contacts=contacts), q0, np.zeros(6), 1.6, dt, "semi_implicit_euler", record=(1, "contacts")
    )
    assert run.contacts is not None
    height, impulse = run.q[:, 2] - radius, run.contacts.impulse[:, 0, 2]
    hits = np.flatnonzero((run.v[:-1, 2] < 0.0) & (run.v[1:, 2] > 0.0)) + 1
    fall = np.sqrt(2.0 / 9.81)
    wanted = fall * np.cumsum([1.0, *(2.0 * e**k for k in range(1, len(hits)))])
    print("impact   at [s]   series [s]   impulse [N s]   (1 + e) m v [N s]")
    for k, hit in enumerate(hits[:5]):
        hard = (1.0 + e) * mass * np.sqrt(2.0 * 9.81) * e**k
        print(f"{k + 1:6} {run.t[hit]:8.4f} {wanted[k]:12.4f} {impulse[hit]:15.4f} {hard:19.4f}")
    rest = run.t[np.flatnonzero(abs(run.v[:, 2]) > 1e-9)[-1]]
    print(f"at rest after {rest:.4f} s; the series ends at {fall * (1.0 + 2.0 * e / (1.0 - e)):.4f} s")
    if save:
        figure, axes = picture(2, width=10.0)
        axes[0].plot(run.t, height)
        axes[0].set(xlabel="t [s]", ylabel="height [m]", title="a ball, e = 0.5")
        axes[1].semilogy(run.t[hits], impulse[hits], "o")
        axes[1].set(xlabel="t [s]", ylabel="impulse [N s]", title="its impacts")
        write(figure, save)
    return {"t": run.t, "height": height, "hits": run.t[hits], "impulse": impulse[hits], "rest": rest}


if __name__ == "__main__":
    start(main)

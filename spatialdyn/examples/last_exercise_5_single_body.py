"""Exercise 5 of the last list: one free body, from Lagrange to Euler-Poincaré to the recursion.

Learn    a floating body's v is a twist in its own frame, no q̇: nq is 7, nv 6. Its equation is ξ ↦ G ξ̇ = ad*_ξ G ξ, and
         aba solves it; nothing of Lagrange's d/dt ∂L/∂q̇ in coordinates is left.
Look at  the sign. ad*_ω (I ω) = (I ω) × ω, so that I ω̇ + ω × I ω = τ. The chapter's section 14.2 has the other sign in
         its first line, d/dt (I ω) = ω × (I ω) + τ, and the right one in its second. With the wrong one the angular
         momentum in the world would not be constant: the last rows. Energy does not see it: ω·(ω × I ω) = 0 both ways.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write


def main(save: str | None = None) -> dict[str, np.ndarray]:
    """Print accelerations both ways and what a motion keeps; returns them, and the motion's spins."""
    I = np.diag([1.0, 2.0, 3.0])  # about the middle axis no rotation lasts
    body = sd.ModelBuilder("body").set_inertia("base", (4.0, (0, 0, 0), I))
    model = body.build(root="floating", gravity=(0, 0, 0))
    omega = np.array([0.02, 3.0, 0.01])
    q, v = sd.neutral(model), np.concatenate([np.zeros(3), omega])
    library = sd.aba(model, q, v, np.zeros(6))[3:]
    euler, chapter = (sign * np.linalg.solve(I, np.cross(omega, I @ omega)) for sign in (-1.0, 1.0))
    print(f"nq {model.nq}, nv {model.nv}: the position is no vector whose rate is v")
    print(f"ω̇ by aba                    {library}")
    print(f"ω̇ by -I⁻¹ (ω × I ω)         {euler}")
    print(f"ω̇ by section 14.2, line one {chapter}")

    run = sd.simulate(model, q, v, 16.0, 2e-3, "variational")
    R = sd.frame_placement(model, run.q, "base")[:, :3, :3]
    L = np.einsum("nij,jk,nk->ni", R, I, run.v[:, 3:])  # angular momentum in the world
    # a wrong sign turns the rate of L, zero, into 2 ω × I ω in the body's axes
    wrong = 2.0 * np.linalg.norm(np.cross(run.v[:, 3:], run.v[:, 3:] @ I), axis=1).max()
    middle = run.v[:, 4]
    print(f"in 16 s: ω about the middle axis {middle[0]:.2f} to {middle.min():.2f} to {middle[-1]:.2f} rad/s")
    print(f"L in the world changes by {abs(L - L[0]).max():.1e} of {np.linalg.norm(L[0]):.2f} kg m²/s")
    print(f"with the other sign it would by up to {wrong:.2f} kg m²/s every second")
    if save:
        figure, axes = picture()
        axes.plot(run.t, run.v[:, 3:], label=["x", "y, the middle axis", "z"])
        axes.set(xlabel="t [s]", ylabel="ω in the body [rad/s]", title="a free body turns over and back")
        axes.legend()
        write(figure, save)
    return {"library": library, "euler": euler, "chapter": chapter, "L": L, "omega": run.v[:, 3:], "I": I}


if __name__ == "__main__":
    start(main)

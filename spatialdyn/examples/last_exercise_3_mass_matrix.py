"""Exercise 3 of the last list: is M right? Kinetic energies, eigenvalues, and Ṁ - 2C by a difference of M.

Learn    which checks see what. T(e_i) = ½ M_ii, the chapter's (b), sees the diagonal alone: an M whose other entries
         are all wrong passes. T(e_i + e_j) sees the rest.
Look at  (d): the quotient (M(q + ε q̇) - M(q)) / ε is best at ε near 1e-8 and has 8 digits there, no more; larger steps
         truncate, smaller ones cancel. mass_matrix_dot has no step. And the chapter's table A.3 gives as a third way
         to C "[M(q + ε e_j) - M(q - ε e_j)] / 2ε": that is ∂M/∂q_j, a matrix for every j and without q̇, no C at all.
"""

from __future__ import annotations

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import picture, start, write


def main(save: str | None = None) -> dict[str, np.ndarray]:
    """Print (a) to (d); returns M, what the checks saw, and errors of the quotient by step."""
    model, eye = sd.load_urdf("three_link"), np.eye(3)
    q, v = np.array([0.5, 0.3, -0.2]), np.array([1.0, -0.5, 0.3])
    M = sd.crba(model, q)
    T = np.asarray(sd.kinetic_energy(model, q, eye))  # a batch: T(e_1), T(e_2), T(e_3)
    pairs = np.asarray(sd.kinetic_energy(model, q, eye[:, None] + eye))  # (3, 3): T(e_i + e_j)
    polarised = pairs - T[:, None] - T  # (e_i)ᵀ M e_j, for T is a quadratic form
    wrong = np.diag(np.diag(M))  # every entry off the diagonal lost
    print(f"(a) M =\n{M.round(6)}")
    for name, A in {"M": M, "a wrong M": wrong}.items():
        diagonal, all_of_it = abs(T - np.diag(A) / 2).max(), abs(polarised - A).max()
        print(f"(b) {name:9}: T(e_i) off by {diagonal:.1e}, T(e_i + e_j) by {all_of_it:.1e}")
    print(f"(c) eigenvalues {np.linalg.eigvalsh(M)}")

    C, M_dot = sd.coriolis_matrix(model, q, v), sd.mass_matrix_dot(model, q, v)
    steps = 10.0 ** np.arange(-14, 0)
    ahead = sd.crba(model, sd.integrate(model, q, steps[:, None] * v))
    N = (ahead - M) / steps[:, None, None] - 2 * C
    errors = abs(N + np.swapaxes(N, 1, 2)).max((1, 2))
    exact = M_dot - 2 * C
    for step, error in zip(steps, errors, strict=True):
        print(f"(d) ε = {step:.0e}: |N + Nᵀ| = {error:.1e}")
    print(f"    mass_matrix_dot: |N + Nᵀ| = {abs(exact + exact.T).max():.1e}")
    if save:
        figure, axes = picture()
        axes.loglog(steps, errors, "o-")
        axes.set(xlabel="step ε [s]", ylabel="|N + Nᵀ|", title="Ṁ - 2C with Ṁ by a difference: best near 1e-8")
        write(figure, save)
    return {"M": M, "polarised": polarised, "T": T, "errors": errors, "exact": exact}


if __name__ == "__main__":
    start(main)

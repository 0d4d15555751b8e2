"""A Lagrangian network beside the model: it learns a friction that the model lacks, and a plain network learns all.

Learn    k.to_torch() is a function of tensors that autograd differentiates: M, C and g of the model stay as they are,
         and a network adds to Lagrange's equation a damping D(v) >= 0 of each joint, tau = -D(v) v. Whatever it holds,
         such a robot gains no energy. The plain network is free to say any acceleration.
Look at  the energy of a swing of 10 s that neither has seen: the plain network's drifts from the robot's, up too.
Needs    pip install torch
"""

from __future__ import annotations

from itertools import accumulate, pairwise
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write

DT, SWING, HELD = 0.02, 500, (np.array([2.0, 0.5]), np.zeros(2))  # [s] of measured states; steps predicted, from there


def friction(v: Any) -> Any:
    """Of the robot, not of the model: viscous, and Coulomb's next to rest."""
    return -0.1 * v - 0.4 * np.tanh(v / 0.2)


def runge_kutta(acceleration: Any, q: Any, v: Any) -> tuple[Any, ...]:
    """A step of DT of a state by the classical method."""
    rates, at = [], (q, v)
    for part in (0.5, 0.5, 1.0, 0.0):
        rates.append((at[1], acceleration(*at)))
        at = q + part * DT * rates[-1][0], v + part * DT * rates[-1][1]
    return tuple(x + DT / 6.0 * (a + 2.0 * b + 2.0 * c + d) for x, a, b, c, d in zip((q, v), *rates, strict=True))


def networks(torch: Any, k: sd.Specialized, width: int) -> dict[str, Any]:
    """Accelerations of a state by each of the two, and what is trained of it."""

    def layers(*sizes: int) -> Any:
        made = [x for a, b in pairwise(sizes) for x in (torch.nn.Linear(a, b), torch.nn.Tanh())]
        return torch.nn.Sequential(*made[:-1]).double()

    aba, damping, free = k.to_torch(), layers(2, width, 2), layers(6, width, width, 2)

    def lagrangian(q: Any, v: Any) -> Any:
        return aba(q, v, -torch.nn.functional.softplus(damping(v.abs())) * v)

    def plain(q: Any, v: Any) -> Any:
        return 10.0 * free(torch.cat([q.sin(), q.cos(), v], -1))

    return {"lagrangian": (lagrangian, [*damping.parameters()]), "plain": (plain, [*free.parameters()])}


def main(quick: bool = False, long: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print the energy of the swing by each way; returns the energies."""
    torch, model, rng = need("torch", "torch"), sd.load_urdf("two_link"), np.random.default_rng(0)
    torch.manual_seed(0)
    torch.set_num_threads(1)  # on networks as small as these, threads take longer
    k, n, steps, width = sd.specialize(model, sd.aba), 64, 60 if quick else 6000 if long else 400, 64 if long else 32
    ways: dict[str, Any] = {"robot": (lambda q, v: k(q, v, friction(v)), []), **networks(torch, k, width)}
    first, found = (rng.uniform(-3.0, 3.0, (n, 2)), rng.normal(scale=2.0, size=(n, 2))), dict[str, Any]()
    states = [*accumulate(range(99), lambda x, _: runge_kutta(ways["robot"][0], *x), initial=first)]
    before, behind = (torch.tensor(np.concatenate(x, 1).reshape(2, -1, 2)) for x in (states[:-1], states[1:]))
    for name, (acceleration, trained) in ways.items():
        optimizer: Any = torch.optim.Adam(trained, 0.005) if trained else None
        for _ in range(steps if trained else 0):
            chosen = rng.integers(before.shape[1], size=128)
            (q, v), later = before[:, chosen], behind[1, chosen]
            loss = ((acceleration(q + 0.5 * DT * v, 0.5 * (v + later)) - (later - v) / DT) ** 2).mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        path = [tuple(map(torch.tensor, HELD)) if trained else HELD]
        for _ in range(SWING):
            path.append(tuple(x.detach() if trained else x for x in runge_kutta(acceleration, *path[-1])))
        q, v = (np.array([np.asarray(x[i]) for x in path]) for i in range(2))
        found[name] = sd.kinetic_energy(model, q, v) + sd.potential_energy(model, q)
        print(f"{name:11}last energy {found[name][-1]:6.2f} J, most gained {np.diff(found[name]).max():.1e} J")
    if save:
        figure, axes = picture()
        for (name, energy), style in zip(found.items(), ("-", "--", ":"), strict=True):
            axes.plot(DT * np.arange(len(energy)), energy, style, label=name)
        axes.set(xlabel="time [s]", ylabel="energy of the model [J]", title="a swing with a friction that was learned")
        axes.legend(frameon=False)
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)

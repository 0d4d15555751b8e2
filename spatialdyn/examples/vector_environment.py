"""A reinforcement learning environment in 30 lines: many cart-poles that step at once, in Gymnasium's manner.

Learn    sd.step takes states of any batch shape: a vector environment is that call, a reward and a reset.
Look at  the steps per second, and the two policies: pushing at random drops the pole in a second, a linear law keeps it
         up. The interface is that of gymnasium.vector.VectorEnv (reset, step, the same five results; a finished
         episode restarts within the step and its last observation is in the info); gymnasium itself is not needed.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.cart_pole_lqr import cart_pole
from spatialdyn.examples.gallery import start

Array = np.ndarray


class CartPoles:
    """num_envs cart-poles; an action (num_envs, 1) in [-1, 1] pushes the cart with up to 10 N for 0.02 s."""

    def __init__(self, num_envs: int, horizon: int = 500) -> None:
        self.num_envs, self.horizon, self.model = num_envs, horizon, cart_pole()
        self.rng = np.random.default_rng()
        self.q, self.v, self.age = np.zeros((num_envs, 2)), np.zeros((num_envs, 2)), np.zeros(num_envs, int)

    def reset(self, seed: int | None = None, where: Any = slice(None)) -> tuple[Array, dict[str, Any]]:
        """Start all environments, or some, near upright; the observations (num_envs, 4)."""
        self.rng = self.rng if seed is None else np.random.default_rng(seed)
        self.q[where], self.v[where] = self.rng.uniform(-0.05, 0.05, (2, *self.q[where].shape))
        self.age[where] = 0
        return np.concatenate([self.q, self.v], 1), {}

    def step(self, actions: Array) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Observations, rewards, terminated, truncated, info."""
        tau = np.concatenate([10.0 * np.clip(actions, -1.0, 1.0), np.zeros((self.num_envs, 1))], 1)
        self.q, self.v = sd.step(self.model, self.q, self.v, tau, 0.02)
        self.age += 1
        terminated = np.any(abs(self.q) > [2.4, 0.21], axis=1)
        truncated = ~terminated & (self.age >= self.horizon)
        last = np.concatenate([self.q, self.v], 1)
        observations, _ = self.reset(where=terminated | truncated)
        return observations, np.ones(self.num_envs), terminated, truncated, {"final_obs": last}


def main(quick: bool = False) -> dict[str, Any]:
    """Run both policies and print the lengths of their episodes; returns them."""
    count, steps, found = (64, 500, {}) if quick else (4096, 1000, {})
    for name, gain in {"random": np.zeros(4), "linear": np.array([0.3, 4.0, 0.5, 0.9])}.items():
        environment, ended = CartPoles(count), 0
        x, _ = environment.reset(seed=0)
        begin = time.perf_counter()
        for _ in range(steps):
            noise = environment.rng.uniform(-1, 1, (count, 1)) if name == "random" else 0.0
            x, _, terminated, _, _ = environment.step(x @ gain[:, None] + noise)
            ended += int(terminated.sum())
        rate = count * steps / (time.perf_counter() - begin)
        found[name] = ended
        print(f"{name:7} {count} environments, {steps} steps: the pole fell {ended} times; {rate:.3g} steps/s")
    return found


if __name__ == "__main__":
    start(main)

"""The gradient of a design: how heavy and how far out a counterweight should be, found by JAX and by PyTorch.

Learn    specialize(..., inputs=["mass:JOINT", "com:JOINT"]) makes parameters of a body inputs of the program, and
         k.to_jax() or k.to_torch() a function that those frameworks differentiate, by its own vjp on lanes. The rest,
         a loss and a descent, is the framework's.
Look at  both gradients, equal to the last digits, and the torque of the shoulder that falls as the arm is balanced.
Needs    pip install jax torch
"""

from __future__ import annotations

from typing import Any

import numpy as np

import spatialdyn as sd
from spatialdyn.examples.gallery import need, picture, start, write

STEPS, RATE = 200, 0.01


def crane() -> sd.Model:
    """A boom with a forearm; what is fixed behind the shoulder is part of the boom."""
    builder = sd.ModelBuilder("crane")
    builder.add_body("boom", None, "revolute", (0, -1, 0), None, (3.0, (0.4, 0.0, 0.0), np.diag([0.01, 0.2, 0.2])))
    builder.add_body("forearm", "boom", "revolute", (0, -1, 0), (0.8, 0, 0), (1.5, (0.3, 0, 0), 0.05 * np.eye(3)))
    return builder.build()


def with_jax(k: sd.Specialized, state: Any) -> Any:
    """A function of the design, mass and place of its centre: the loss and its gradient, compiled by JAX."""
    jax, rnea = need("jax", "jax"), k.to_jax()

    def loss(x: Any) -> Any:
        return (rnea(*state, x[0], x[1] * np.eye(3)[0])[:, 0] ** 2).mean()

    step = jax.jit(jax.value_and_grad(loss))

    def in_float64(x: np.ndarray) -> Any:
        with jax.enable_x64(True):
            return [np.asarray(y) for y in step(x)]

    return in_float64


def with_torch(k: sd.Specialized, state: Any) -> Any:
    """The same in PyTorch."""
    torch, rnea = need("torch", "torch"), k.to_torch()

    def step(design: np.ndarray) -> Any:
        x = torch.tensor(design, requires_grad=True)
        loss = (rnea(*state, x[0], x[1] * torch.eye(3, dtype=x.dtype)[0])[:, 0] ** 2).mean()
        loss.backward()
        return loss.item(), x.grad.numpy()

    return step


def main(quick: bool = False, save: str | None = None) -> dict[str, Any]:
    """Print the first gradient of each framework and the design it finds; returns them, and the losses."""
    model, n, rng = crane(), 32 if quick else 256, np.random.default_rng(0)
    state = rng.uniform(-1.0, 1.0, (n, 2)), *rng.normal(size=(2, n, 2))
    boom, found = model.names[1], {}
    k = sd.specialize(model, sd.rnea, inputs=[f"mass:{boom}", f"com:{boom}"])
    print(k.signature)
    for name, made in {"jax": with_jax, "torch": with_torch}.items():
        step, x, losses, first = made(k, state), np.array([3.0, 0.4]), [], None
        for _ in range(20 if quick else STEPS):
            loss, gradient = step(x)
            first = gradient if first is None else first
            losses.append(float(loss))
            x = x - RATE * gradient / np.linalg.norm(gradient)
        found[name] = {"losses": losses, "gradient": first, "design": x}
        print(f"{name:6}gradient at first {first}; mass {x[0]:.3f} kg, centre at {x[1]:.3f} m: mean square torque "
              f"{losses[0]:.1f} -> {losses[-1]:.1f} N²m²")  # fmt: skip
    if save:
        figure, axes = picture()
        for name, style in (("jax", "-"), ("torch", ":")):
            axes.plot(found[name]["losses"], style, lw=1.2 if name == "jax" else 3.0, label=name)
        axes.set(xlabel="step", ylabel="mean square torque of the shoulder [N²m²]", title="balancing a crane")
        axes.legend(frameon=False)
        write(figure, save)
    return found


if __name__ == "__main__":
    start(main)

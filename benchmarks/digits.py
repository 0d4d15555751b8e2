"""Digits that programs keep: errors of batches on lanes against errors of single calls.

    python benchmarks/digits.py [--robots panda,ur5] [--roots fixed,floating] [--dtypes float64,float32] [--samples 16]

The worst error of a batch over random states and over straight ones (neutral, right angles, and nearly either) must be
at most 4 times that of single calls plus 4 eps; in float32 4 times the single call's error scaled to float32 plus 4 eps
of float32. The diagonal of M must be positive where the reference's is. Errors are those of ``accuracy.references``: of
M each entry over √(M_ii M_jj), else over the sample's largest entry; an error above 1 counts as 1: no digit is left.

Checks the robots of example-robot-data and chains of thin rods. Prints failures and, per call, the case that uses most
of its bound; the exit status is the number of failures. Needs example-robot-data and mpmath.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from accuracy import corpus
from numpy.typing import NDArray
from tables import Bar

import spatialdyn as sd
from spatialdyn.accuracy.references import of_calls, truths

Array = NDArray[np.float64]

TIMES = 4.0  # times the error of single calls
EPS = 4.0  # plus this many eps of the precision
LEAST = 512  # samples of a batch on lanes
FAR = 1e3  # rad; two quadrotors have limits of 1e16
THIN = (1e-6, 1e-9, 1e-12)  # inertia of a rod about itself; about its end it is 1/12
CALLS = {"rnea": "qva", "crba": "q", "aba": "qvt", "aba_refined": "qvt", "minverse": "q"}
DTYPES = {"float64": np.float64, "float32": np.float32}
AXES = np.eye(3)


class Judged(NamedTuple):
    """One call in one precision: the worst errors in units of its eps, and whether the diagonal of M is positive."""

    single: float
    batch: float
    positive: bool = True

    @property
    def share(self) -> float:
        """The part of the bound that is used."""
        return self.batch / (TIMES * self.single + EPS) if self.positive else np.inf


def rods(n: int, thin: float) -> sd.Model:
    """Thin rods end to end, hinged about x (along them) and y in turn."""
    made = sd.ModelBuilder(f"{n} rods of {thin:g}")
    for k in range(n):
        rod = (1.0, (0.25, 0.0, 0.0), np.diag([thin, 1 / 48, 1 / 48]))
        made.add_body(f"l{k}", f"l{k - 1}" if k else None, "revolute", AXES[k % 2], (0.5 if k else 0.0, 0.0, 0.0), rod)
    return made.build()


def poses(model: sd.Model, samples: int, rng: np.random.Generator) -> Array:
    """Random, neutral, right angles, nearly neutral, nearly right angles: so many of each, in a row."""
    random = sd.random_configuration(model, rng, samples).copy()
    random[abs(random) > FAR] = 0.3
    found = [random]
    hinges = [j.idx_q for j in model.joints[1:] if j.kind in ("revolute", "continuous") and j.nq == 1]
    slides = [j.idx_q for j in model.joints[1:] if j.kind == "prismatic"]
    for turned in (False, True):
        for near in (0.0, 1.0):
            q = np.repeat(sd.neutral(model)[None], samples, axis=0)
            angles = 0.5 * np.pi * rng.integers(-1, 3, (samples, len(hinges))) if turned else 0.0
            q[:, hinges] = angles + near * 10.0 ** -rng.uniform(1, 9, (samples, 1)) * rng.normal(
                size=(samples, len(hinges))
            )
            q[:, slides] = random[:, slides]
            found.append(q)
    return np.concatenate(found)


def states(model: sd.Model, samples: int, seed: int = 0) -> dict[str, Array]:
    """All poses, with velocities, accelerations and torques, by letter."""
    rng = np.random.default_rng(seed)
    q = poses(model, samples, rng)
    return {"q": q, **{letter: rng.normal(size=(len(q), model.nv)) for letter in "vat"}}


def judged(model: sd.Model, name: str, state: dict[str, Array], dtype: Any = np.float64) -> Judged | None:
    """A batch and single calls of a call against the reference; None without a program or without a finite result."""
    k = sd.specialize(model, getattr(sd, name), dtype=dtype)
    if k.engine != "lanes":
        return None
    values = [state[letter].astype(dtype).astype(float) for letter in CALLS[name]]
    good, single = [], []
    for at in range(len(values[0])):
        try:
            single.append(getattr(sd, name)(model, *(x[at] for x in values)))
            good.append(at)
        except sd.InertiaError:
            continue
    if not good:
        return None
    values = [np.ascontiguousarray(x[good]) for x in values]
    truth, _ = truths(model, name, values, 0)
    n = len(good)
    many = [np.resize(x, (LEAST, *x.shape[1:])) if n < LEAST else x for x in values]
    batch = (k(*(x.astype(dtype) for x in many)) if dtype == np.float32 else getattr(sd, name)(model, *many))[:n]
    positive = name != "crba" or bool(((diagonal(batch) > 0.0) | (diagonal(truth) <= 0.0)).all())
    eps = float(np.finfo(float).eps)
    worst = [float(np.minimum(of_calls(name, x, truth), 1.0).max()) for x in (np.array(single), batch)]
    return Judged(worst[0] / eps, worst[1] / float(np.finfo(dtype).eps), positive)


def diagonal(M: NDArray[Any]) -> NDArray[Any]:
    """(n, nv) of (n, nv, nv)."""
    return np.einsum("nii->ni", M)


def models(robots: list[str], roots: list[str]) -> Iterator[tuple[str, sd.Model]]:
    """Rods, then the robots whose names hold one of these parts."""
    if robots == [""]:
        for n in (2, 6):
            for thin in THIN:
                yield f"{n} rods of {thin:g}", rods(n, thin)
    for name, model in corpus():
        if model.nv and any(part in name for part in robots) and name.rsplit(" ", 1)[1] in roots:
            yield name, model


def main() -> int:
    """Check all of them and print failures."""
    assert __doc__
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", default="", help="parts of names, by default all, and the rods")
    parser.add_argument("--roots", default="fixed,floating")
    parser.add_argument("--dtypes", default=",".join(DTYPES))
    parser.add_argument("--calls", default=",".join(CALLS))
    parser.add_argument("--samples", type=int, default=16, help="of each of five kinds of poses")
    options = parser.parse_args()
    found = list(models(options.robots.split(","), options.roots.split(",")))
    bar, start = Bar(len(found)), time.perf_counter()
    worst: dict[tuple[str, str], tuple[float, str]] = {}
    failures, count = [], 0
    for title, model in found:
        bar.step(title)
        state = states(model, options.samples)
        for name in options.calls.split(","):
            for dtype in options.dtypes.split(","):
                try:
                    seen = judged(model, name, state, DTYPES[dtype])
                except sd.InertiaError as error:
                    failures.append(f"{title}, {name} in {dtype}: only the batch raises {error}")
                    continue
                if seen is None:
                    continue
                count += 1
                worst[name, dtype] = max(worst.get((name, dtype), (0.0, "")), (seen.share, title))
                if not seen.share <= 1.0:
                    what = f"{seen.batch:.3g} eps, single calls {seen.single:.3g} eps"
                    failures.append(f"{title}, {name} in {dtype}: {what if seen.positive else 'M not positive'}")
                    print(failures[-1], flush=True)
    bar.end()
    for (name, dtype), (share, title) in worst.items():
        print(f"{name:12} {dtype}  at most {100 * share:.0f} % of its bound: {title}")
    print(f"{len(found)} models, {count} programs, {len(failures)} failures, {time.perf_counter() - start:.0f} s")
    print("\n".join(failures))
    return len(failures)


if __name__ == "__main__":
    raise SystemExit(main())

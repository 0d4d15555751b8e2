"""Whether all effects, methods and calls give the bits that another version of the package gave on this host.

    git worktree add --detach /tmp/before COMMIT
    python benchmarks/same_bits.py --before /tmp/before [--compiled]

Each robot of ``tests/combinations.py``, each effect and each pair of effects, by each method, by ``simulate`` and
explicit ones by ``rollout`` of two samples. The versions run in processes of their own. A combination that ran before
has to run and to have the same bits; those that were refused are counted. Without --compiled Numba is off: steps are
those of the recursions in Python, and programs run in NumPy, the same operations in the same order.
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parents[1]
sys.path.append(str(HERE / "tests"))
METHODS = (
    "explicit_euler", "semi_implicit_euler", "velocity_verlet", "rk4", "symplectic_euler", "stormer_verlet",
    "implicit_midpoint", "gauss4", "gauss6", "variational", "dop853", "radau",
)  # fmt: skip
EXPLICIT = METHODS[:4]  # of rollouts
DT, STEPS = 1e-3, 6


def main() -> None:
    """Run both versions and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", help="folder of a checkout of the other version")
    parser.add_argument("--compiled", action="store_true", help="with Numba, effects one by one")
    parser.add_argument("--write", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.write:
        Path(given.write).write_bytes(pickle.dumps(results(1 if given.compiled else 2)))
        return
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for name, root in (("before", Path(given.before)), ("now", HERE)):
            path = Path(folder) / name
            environment = {**os.environ, "PYTHONPATH": str(root), "NUMBA_DISABLE_JIT": str(int(not given.compiled))}
            more = ["--compiled"] * given.compiled
            subprocess.run([sys.executable, __file__, "--write", str(path), *more], env=environment, check=True)
            found.append(pickle.loads(path.read_bytes()))
    sys.exit(compare(*found))


def results(most: int) -> dict[tuple[Any, ...], Any]:
    """{case: arrays by name, or the error} of this version."""
    from combinations import PARTS, sets

    warnings.simplefilter("ignore")
    made = {}
    for robot in PARTS:
        for chosen in sets(most):
            for method in METHODS:
                for call in ("simulate", "rollout")[: 1 + (method in EXPLICIT)]:
                    made[robot, chosen, method, call] = result(robot, chosen, method, call)
    return made


def result(robot: str, chosen: tuple[str, ...], method: str, call: str) -> Any:
    """Arrays by name, or the text of the error."""
    from combinations import case, start

    import spatialdyn as sd

    try:
        model, options = case(robot, chosen)
        q, v = start(model)
        if call == "rollout":
            q, v = np.stack([q, q]), np.stack([v, 0.99 * v])
            recorded = options.pop("record", None)
            if recorded is not None:
                return "TypeError: rollout records no work"
        if hasattr(sd, "Scene"):
            from scenes import split

            scene, options = split(model, options)
        else:
            scene = model
        if call == "simulate":
            run: Any = sd.simulate(scene, q, v, STEPS * DT, DT, method, **options)
        else:
            run = sd.rollout(scene, q, v, dt=DT, steps=STEPS, method=method, **options)
        return {"q": run.q, "v": run.v, **run.states}
    except Exception as error:
        return f"{type(error).__name__}: {error}"


def compare(before: dict[Any, Any], now: dict[Any, Any]) -> int:
    """Print what differs; 1 if anything does."""
    bad, newly, refused = [], 0, 0
    for key, old in before.items():
        if key not in now:
            continue
        new = now[key]
        if isinstance(old, str):
            newly, refused = newly + (not isinstance(new, str)), refused + isinstance(new, str)
        elif isinstance(new, str):
            bad.append((key, new))
        else:
            for name, x in old.items():
                if name not in new or np.asarray(x).tobytes() != np.asarray(new[name]).tobytes():
                    far = np.nan if name not in new else float(abs(np.asarray(x) - new[name]).max())
                    bad.append((key, f"{name} differs by {far:.3g}"))
                    break
    for key, why in bad:
        print(*key, "|", why)
    same = sum(not isinstance(x, str) for x in before.values()) - len(bad)
    print(f"{same} combinations have the same bits, {len(bad)} differ; {newly} run that were refused, {refused} do not")
    return int(bool(bad))


if __name__ == "__main__":
    main()

"""Rollouts on a GPU: one thread takes a sample through all steps, with its states in registers.

The host checks the arguments as for a rollout on the CPU, and runs the samples that threads reject.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..control.control import recorded
from ..engines.compiled import numba_kernels
from ..engines.programs.gpu import arrays as device_arrays
from ..engines.programs.gpu.arrays import View
from ..engines.programs.gpu.device import Device
from ..engines.programs.gpu.gpu_kernel import GpuKernel, Rows, StepRows
from ..engines.programs.record import recording
from ..errors import NonFiniteError, ShapeError, SimulationError
from ..model.model import Model
from ..recursions.spec import FEXT
from .driver import check_solved, in_range, run_alone
from .effects.effect import Effect
from .methods.methods import EXPLICIT_METHODS
from .plan import Inputs, Plan, plan_of, specs_of_step
from .states import RunStates

Array = NDArray[Any]


def check_on_device(plan: Plan, q: Array, dtype: np.dtype[Any], contacts: bool) -> None:
    """Raise SimulationError for a run that only the CPU supports. q are the positions (B, nq) at the beginning."""
    if contacts:
        raise SimulationError('record has "contacts" with device="cuda", expected a number of steps or "last"')
    if plan.method not in EXPLICIT_METHODS:
        listed = ", ".join(EXPLICIT_METHODS)
        raise SimulationError(f'method is "{plan.method}" with device="cuda", expected one of {listed}')
    specs = specs_of_step(plan.method, plan.structure, (), True) if plan.is_program else ()
    if numba_kernels.PLAIN or not specs or not recording.fits(specs, plan.model.bodies, static=plan.tables):
        raise SimulationError(
            f'a step of "{plan.model.name}" in this scene has no program, expected one for device="cuda"'
        )
    if len(q) and not in_range(plan.model, q[0], dtype):
        raise SimulationError(
            f'"{plan.model.name}" has inertias beyond the range of {dtype}, expected dtype float64 with device="cuda"'
        )


@lru_cache(maxsize=32)
def _kernel(
    model: Model, method: str, effects: tuple[Effect, ...], static: tuple[Any, ...], forced: bool, dtype: np.dtype[Any],
    states: int, common: tuple[int, ...],
) -> GpuKernel:  # fmt: skip
    made = recorded(specs_of_step(method, effects, (), forced), model, static, dtype)
    if made is None:
        raise SimulationError(f'a joint of "{model.name}" has zero articulated inertia, expected some')
    return GpuKernel(made.program, replace(made.layout, common=common), dtype, states, states)


class DeviceInputs:
    """The arrays of a rollout on a device: q0, v0, and tau and fext if given."""

    def __init__(self, device: Device, dtype: np.dtype[Any], arrays: Mapping[str, Any]) -> None:
        """Raises ShapeError naming an array that is on another device or of another dtype."""
        self.device, self.dtype = device, dtype
        self.arrays = {name: x for name, x in arrays.items() if x is not None}
        self.library, self.number = device_arrays.library_of([*self.arrays], [*self.arrays.values()], device.kind)
        self.views = {name: self._read(name, x) for name, x in self.arrays.items()}
        for name, view in self.views.items():
            if view.dtype != dtype:
                raise ShapeError(f"{name} has dtype {view.dtype}, expected {dtype}, that of the rollout")
            core = 2 if name == "fext" else 1
            if not view._replace(shape=view.shape[-core:], strides=view.strides[-core:]).contiguous:
                raise ShapeError(f"{name} has strides {view.strides}, expected the numbers of a sample side by side")

    def _read(self, name: str, x: Any) -> View:
        return device_arrays.read(name, x, self.device.stream_for_dlpack(self.library.stream))

    def on_host(self) -> list[Any]:
        """Copies of q0 and v0; for tau and fext zeros of their shapes, without memory, or None if not given."""
        states = [self.library.to_host(self.arrays[name]) for name in ("q0", "v0")]
        others = [self.views[name].shape if name in self.views else None for name in ("tau", "fext")]
        return [*states, *(None if shape is None else np.broadcast_to(0.0, shape) for shape in others)]

    def run(
        self, plan: Plan, initial: RunStates, now: Sequence[Array], ways: Sequence[tuple[int, ...]],
        steps: tuple[float, int, int], check: bool,
    ) -> list[Any]:  # fmt: skip
        """The records (samples, records, columns), on the device; otherwise as ``driver.run_samples``.

        ways  (samples or 1, steps or 1) of tau, and of fext
        """
        dt, total, every = steps
        n, library, dtype = len(now[0]), self.library, self.dtype
        if not total:
            return [library.empty((n, 0, x.shape[1]), dtype) for x in now]
        records = [library.empty((n, total // every, x.shape[1]), dtype) for x in now]
        if not n or not plan.model.nv:
            return records
        kept: list[Any] = []  # arrays that the launch reads

        def uploaded(x: Array) -> Any:
            with np.errstate(over="ignore"):
                kept.append(library.upload(np.ascontiguousarray(x, dtype)))
            return self._read("a coefficient", kept[-1])

        states = []
        for name, x in zip(("q0", "v0"), now, strict=False):
            view = self.views[name]
            states.append(Rows(view.address, view.strides[0] if view.shape == x.shape and n > 1 else 0))
        for start in initial.starts:
            states.append(Rows(uploaded(start).address, start.shape[1] if len(start) > 1 else 0))
        inputs: list[StepRows] = []
        common, sound = [], True
        listed = [("dt", np.full((1, 1, 1), dt)), ("tau", None), *plan.values.items()]
        for name, value in listed:  # as a step takes them
            if name in ("tau", FEXT.name) and name in self.views:
                view, way = self._forces(plan, name, kept), ways[name == FEXT.name]
                lead = (0, 0, *view.strides[: len(view.shape) - (2 if name == FEXT.name else 1)])[-2:]
                step = [stride if size > 1 else 0 for stride, size in zip(lead, way, strict=True)]
                inputs.append(StepRows(view.address, *step))
            elif value is not None:
                samples, times, columns = value.shape
                if samples == 1:
                    common.append(len(states) + len(inputs))
                    sound &= bool(np.isfinite(value).all())
                if not np.isfinite(value.astype(dtype)[np.isfinite(value)]).all():
                    most = abs(value[np.isfinite(value)]).max()
                    raise SimulationError(
                        f'{name} holds {most}, expected the range of {dtype}, or dtype float64, with device="cuda"'
                    )
                address = uploaded(value).address
                inputs.append(StepRows(address, times * columns if samples > 1 else 0, columns if times > 1 else 0))
        parts = plan.model, plan.method, plan.structure, plan.tables
        kernel = _kernel(*parts, "tau" in self.views, dtype, len(states), tuple(common))
        flags, count = library.empty((n,), np.uint8), library.zero()
        *addresses, noted, counted = [self._read("a result", x).address for x in (*records, flags, count)]
        where = self.device, self.number
        given: list[Rows | StepRows] = [*states, *inputs]
        kernel.time_loop(*where, (n, total, every), given, addresses, noted, counted, library.stream)
        self.device.wait(self.number, library.stream)
        if not sound:
            left = np.arange(n)
        elif int(library.to_host(count)[0]):
            left = np.flatnonzero(library.to_host(flags) == 0)
        else:
            left = np.arange(0)
        if len(left):
            records = self._rejected(plan, initial, now, records, steps, left, check)
        if check and plan.judged and total // every:
            own = [np.asarray(library.to_host(x)) for x in records[2:]]
            check_solved(plan, [np.broadcast_to(0.0, x.shape) for x in records[:2]] + own, dt, every)
        return records

    def _forces(self, plan: Plan, name: str, kept: list[Any]) -> View:
        """The view of tau, or of fext with the constant forces of the scene added."""
        if name != FEXT.name or plan.scene.fext is None:
            return self.views[name]
        kept.append(self.arrays[name] + self.library.upload(np.ascontiguousarray(plan.scene.fext, self.dtype)))
        return self._read(name, kept[-1])

    def _rejected(
        self, plan: Plan, initial: RunStates, now: Sequence[Array], records: Sequence[Any],
        steps: tuple[float, int, int], left: NDArray[np.intp], check: bool,
    ) -> list[Any]:  # fmt: skip
        """The records, with these samples run on the CPU. Raises SimulationError naming one that fails."""
        n, library = len(now[0]), self.library
        rows = [library.rows(x, n, left).reshape((len(left), *x.shape[1:])) for x in records]
        bad, several = sum(not all(np.isfinite(x[k]).all() for x in rows) for k in range(len(left))), ""
        if bad > 1:
            several = f" ({bad} samples in all); check=False lets it"
        for k, b in enumerate(left):
            held = self._sample("tau", b, 1) if "tau" in self.views else np.zeros((1, 1, plan.model.nv))
            alone = plan
            if FEXT.name in self.views:
                forces = self._sample(FEXT.name, b, 2)
                if check and not np.isfinite(forces).all():
                    raise NonFiniteError("fext has numbers that are not finite, expected finite ones")
                scene, begun = plan.scene, (now[0][b], now[1][b])
                alone = plan_of(scene, plan.method, begun, steps[0], False, False, Inputs(forces, None, plan.feedback))
            start = [x[b].astype(float) for x in now]
            reason = run_alone(alone, initial, start, held[0], [x[k] for x in rows], steps, int(b), check)
            if reason and check:
                raise SimulationError(f"sample {b}: {reason}{several}")
        return [library.put(x, n, left, y.reshape(len(left), -1)) for x, y in zip(records, rows, strict=True)]

    def _sample(self, name: str, b: int, core: int) -> Array:
        """tau or fext of one sample as (1, steps or 1, ...), on the host."""
        x = self.arrays[name]
        lead = len(x.shape) - core
        if lead == 2:
            x = x[min(b, x.shape[0] - 1)]
        made = np.asarray(self.library.to_host(x), float)
        return made.reshape((1, -1, *made.shape[made.ndim - core :]))

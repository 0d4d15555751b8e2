"""The argument ``device`` of calls; the modules that run on a device are imported when a call names one."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from ..errors import SpatialDynError, literal

if TYPE_CHECKING:
    from ..engines.programs.gpu.device import Device


@cache
def _cuda() -> Device:
    from ..engines.programs.gpu.cuda import Cuda

    return Cuda()


def as_device(value: Any) -> Device | None:
    """The argument ``device``, None for the CPU. Raises SpatialDynError."""
    if isinstance(value, str) and value in ("cpu", "cuda"):
        return _cuda() if value == "cuda" else None
    from ..engines.programs.gpu.device import Device

    if isinstance(value, Device):
        return value
    raise SpatialDynError(f'device is {literal(value)}, expected "cpu" or "cuda"')

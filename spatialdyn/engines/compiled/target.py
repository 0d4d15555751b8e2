"""The processor for which code is compiled: this one, or an older one named by Numba's settings."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from .numba_settings import setting


class Target(NamedTuple):
    """A processor as LLVM describes it.

    name      its name
    features  "+avx2,+fma,-avx512f ..."
    """

    name: str
    features: str

    def has(self, feature: str) -> bool:
        """Whether it has a feature."""
        return f"+{feature}" in self.features.split(",")

    @property
    def fused(self) -> bool:
        """Whether it has fused multiply-add."""
        from llvmlite import binding

        return self.has("fma") or binding.get_process_triple().startswith(("aarch64", "arm64"))


@cache
def target() -> Target:
    """This processor, or the one that ``NUMBA_CPU_NAME`` and ``NUMBA_CPU_FEATURES`` name; all code is made for it."""
    from llvmlite import binding

    name, features = setting("CPU_NAME", "") or "", setting("CPU_FEATURES", "") or ""
    if not features and name.lower() != "generic":
        features = binding.get_host_cpu_features().flatten()
    return Target(name or binding.get_host_cpu_name(), features)

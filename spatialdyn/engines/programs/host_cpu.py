"""The processor that programs are compiled for, LLVM's code for it, and that code in memory."""

from __future__ import annotations

from functools import cache
from typing import Any

import llvmlite.binding as llvm
import numpy as np

VERSION = ".".join(map(str, llvm.llvm_version_info))


@cache
def host() -> tuple[str, str, int, bool]:
    """Name and features of this processor, the bytes of its vectors, and whether it has fused multiply-add."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features()
    name = llvm.get_host_cpu_name()
    if features.get("avx512f"):
        width = 64
    elif features.get("avx2"):
        width = 32
    else:
        width = 16  # SSE2, NEON
    arm = llvm.get_process_triple().startswith(("aarch64", "arm64"))
    return name, features.flatten(), width, bool(features.get("fma")) or arm


def lanes_of(dtype: Any) -> int:
    """How many numbers of a dtype fill a vector of this host."""
    return int(host()[2] // np.dtype(dtype).itemsize)


def assembled(text: str) -> bytes:
    """Object code of a module for this host; LLVM's next level takes half as long again for code that is no faster."""
    name, features, _, _ = host()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=name, features=features, opt=1, reloc="pic", codemodel="jitdefault", jit=True
    )
    code: bytes = machine.emit_object(llvm.parse_assembly(text))
    return code


class Loaded:
    """Object code in memory; lives as long as it is referred to."""

    def __init__(self, code: bytes) -> None:
        """Load and link."""
        host()
        self._machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), self._machine)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Where a function is. Raises ValueError if it is not in the code."""
        at = int(self._engine.get_function_address(name))
        if not at:
            raise ValueError(f"the object code has no {name}")
        return at

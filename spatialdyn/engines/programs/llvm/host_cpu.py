"""The CPU for which code is made, LLVM's object code for it, and loading of that code."""

from __future__ import annotations

import hashlib
from functools import cache
from typing import Any

import numpy as np

from ...compiled import disk_cache
from ...compiled.target import target
from ...interrupt import interruptible

LONG = 100_000  # characters of a module that LLVM takes 0.2 s or more to compile


@cache
def llvm_version() -> str:
    """The version of LLVM."""
    import llvmlite.binding as llvm

    return ".".join(map(str, llvm.llvm_version_info))


@cache
def host() -> tuple[str, str, int, bool]:
    """The CPU for which code is made: name, features, bytes of its vectors, whether it has fused multiply-add."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    chosen = target()
    if chosen.has("avx512f"):
        width = 64
    elif chosen.has("avx2"):
        width = 32
    else:
        width = 16  # SSE2, NEON
    return chosen.name, chosen.features, width, chosen.fused


def lanes_of(dtype: Any) -> int:
    """How many numbers of a dtype a vector of this host holds."""
    return int(host()[2] // np.dtype(dtype).itemsize)


def object_code(text: str, opt: int = 1) -> bytes:
    """Object code of a module for this host. Ctrl-C raises KeyboardInterrupt at once, also if LLVM takes long.

    opt  LLVM's level of optimization: 2 takes longer than 1 for code that is no faster, 0 compiles quickly to slow
         code; the results have the same bits at all levels
    """
    made: bytes = interruptible(_object_code, text, opt) if len(text) > LONG else _object_code(text, opt)
    return made


def _object_code(text: str, opt: int) -> bytes:
    import llvmlite.binding as llvm

    name, features, _, _ = host()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(
        cpu=name, features=features, opt=opt, reloc="pic", codemodel="jitdefault", jit=True
    )
    code: bytes = machine.emit_object(llvm.parse_assembly(text))
    return code


class LoadedCode:
    """Object code in memory; the memory is freed with this object."""

    def __init__(self, code: bytes) -> None:
        """Load and link."""
        import llvmlite.binding as llvm

        host()
        self._machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), self._machine)
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """The address of a function. Raises ValueError if the code does not have it."""
        at = int(self._engine.get_function_address(name))
        if not at:
            raise ValueError(f"the object code has no {name}")
        return at


def stored_code(text: str) -> LoadedCode:
    """The machine code of a module that is the same for all models, from the disk cache, or compiled and cached."""
    processor, features, _, _ = host()
    digest = hashlib.sha256("\n".join((text, processor, features, llvm_version())).encode()).hexdigest()
    code = disk_cache.read(digest)
    if code is None:
        code = object_code(text)
        disk_cache.write(digest, code)
    return LoadedCode(code)

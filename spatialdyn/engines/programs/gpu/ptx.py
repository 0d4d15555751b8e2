"""PTX of kernels, which LLVM makes on any machine, and the orders of a program's lines that are tried."""

from __future__ import annotations

import hashlib
from typing import Any

from ...compiled import disk_cache
from ...compiled.stamp import STAMP
from ...interrupt import interruptible
from ..llvm.host_cpu import LONG, llvm_version
from ..llvm.schedule import depth_first
from ..record.program import Program
from .kernel_text import TRIPLE

ARCHITECTURE, VERSION = "sm_75", "+ptx70"  # the oldest GPU; the driver compiles for its own GPU


def orders(program: Program) -> list[list[int]]:
    """The orders of lines to try: the program's own order, and depth first from the last result.

    The second order holds fewer values for a tree of bodies. A program with regions has only its own order.
    """
    own = list(range(len(program.lines)))
    return [own] if program.regions else [own, depth_first(program, last=True)]


def ptx(text: str) -> str:
    """The PTX of a module, from the disk cache, or compiled and cached. Ctrl-C raises KeyboardInterrupt at once."""
    digest = hashlib.sha256("\n".join((text, STAMP, ARCHITECTURE, VERSION, llvm_version())).encode()).hexdigest()
    kept = disk_cache.read(digest)
    if kept is None:
        kept = (interruptible(_compiled, text) if len(text) > LONG else _compiled(text)).encode()
        disk_cache.write(digest, kept)
    return kept.decode()


def _compiled(text: str) -> str:
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(TRIPLE).create_target_machine(cpu=ARCHITECTURE, features=VERSION, opt=2)
    module = llvm.parse_assembly(text)
    if "%ws = alloca" in text and hasattr(llvm, "create_pass_builder"):  # to registers
        builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=0))
        passes = llvm.create_new_module_pass_manager()
        passes.add_sroa_pass()
        passes.run(module, builder)
    made: Any = machine.emit_assembly(module)
    return str(made)

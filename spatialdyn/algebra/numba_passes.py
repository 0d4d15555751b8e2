"""How Numba compiles what is inlined: as LLVM's code for its caller, without machine code of its own.

By itself Numba takes every function down to machine code, wrappers for C included, before it copies it into those that
call it. What is inlined without exception is never run by itself. It is optimised all the same: handed on as it was
lowered it would save more, but then LLVM fuses other products, and answers change in the last digit.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import IRLegalization

# Passes for what no recursion has: closures, with-blocks, array expressions, literal_unroll, parfors.
_WITHOUT = {
    "WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction", "InlineInlinables",
    "FindLiterallyCalls", "LiteralUnroll", "LiteralPropagationSubPipelinePass", "InlineOverloads", "NopythonRewrites",
    "DumpParforDiagnostics",
}  # fmt: skip


class _Code(JITCodeLibrary):
    """The code of one function and all that it calls, for linking alone."""

    @property
    def codegen(self) -> Any:
        """What is told of the function's Python environment, which nothing inlined looks at: itself."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing: there is no machine code that could look."""

    def get_pointer_to_function(self, name: str) -> int:
        """0: it is nowhere."""
        return 0

    def _finalize_final_module(self) -> None:
        scan: Any = self._finalize_dynamic_globals
        scan()
        self._finalized = True


class _Lowered(_Code):
    """Such code as it was lowered."""

    def _optimize_final_module(self) -> None:
        pass


class _Into(LoweringPass):
    """Gives lowering the library to put its code into."""

    _name = "spatialdyn_into_code"
    library: Any = _Code

    def __init__(self) -> None:
        """As all passes are begun."""

    def run_pass(self, state: Any) -> bool:
        """Set the library of the function that is compiled."""
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        return True


class _IntoLowered(_Into):
    _name = "spatialdyn_into_lowered"
    library = _Lowered


_register: Any = register_pass
for _kind in (_Into, _IntoLowered):
    _register(mutates_CFG=False, analysis_only=True)(_kind)


class Inlining(CompilerBase):
    """The passes of a function that is inlined: Numba's, without those that recursions have no use for."""

    into: Any = _Into

    def define_pipelines(self) -> list[Any]:
        """The one way of compiling it."""
        builder: Any = DefaultPassBuilder
        passes = builder.define_nopython_pipeline(self.state)
        passes.passes = [x for x in passes.passes if x[0].__name__ not in _WITHOUT]
        passes.add_pass_after(self.into, IRLegalization)
        passes.finalize()
        return [passes]


class Weaving(Inlining):
    """The passes of a function that stands between a loop and compiled kernels, which it would optimise anew."""

    into = _IntoLowered

"""Numba's compiler pipelines for ``inline`` functions: LLVM code for the caller, no machine code of their own.

By default Numba compiles every function to machine code, C wrappers included, before it links its LLVM code into the
callers. An ``inline`` function never runs by itself, so that step is left out. LLVM optimizes it all the same: without
that, compiling would be faster still, but LLVM would fuse other products and answers change in the last digit.
"""

from __future__ import annotations

from typing import Any

from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.typed_passes import IRLegalization

# Passes for features that no recursion uses: closures, with-blocks, array expressions, literal_unroll, parfors.
_WITHOUT = {
    "WithLifting", "InlineClosureLikes", "RewriteDynamicRaises", "MakeFunctionToJitFunction", "InlineInlinables",
    "FindLiterallyCalls", "LiteralUnroll", "LiteralPropagationSubPipelinePass", "InlineOverloads", "NopythonRewrites",
    "DumpParforDiagnostics",
}  # fmt: skip


class _Code(JITCodeLibrary):
    """The LLVM code of one function and its callees, for linking alone."""

    @property
    def codegen(self) -> Any:
        """Where Numba declares the function's Python environment, which inlined code does not read: here."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing: no machine code reads an environment."""

    def get_pointer_to_function(self, name: str) -> int:
        """0: there is no machine code."""
        return 0

    def _finalize_final_module(self) -> None:
        scan: Any = self._finalize_dynamic_globals
        scan()
        self._finalized = True


class _Lowered(_Code):
    """The same without LLVM's optimization."""

    def _optimize_final_module(self) -> None:
        pass


class _Into(LoweringPass):
    """The pass that gives lowering the library to write its code to."""

    _name = "spatialdyn_into_code"
    library: Any = _Code

    def __init__(self) -> None:
        """Set up as every pass is."""

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
    """The pipeline of an ``inline`` function: Numba's, less the passes for features that no recursion uses."""

    into: Any = _Into

    def define_pipelines(self) -> list[Any]:
        """The only pipeline."""
        builder: Any = DefaultPassBuilder
        passes = builder.define_nopython_pipeline(self.state)
        passes.passes = [x for x in passes.passes if x[0].__name__ not in _WITHOUT]
        passes.add_pass_after(self.into, IRLegalization)
        passes.finalize()
        return [passes]


class InliningUnoptimized(Inlining):
    """The pipeline of ``inline_unoptimized``: LLVM optimizes the function, kernels included, in its caller alone."""

    into = _IntoLowered

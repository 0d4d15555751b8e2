"""Numba's compiler pipelines for ``inline`` functions, which give LLVM code for callers and no machine code.

By default Numba compiles every function to machine code, C wrappers included, before it links the LLVM code into the
callers. An ``inline`` function never runs by itself, so these pipelines leave that step out. LLVM still optimizes the
function: without that, compiling would be faster, but LLVM would fuse other products, and results would change in the
last digit.

A kernel consists of about a hundred such functions, which take most of its compile time. So their LLVM code is kept in
the disk cache, and the next process compiles only the kernel itself.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

from llvmlite import binding
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompileResult, DefaultPassBuilder
from numba.core.compiler_machinery import LoweringPass, register_pass
from numba.core.environment import Environment
from numba.core.typed_passes import IRLegalization

from .lane_typing import Typed
from .numba_cache import InlinedCache
from .stamp import STAMP

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
        """This object: Numba declares here the function's Python environment, which inlined code does not read."""
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
    """As ``_Code``, without LLVM's optimization."""

    def _optimize_final_module(self) -> None:
        pass


class _Into(LoweringPass):
    """The pass that chooses the library into which lowering writes its code."""

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


class Plain(Typed):
    """The pipeline of a kernel: Numba's, without the passes for features that neither kernels nor recursions use."""

    def define_pipelines(self) -> list[Any]:
        """The only pipeline."""
        builder: Any = DefaultPassBuilder
        passes = builder.define_nopython_pipeline(self.state)
        passes.passes = [x for x in passes.passes if x[0].__name__ not in _WITHOUT]
        passes.finalize()
        return [passes]


class Inlining(Plain):
    """The pipeline of an ``inline`` function, for its callers alone."""

    into: Any = _Into
    cache = InlinedCache(STAMP)

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """The function from the cache, or else compiled now.

        A function that is compiled and cached is made from its cached form at once, so both ways give the same code.
        """
        digest = self.cache.digest(func, self.state)
        content = self.cache.read(digest) if digest else None
        if content is None:
            compile_now: Any = super().compile_extra
            made = compile_now(func)
            content = _content(made) if digest else None
            if content is None:
                return made
            self.cache.write(digest, content)
        return self._of(*content)

    def _of(self, description: Any, signature: Any, name: str, bitcode: bytes) -> Any:
        """The compile result that Numba would give."""
        context: Any = self.state.targetctx
        library: Any = self.into.library(context.codegen(), name)
        library._final_module = binding.parse_bitcode(bitcode)
        library._finalize_final_module()
        made_for: Any = Environment.from_fndesc
        environment = made_for(description)
        function = context.get_executable(library, description, environment)
        context.insert_user_function(function, description, [library])
        blank: Any = CompileResult._make([None] * len(CompileResult._fields))
        return blank._replace(
            typing_context=self.state.typingctx, target_context=context, library=library, entry_point=function,
            environment=environment, fndesc=description, signature=signature, objectmode=False, lifted=(),
            reload_init=(), referenced_envs=(),
        )  # fmt: skip

    def define_pipelines(self) -> list[Any]:
        """The only pipeline."""
        (passes,) = super().define_pipelines()
        passes.add_pass_after(self.into, IRLegalization)
        passes.finalize()
        return [passes]


class InliningUnoptimized(Inlining):
    """The pipeline of ``inline_unoptimized``: LLVM optimizes the function, kernels included, in its caller alone."""

    into = _IntoLowered


PIPELINES = {"inline": Inlining, "inline_unoptimized": InliningUnoptimized}


def _content(made: Any) -> tuple[Any, Any, str, bytes] | None:
    """The content from which ``Inlining`` makes a compiled function in any process.

    Returns None if the code holds addresses of this process, or functions other than this one and Numba's reference
    counting: Numba numbers the functions of a process, so in the next process other code might have their names.
    """
    module, description = made.library._final_module, copy(made.fndesc)
    defined = {f.name for f in module.functions if not f.is_declaration} - {description.llvm_func_name}
    if made.library.has_dynamic_globals or any(not name.startswith("NRT_") for name in defined):
        return None
    description.typemap = description.calltypes = None  # large, and only the compiler reads them
    return description, made.signature, made.library.name, module.as_bitcode()

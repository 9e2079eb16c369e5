"""Compilers of functions that are linked into others, and of those that link them.

Numba optimises every function together with all that it calls, and makes machine code of it. If
only compiled functions call a function, neither is of use: its callers link its code and are
optimised themselves. Without both, the first step from an empty cache takes 17 s of CPU time
instead of 31 s (Numba 0.68, the processor of ``docs/scaling.md``). Measure again with each version
of Numba: if its own passes become as fast, this file can go.

This extends Numba by its ``pipeline_class``. Libraries and passes are its own, which may change
with a version: raise the limit in pyproject.toml only if the golden trajectories stay.
"""

from typing import Any

from numba import _dynfunc  # type: ignore[attr-defined]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.typed_passes import (
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonRewrites,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    FixupArgs,
    GenericRewrites,
    InlineClosureLikes,
    IRProcessing,
    ReconstructSSA,
    TranslateByteCode,
)


class LinkedLibrary(JITCodeLibrary):
    """The code of one function, without that of the functions that it calls."""

    def finalize(self) -> None:
        """Accept no more code; nothing is linked, optimised or made machine code."""
        self._finalize_dynamic_globals()
        self._finalized = True


class EntryLibrary(JITCodeLibrary):
    """The code of a function that Python calls, with that of all functions that it calls."""

    def finalize(self) -> None:
        """Link and optimise the code of all functions that are called, directly or not."""
        self._linking_libraries = _callers_first(self._linking_libraries)
        super().finalize()


def _callers_first(libraries: list[Any]) -> list[Any]:
    """Return the libraries and all that they link, each after those that link it.

    LLVM links a function only if code that is linked already calls it.
    """
    callees_first: list[Any] = []
    visited = set()

    def visit(library: Any) -> None:
        if library in visited:
            return
        visited.add(library)
        if isinstance(library, LinkedLibrary):
            for callee in library._linking_libraries:
                visit(callee)
        callees_first.append(library)

    for library in libraries:
        visit(library)
    return callees_first[::-1]


@register_pass(mutates_CFG=True, analysis_only=False)
class LinkedLowering(NativeLowering):
    """Write a function's code into a ``LinkedLibrary``."""

    _name = "linked_lowering"

    def run_pass(self, state: Any) -> bool:
        library = LinkedLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library = library
        super().run_pass(state)
        lowered = state.cr
        # Callers find a function's code by its object for Python. This one has no code of its own
        # (address 0), because Python never calls it.
        function = _dynfunc.make_function(
            lowered.fndesc.lookup_module(),
            lowered.fndesc.qualname,
            "linked into other functions",
            0,
            lowered.env,
            (library,),
        )
        state.targetctx.insert_user_function(function, lowered.fndesc, [library])
        state.cr = lowered._replace(cfunc=function)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class EntryLowering(NativeLowering):
    """Write a function's code into an ``EntryLibrary``."""

    _name = "entry_lowering"

    def run_pass(self, state: Any) -> bool:
        library = EntryLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        library.enable_object_caching()
        state.library = library
        super().run_pass(state)
        return True


# Passes for ``with``, functions inside a function, literal arguments, unrolled tuples and parallel
# loops are left out; list comprehensions are compiled.
_LINKED_PASSES = (
    TranslateByteCode,
    FixupArgs,
    IRProcessing,
    InlineClosureLikes,
    GenericRewrites,
    ReconstructSSA,
    NopythonTypeInference,
    PreLowerStripPhis,
    NopythonRewrites,
    IRLegalization,
    LinkedLowering,
    NoPythonBackend,
)


class QuickFlags(Flags):
    """Options of which only the error model is compared.

    Numba compares all options at each candidate of each call in a function, and compiles a callee
    again for callers with other options. The other options do not change a callee's code. This
    saves 2 s of CPU time of the first step.
    """

    __slots__ = ()

    def __hash__(self) -> int:
        return hash(self.error_model)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QuickFlags) and self.error_model == other.error_model


class _Compiler(CompilerBase):
    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags = QuickFlags(self.state.flags)


class LinkedCompiler(_Compiler):
    """Compiler of functions that only compiled functions call.

    They hold no ``with`` and no function of their own.
    """

    def define_pipelines(self) -> list[Any]:
        """Return the passes."""
        self.state.flags.no_compile = True
        self.state.type_annotation = None
        passes = PassManager("linked")
        for compiler_pass in _LINKED_PASSES:
            passes.add_pass(compiler_pass, compiler_pass.__name__)
        passes.finalize()
        return [passes]


class EntryCompiler(_Compiler):
    """Compiler of functions that Python calls."""

    def define_pipelines(self) -> list[Any]:
        """Return Numba's passes, with ``EntryLowering`` in place of its lowering."""
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(EntryLowering, NativeLowering)
        passes.passes = [row for row in passes.passes if row[0] is not NativeLowering]
        passes.finalize()
        return [passes]

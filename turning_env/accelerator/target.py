"""What the accelerator's compiler must be told so that the transition stays bit for bit what it is on the processor.

NVIDIA's compiler fuses a product and a sum into one operation with one rounding unless it is told not to, and Numba has no word
for that. Nor does Numba know how to round whole numbers there, which the transition asks of NumPy.
"""

import importlib
import importlib.util
import os
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numba.core.config
import numpy as np

cuda: Any = importlib.import_module("numba.cuda")
"""Numba's compiler for the accelerator, or its simulator: as a value, since neither has types."""
THREADS = 128
"""Of a thread block: four warps."""
_FUSED = re.compile(r"\b(?:(?:fma|mad)\.[a-z.]*f\d\d|(?:mul|add|sub)\.f\d\d)\b")  # those with .rn stay apart


class NoAcceleratorError(RuntimeError):
    """There is nothing to run on; the message says what is missing."""


def simulated() -> bool:
    """Whether Numba simulates an accelerator (``NUMBA_ENABLE_CUDASIM=1``)."""
    return bool(getattr(numba.core.config, "ENABLE_CUDASIM", False))


def need_accelerator() -> None:
    """Return if there is an accelerator, or a simulated one.

    Raises:
        NoAcceleratorError: there is none, or what drives it is missing.
    """
    if simulated():
        if os.environ.get("NUMBA_DISABLE_JIT", "0") == "0":
            raise NoAcceleratorError("the simulator takes interpreted code: NUMBA_ENABLE_CUDASIM=1 needs NUMBA_DISABLE_JIT=1")
    elif importlib.util.find_spec("numba_cuda") is None:
        raise NoAcceleratorError("numba-cuda is not installed, which compiles for a GPU: pip install 'numba-cuda[cu12]'")
    elif not cuda.is_available():
        raise NoAcceleratorError("Numba finds no GPU: an NVIDIA GPU, its driver and CUDA 12 or later are needed")


class Kernel:
    """A function that every thread of the accelerator runs for its lane, without fused operations.

    Raises:
        ArithmeticError: when called, if the compiler has fused operations all the same.
    """

    def __init__(self, function: Callable[..., None]) -> None:
        self._simulated = simulated()
        if self._simulated:
            self._launch: Any = cuda.jit(function)
        else:
            _teach_rounding()
            # Code that is linked as an intermediate language would be compiled anew, with operations fused.
            self._launch = cuda.jit(function, fastmath=False, lto=False)
        self._configured: dict[int, Any] = {}
        self._checked = 0

    def __call__(self, lanes: int, *arguments: Any) -> None:
        """Run it for so many lanes; it goes on while Python does."""
        if self._simulated:
            self._launch[-(-lanes // THREADS), THREADS](*arguments)
            return
        if lanes not in self._configured:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of few lanes, which leave most of a GPU idle
                self._configured[lanes] = self._launch[-(-lanes // THREADS), THREADS]
        with unfused():
            self._configured[lanes](*arguments)
        if len(self._launch.overloads) > self._checked:
            for code in self._launch.inspect_asm().values():
                refuse_fused(code)
            self._checked = len(self._launch.overloads)


def refuse_fused(code: str) -> None:
    """Raise an ``ArithmeticError`` if a kernel's PTX holds a fused operation, or one that may be fused later."""
    found = _FUSED.search(code)
    if found:
        raise ArithmeticError(f"the compiler fuses products and sums ({found[0]}): results would not be the processor's")


@contextmanager
def unfused() -> Iterator[None]:
    """Whatever Numba compiles for a GPU meanwhile keeps every rounding."""
    nvvm: Any = importlib.import_module("numba.cuda.cudadrv.nvvm")
    compile_ir = nvvm.compile_ir
    nvvm.compile_ir = lambda code, **options: compile_ir(code, **(options | {"fma": False}))
    try:
        yield
    finally:
        nvvm.compile_ir = compile_ir


def _teach_rounding() -> None:
    """Compile NumPy's ``floor`` and ``rint`` to the accelerator's own, which are as exact."""
    libdevice: Any = importlib.import_module("numba.cuda.libdevice")
    ufuncs: Any = importlib.import_module("numba.cuda.ufuncs")

    def floor(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.compile_internal(builder, lambda x: libdevice.floor(x), signature, arguments)

    def rint(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.compile_internal(builder, lambda x: libdevice.rint(x), signature, arguments)

    known = ufuncs.ufunc_db()
    known.setdefault(np.floor, {"d->d": floor})
    known.setdefault(np.rint, {"d->d": rint})

"""Functions that are linked into others, and options of which only the error model counts."""

from typing import Any

import numba
import numpy as np
import pytest
from numba.core.compiler import Flags
from numba.extending import register_jitable

from turning_env.numerics.linked_code import EntryCompiler, LinkedCompiler, QuickFlags

LINKED: Any = {
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "pipeline_class": LinkedCompiler,
}
jit_is_off = pytest.mark.skipif(
    bool(numba.config.DISABLE_JIT),  # type: ignore[attr-defined]
    reason="nothing is compiled",
)


def flags(error_model: str, **options: bool) -> QuickFlags:
    made = Flags()
    made.error_model = error_model
    for name, value in options.items():
        setattr(made, name, value)
    return QuickFlags(made)


def test_options_are_equal_if_their_error_models_are() -> None:
    numpy = flags("numpy")
    other_options = flags("numpy", no_compile=True, nrt=True)
    python = flags("python")
    assert numpy == other_options
    assert hash(numpy) == hash(other_options)
    assert numpy != python
    assert numpy != "numpy"


@jit_is_off
def test_an_entry_links_what_it_calls_directly_or_not() -> None:
    @register_jitable(**LINKED)
    def squared(x: float) -> float:
        return x * x

    @register_jitable(**LINKED)
    def twice_squared(x: float) -> float:
        return 2.0 * squared(x)

    def entry(values: Any) -> float:
        total = 0.0
        for value in values:
            total += twice_squared(value) + squared(value)
        return total / 0.0 if total < 0.0 else total

    options: Any = {**LINKED, "nogil": True, "pipeline_class": EntryCompiler}
    compiled = numba.njit(**options)(entry)
    assert compiled(np.array([1.0, 2.0])) == 15.0
    assert entry(np.array([1.0, 2.0])) == 15.0

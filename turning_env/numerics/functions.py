"""Exponential, logarithm, sine and cosine made of additions, products and one division.

The C library's functions prevent vector instructions in a loop over environments, and their last
bits differ between machines. These functions give the same bits in the interpreter, for arrays,
and in a compiled loop over one environment or thousands.

Errors are relative, except for sine and cosine: ``exp`` 5e-16 (up to 1e-15 if the result is beyond
1e150 or below 1e-150), ``log`` 5e-16, ``sine_and_cosine`` 4e-16 absolute. There are no checks: an
argument outside a function's range gives a wrong number, not an error.

The polynomials interpolate at Chebyshev points; their coefficients were computed with 60 digits.
They are evaluated in pairs (Estrin's scheme), which shortens the chain of dependent operations:
each bracket is a pair. The order of operations decides the last bits, so do not rearrange a formula
here. Nor give names to the parts of a formula: NumPy reuses the memory of unnamed arrays, and
functions of arrays took up to 1.6 times as long with them.
"""

import functools
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from turning_env.numerics.compilation import COMPILED, compiled, compiled_entry

_Kernel = Callable[[NDArray[np.float64]], Any]
_COMPILES = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]

# log 2 in two parts (Cody and Waite 1980). The first has 42 bits, so that its product with an
# exponent is exact.
_LOG_2_HIGH = 0.6931471805598903
_LOG_2_LOW = 5.497923018708371e-14
_PER_LOG_2 = 1.4426950408889634
# 1.5 * 2**52: a number added to this is rounded to a whole number, which the lowest bits hold.
_ROUNDING = 6755399441055744.0
_ROOT_HALF_BITS = 0x3FE6A09E667F3BCD  # bits of the square root of 1/2
# Bias of the exponent and width of the mantissa of a double (IEEE 754).
_BIAS = 1023
_MANTISSA_BITS = 52
# exp(708) is the largest whole power of e whose reciprocal is a normal double, too.
_MAX = 708.0


def _clipped(x: Any) -> Any:
    return np.minimum(np.maximum(x, -_MAX), _MAX)


@overload(_clipped, jit_options=COMPILED)
def _clipped_compiled(x):
    return lambda x: min(max(x, -_MAX), _MAX)


def where(condition: Any, x: Any, y: Any) -> Any:
    """Return ``x`` where a condition holds, else ``y``: arrays, or numbers in compiled code."""
    return np.where(condition, x, y)[()]


@overload(where, jit_options=COMPILED)
def _where_compiled(condition, x, y):
    return lambda condition, x, y: x if condition else y


@compiled
def _exp_parts(x):
    """Return (a, b) with exp(x) = (1 + a) b, where b is a power of 2; x is within -708..708."""
    # x = whole * log 2 + r, where r is at most half of log 2. Adding ``_ROUNDING`` rounds.
    rounded = x * _PER_LOG_2 + _ROUNDING
    whole = rounded - _ROUNDING
    r = (x - whole * _LOG_2_HIGH) - whole * _LOG_2_LOW
    r2 = r * r
    r4 = r2 * r2
    # exp(r) - 1 = r + r^2 (c_0 + c_1 r + ... + c_9 r^9)
    low = (0.5000000000000001 + r * 0.16666666666666669) + r2 * (
        0.041666666666624164 + r * 0.008333333333330065
    )
    middle = (0.0013888888917196719 + r * 0.00019841269863040545) + r2 * (
        2.4801521322368692e-05 + r * 2.7557268480310024e-06
    )
    high = 2.7620075879983367e-07 + r * 2.5100375832561234e-08
    # Shifted to the place of a double's exponent, the whole number makes a power of 2.
    power = np.int64((np.float64(rounded).view(np.int64) + _BIAS) << _MANTISSA_BITS)
    return r + r2 * (low + r4 * (middle + r4 * high)), power.view(np.float64)


def _compiled_for_arrays(kernel: _Kernel) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function of one argument, as ``compiled``.

    Called from Python with an array, it runs a compiled loop over the elements: the bits are the
    same, and small arrays take a tenth of the time of NumPy's thirty operations.

    Args:
        kernel: replaces the elements of a contiguous array by the function's values.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        @functools.wraps(function)
        def call(x: Any) -> Any:
            if type(x) is np.ndarray and x.ndim > 0 and x.dtype == np.float64 and _COMPILES:
                # A copy is writable and contiguous, so the kernel is compiled for one type only.
                values = np.array(x, order="C")
                kernel(values.reshape(-1))
                return values
            return function(x)

        # Compiled callers get the function itself, for one number, in place of ``call``.
        overload(call, jit_options=COMPILED, strict=False)(lambda x: function)
        return call

    return decorate


@compiled_entry
def _exp_all(values):
    for i in range(len(values)):
        # The compiled limits would replace NaN.
        if values[i] == values[i]:
            values[i] = exp(values[i])


@compiled_entry
def _expm1_all(values):
    for i in range(len(values)):
        if values[i] == values[i]:
            values[i] = expm1(values[i])


@compiled_entry
def _log_all(values):
    for i in range(len(values)):
        values[i] = log(values[i])


@_compiled_for_arrays(lambda values: _exp_all(values))
def exp(x):
    """Return e to the power of x; x is clipped to -708..708."""
    mantissa, power = _exp_parts(_clipped(x))
    return (1.0 + mantissa) * power


@_compiled_for_arrays(lambda values: _expm1_all(values))
def expm1(x):
    """Return exp(x) - 1 without cancellation near 0; x is clipped to -708..708."""
    mantissa, power = _exp_parts(_clipped(x))
    return mantissa * power + (power - 1.0)


@_compiled_for_arrays(lambda values: _log_all(values))
def log(x):
    """Return the natural logarithm of a normal number above 0; about -709 for 0."""
    # x = mantissa * 2^exponent, where the mantissa lies between the roots of 1/2 and 2.
    bits = np.float64(x).view(np.int64)
    exponent = (bits - _ROOT_HALF_BITS) >> _MANTISSA_BITS
    mantissa = np.int64(bits - (exponent << _MANTISSA_BITS)).view(np.float64)
    # log(mantissa) = 2 atanh(s) = 2 s + s^3 (c_0 + c_1 s^2 + ... + c_6 s^12)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    z2 = z * z
    low = (0.666666666666667 + z * 0.39999999999899505) + z2 * (
        0.28571428625975487 + z * 0.2222221113479508
    )
    high = (0.18182889125261723 + z * 0.15331721600556042) + z2 * 0.14616449685043406
    series = s * z * (low + z2 * z2 * high)
    # The smallest terms are added first.
    whole = np.float64(exponent)
    return whole * _LOG_2_HIGH + (2.0 * s + (series + whole * _LOG_2_LOW))


@compiled
def real_power(base, exponent):
    """Return base ** exponent for base >= 0 and exponent != 0.

    The relative error is about 1e-15 times the logarithm of the result.
    """
    power = exp(exponent * log(base))
    return where(base > 0.0, power, 0.0)


@compiled
def hypotenuse(x, y):
    """Return the square root of x^2 + y^2; both squares must be within the range of a double."""
    return np.sqrt(x * x + y * y)


@compiled
def sine_and_cosine(turns):
    """Return the sine and cosine of an angle in turns, 0 or more: of 2 pi times ``turns``."""
    # turns = quarter / 4 + f, where f is at most an eighth of a turn and quarter is 0, 1, 2 or 3.
    quarter = np.floor(4.0 * turns + 0.5)
    f = turns - 0.25 * quarter
    quarter -= 4.0 * np.floor(0.25 * quarter)
    z = f * f
    z2 = z * z
    z4 = z2 * z2
    # sin(2 pi f) = f (s_0 - s_1 z + s_2 z^2 - ... - s_7 z^7)
    s_01 = 6.283185307179586 - z * 41.34170224039976
    s_23 = 81.60524927607493 - z * 76.70585975299812
    s_45 = 42.05869392898878 - z * 15.094640403891546
    s_67 = 3.8197881201632113 - z * 0.7116358090781666
    low = s_01 + z2 * s_23
    high = s_45 + z2 * s_67
    sine = f * (low + z4 * high)
    # cos(2 pi f) = 1 + z (-c_0 + c_1 z - c_2 z^2 + ... + c_7 z^7)
    c_01 = -19.739208802178716 + z * 64.9393940226683
    c_23 = -85.45681720669369 + z * 60.24464137185456
    c_45 = -26.4262567778174 + z * 7.90353561233896
    c_67 = -1.714333269420992 + z * 0.2797407860657504
    low = c_01 + z2 * c_23
    high = c_45 + z2 * c_67
    cosine = 1.0 + z * (low + z4 * high)
    # Every quarter of a turn swaps sine and cosine and changes a sign.
    swapped = (quarter == 1.0) | (quarter == 3.0)
    rotated_sine = where(swapped, cosine, sine)
    rotated_cosine = where(swapped, sine, cosine)
    sine_negative = quarter >= 2.0
    cosine_negative = (quarter == 1.0) | (quarter == 2.0)
    signed_sine = where(sine_negative, -rotated_sine, rotated_sine)
    signed_cosine = where(cosine_negative, -rotated_cosine, rotated_cosine)
    return signed_sine, signed_cosine

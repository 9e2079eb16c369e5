"""Exponential, logarithm, sine and cosine made of additions, products and one division.

The C library's functions prevent vector instructions in a loop over environments, and their last bits differ between machines.
These give the same bits in the interpreter, for arrays, and in a loop over one environment or thousands.

Errors, relative but for sine and cosine: ``exp`` 5e-16 (to 1e-15 where the result is beyond 1e150 or below 1e-150),
``log`` 5e-16, ``sine_and_cosine`` 4e-16 absolute. The polynomials interpolate at Chebyshev points; their coefficients were
computed with 60 digits. They are evaluated in pairs (Estrin's scheme), which shortens the chain of dependent operations. There
are no checks: an argument outside a function's range gives a wrong number, not an error.
"""

from typing import Any

import numpy as np
from numba.extending import overload

from turning_env.numerics.compilation import INLINED, compiled

_LOG_2_HIGH = 0.6931471805598903  # of 42 bits, so that its product with an exponent is exact
_LOG_2_LOW = 5.497923018708371e-14
_PER_LOG_2 = 1.4426950408889634
_ROUNDING = 6755399441055744.0  # 1.5 * 2**52: what is added to this is rounded to a whole number, which stands in the lowest bits
_ROOT_HALF_BITS = 0x3FE6A09E667F3BCD  # of the square root of a half
_BIAS = 1023
_MANTISSA_BITS = 52
_MAX = 708.0


def _clipped(x: Any) -> Any:
    return np.minimum(np.maximum(x, -_MAX), _MAX)


@overload(_clipped, jit_options=INLINED)
def _clipped_compiled(x):
    return lambda x: min(max(x, -_MAX), _MAX)


def _where(condition: Any, x: Any, y: Any) -> Any:
    return np.where(condition, x, y)[()]


@overload(_where, jit_options=INLINED)
def _where_compiled(condition, x, y):
    return lambda condition, x, y: x if condition else y


@compiled
def _exp_parts(x):
    """Return (a, b) with exp(x) = (1 + a) b, where b is a power of 2; x is within -708..708."""
    rounded = x * _PER_LOG_2 + _ROUNDING
    whole = rounded - _ROUNDING
    r = (x - whole * _LOG_2_HIGH) - whole * _LOG_2_LOW  # within half of log 2
    r2 = r * r
    r4 = r2 * r2
    low = (0.5000000000000001 + r * 0.16666666666666669) + r2 * (
        0.041666666666624164 + r * 0.008333333333330065
    )
    middle = (0.0013888888917196719 + r * 0.00019841269863040545) + r2 * (
        2.4801521322368692e-05 + r * 2.7557268480310024e-06
    )
    high = 2.7620075879983367e-07 + r * 2.5100375832561234e-08
    power = np.int64((np.float64(rounded).view(np.int64) + _BIAS) << _MANTISSA_BITS)
    return r + r2 * (low + r4 * (middle + r4 * high)), power.view(np.float64)


@compiled
def exp(x):
    """E to the power of x, which is taken as within -708..708."""
    mantissa, power = _exp_parts(_clipped(x))
    return (1.0 + mantissa) * power


@compiled
def expm1(x):
    """Return exp(x) - 1 without cancellation near 0; x is taken as within -708..708."""
    mantissa, power = _exp_parts(_clipped(x))
    return mantissa * power + (power - 1.0)


@compiled
def log(x):
    """Natural logarithm of a normal number above 0; of 0, some -709."""
    bits = np.float64(x).view(np.int64)
    exponent = (bits - _ROOT_HALF_BITS) >> _MANTISSA_BITS
    mantissa = np.int64(bits - (exponent << _MANTISSA_BITS)).view(
        np.float64
    )  # between the roots of 1/2 and of 2
    s = (mantissa - 1.0) / (mantissa + 1.0)
    z = s * s
    z2 = z * z
    low = (0.666666666666667 + z * 0.39999999999899505) + z2 * (
        0.28571428625975487 + z * 0.2222221113479508
    )
    high = (0.18182889125261723 + z * 0.15331721600556042) + z2 * 0.14616449685043406
    whole = np.float64(exponent)
    return whole * _LOG_2_HIGH + (2.0 * s + (s * z * (low + z2 * z2 * high) + whole * _LOG_2_LOW))


@compiled
def real_power(base, exponent):
    """Return base ** exponent for base >= 0 and exponent != 0; the relative error is some 1e-15 times the result's logarithm."""
    return _where(base > 0.0, exp(exponent * log(base)), 0.0)


@compiled
def hypotenuse(x, y):
    """Return the square root of x^2 + y^2, for squares that are within the range of a number."""
    return np.sqrt(x * x + y * y)


@compiled
def sine_and_cosine(turns):
    """(sine, cosine) of an angle of 0 or more in whole turns: of 2 pi times ``turns``."""
    quarter = np.floor(4.0 * turns + 0.5)
    f = turns - 0.25 * quarter  # within an eighth of a turn
    quarter -= 4.0 * np.floor(0.25 * quarter)  # 0, 1, 2 or 3
    z = f * f
    z2 = z * z
    low = (6.283185307179586 - z * 41.34170224039976) + z2 * (
        81.60524927607493 - z * 76.70585975299812
    )
    high = (42.05869392898878 - z * 15.094640403891546) + z2 * (
        3.8197881201632113 - z * 0.7116358090781666
    )
    sine = f * (low + z2 * z2 * high)
    low = (-19.739208802178716 + z * 64.9393940226683) + z2 * (
        -85.45681720669369 + z * 60.24464137185456
    )
    high = (-26.4262567778174 + z * 7.90353561233896) + z2 * (
        -1.714333269420992 + z * 0.2797407860657504
    )
    cosine = 1.0 + z * (low + z2 * z2 * high)
    odd = (quarter == 1.0) | (quarter == 3.0)
    first, second = _where(odd, cosine, sine), _where(odd, sine, cosine)
    return _where(quarter >= 2.0, -first, first), _where(
        (quarter == 1.0) | (quarter == 2.0), -second, second
    )

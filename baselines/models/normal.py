"""The normal distribution in compiled loops, made of additions, products and a division, so that the loops are vectorised.

With Mills' ratio R(z) = (1 - Phi(z)) / phi(z), z >= 0, the expected excess needs two exponentials only, because

    exp(m + s^2/2) phi(m/s + s) = phi(m/s)

The polynomial of R interpolates at Chebyshev points; its coefficients were computed with 60 digits. The absolute errors of all
functions are below 1e-15, times exp(m) for the excess.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp

_PER_ROOT_2_PI = 0.3989422804014327
_MAX = 10.0
"""The density is below 1e-22 beyond."""


@compiled
def mills_ratio(z):
    """Return (1 - Phi(z)) / phi(z) for z of 0 or more; constant from 10."""
    t = 1.0 - 10.0 / (min(z, _MAX) + 5.0)
    t2 = t * t
    t4 = t2 * t2
    t8 = t4 * t4
    c0 = (0.19280810471531581 - t * 0.3595947642342117) + t2 * (0.2909413656762593 - t * 0.20274581371209266)
    c4 = (0.11995557912973881 - t * 0.05868994497615522) + t2 * (0.022538023602826415 - t * 0.005962878741782521)
    c8 = (0.0005503324381250953 + t * 0.00033658545141463135) + t2 * (-0.00015146615821983158 + t * 2.3914561546254384e-06)
    c12 = (1.6602741066974073e-05 - t * 3.203592053906172e-06) + t2 * (-1.5504677349284748e-06 + t * 9.32786478549263e-07)
    c16 = 5.263084501644206e-07 + t * 7.623257574149927e-08
    return (c0 + t4 * c4) + t8 * ((c8 + t4 * c12) + t8 * c16)


@compiled
def density(x):
    """Return phi(x)."""
    return _PER_ROOT_2_PI * exp(-0.5 * x * x)


@compiled
def probability(x):
    """Return Phi(x)."""
    tail = density(x) * mills_ratio(abs(x))
    return 1.0 - tail if x > 0.0 else tail


@compiled
def excess(log_mean, spread):
    """Return the expectation of max(X - 1, 0), where log X is normal with this mean and a standard deviation above 0."""
    x = log_mean / spread
    shifted = x + spread
    at_limit = density(x)
    tail = at_limit * mills_ratio(abs(x))
    above = at_limit * mills_ratio(abs(shifted))
    mean = exp(log_mean + 0.5 * spread * spread)
    return (mean - above if shifted > 0.0 else above) - (1.0 - tail if x > 0.0 else tail)

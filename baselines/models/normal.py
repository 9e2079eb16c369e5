"""The normal distribution function for compiled loops, with the same bits as ``scipy.special.ndtr``.

An optimiser's set point follows from small differences of gains, so other bits could give other actions later in an episode.
The rational functions are those of the Cephes library, on which SciPy builds.
"""

import math

from turning_env.numerics.compilation import compiled

_ROOT_HALF = 0.7071067811865476


@compiled
def _polynomial(x, coefficients):
    """Return the polynomial with these coefficients, highest power first."""
    value = coefficients[0]
    for coefficient in coefficients[1:]:
        value = value * x + coefficient
    return value


_P = (
    2.46196981473530512524e-10,
    5.64189564831068821977e-1,
    7.46321056442269912687e0,
    4.86371970985681366614e1,
    1.96520832956077098242e2,
    5.26445194995477358631e2,
    9.34528527171957607540e2,
    1.02755188689515710272e3,
    5.57535335369399327526e2,
)
_Q = (
    1.0,
    1.32281951154744992508e1,
    8.67072140885989742329e1,
    3.54937778887819891062e2,
    9.75708501743205489753e2,
    1.82390916687909736289e3,
    2.24633760818710981792e3,
    1.65666309194161350182e3,
    5.57535340817727675546e2,
)
_R = (
    5.64189583547755073984e-1,
    1.27536670759978104416e0,
    5.01905042251180477414e0,
    6.16021097993053585195e0,
    7.40974269950448939160e0,
    2.97886665372100240670e0,
)
_S = (
    1.0,
    2.26052863220117276590e0,
    9.39603524938001434673e0,
    1.20489539808096656605e1,
    1.70814450747565897222e1,
    9.60896809063285878198e0,
    3.36907645100081516050e0,
)
_T = (
    9.60497373987051638749e0,
    9.00260197203842689217e1,
    2.23200534594684319226e3,
    7.00332514112805075473e3,
    5.55923013010394962768e4,
)
_U = (
    1.0,
    3.35617141647503099647e1,
    5.21357949780152679795e2,
    4.59432382970980127987e3,
    2.26290000613890934246e4,
    4.92673942608635921086e4,
)


@compiled
def probability(x):
    """Return the probability that a standard normal number is below x."""
    z = abs(x * _ROOT_HALF)
    if z < 1.0:
        y = x * _ROOT_HALF
        return 0.5 + 0.5 * (y * _polynomial(y * y, _T) / _polynomial(y * y, _U))
    if z > 26.0:  # SciPy: from 26.6; smaller than the last bit of any gain
        tail = 0.0
    elif z < 8.0:
        tail = 0.5 * (math.exp(-z * z) * _polynomial(z, _P) / _polynomial(z, _Q))
    else:
        tail = 0.5 * (math.exp(-z * z) * _polynomial(z, _R) / _polynomial(z, _S))
    return 1.0 - tail if x > 0.0 else tail


@compiled
def excess(log_mean, spread):
    """Return the expectation of max(X - 1, 0), where log X is normal with this mean and a standard deviation above 0."""
    ratio = log_mean / spread
    return math.exp(log_mean + 0.5 * (spread * spread)) * probability(ratio + spread) - probability(ratio)

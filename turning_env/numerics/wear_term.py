"""The term by which flank wear enters a law of force or power, for arrays and compiled code.

With W the flank wear [mm] and b the growth of the load with it [1/mm], the term is

    U = W          if b = 0: the papers' power law, by which a fresh edge has no load
    U = 1 + b W    if b > 0: a fresh edge has the load of the other factors alone

and the law is proportional to U^e. Measured loads follow the second form, with e = 1, better than
the first (``docs/models.md``). As b grows, U(W) / U(W_0) of the second form tends to that of the
first.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp, log, where


@compiled
def log_wear_term(growth, log_wear):
    """Return log U [-] at the logarithm of the flank wear [mm]; ``growth``: b [1/mm]."""
    return where(growth > 0.0, log(1.0 + growth * exp(log_wear)), log_wear)


@compiled
def wear_term_slope(growth, log_wear):
    """Return the derivative of log U by log W [-]: b W / (1 + b W), or 1 if b is 0."""
    grown = growth * exp(log_wear)
    return where(growth > 0.0, grown / (1.0 + grown), 1.0)


@compiled
def term_over_criterion(growth, log_wear):
    """Return log U [-] over that of a worn-out edge, at log wear over the criterion.

    ``growth``: that of a worn-out edge over a fresh one, b times the criterion [-].
    """
    return log_wear_term(growth, log_wear) - log_wear_term(growth, 0.0)


@compiled
def term_of_factor(growth, log_wear, log_factor):
    """Return log U(c W) - log U(W) [-], given log c: the effect of a factor c on the wear."""
    change = log_wear_term(growth, log_wear + log_factor) - log_wear_term(growth, log_wear)
    # With U = W, this is log c itself; the difference would only add an error of rounding.
    return where(growth > 0.0, change, log_factor)

"""The constraint on overload, by which policies are feasible.

Every task is a constrained Markov decision process (Altman 1999, "Constrained Markov decision
processes"). A step costs

    c = time in severe overload - allowance * cutting time    [s]

and a policy is feasible if the expected sum of an episode's costs is at most ``COST_LIMIT``. Over
many episodes this says that severe overload takes at most the allowed share of cutting time
(``limits.overload_allowance``). ``info["cost"]`` and the leaderboard both use this function.
"""

from turning_env.numerics.compilation import compiled

COST_LIMIT = 0.0
"""Largest expected sum of an episode's costs of a feasible policy [s]."""


@compiled
def overload_cost(severe_overload_time, engaged_time, allowance):
    """Return the cost [s] of times in severe overload and in metal [s].

    ``allowance`` is the allowed share of cutting time in severe overload [-].
    """
    return severe_overload_time - allowance * engaged_time

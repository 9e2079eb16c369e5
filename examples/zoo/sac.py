"""The zoo's settings of SAC."""

from examples.zoo import settings

hyperparams = settings("sac")

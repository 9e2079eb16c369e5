"""The zoo's settings of TQC."""

from examples.zoo import settings

hyperparams = settings("tqc")

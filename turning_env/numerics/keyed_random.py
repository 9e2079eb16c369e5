"""Random numbers as a pure function of the episode and a counter; no state is kept.

The episode is (seed, episode), the counter (channel, bar, index). So a single environment, one
among thousands and a replay draw the same numbers in any order. The hash is Philox4x32-10 (Salmon,
Moraes, Dror and Shaw, "Parallel random numbers: as easy as 1, 2, 3", 2011).
"""

import math
import zlib

import numpy as np

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import log, sine_and_cosine

# Uses of random numbers. Two uses of one channel would be correlated, so every use has its own.
# Trajectories depend on these numbers. A later use has a ``named_channel``, in its own file.
EDGE_CHANNEL = np.uint64(1)
BAR_CHANNEL = np.uint64(2)
HARDNESS_CHANNEL = np.uint64(3)
DEPTH_CHANNEL = np.uint64(4)
SENSOR_CHANNEL = np.uint64(5)
REFERENCE_CHANNEL = np.uint64(6)
CHIPPING_CHANNEL = np.uint64(7)
TANGLE_CHANNEL = np.uint64(8)
JOB_CHANNEL = np.uint64(9)


def named_channel(name: str) -> np.uint64:
    """Return the channel of a use, by a name that no other use has: the CRC-32 of the name.

    For example: ``COOLANT_CHANNEL = named_channel("coolant")``.
    """
    return np.uint64(zlib.crc32(name.encode()))


_WORD = np.uint64(0xFFFFFFFF)
_WORD_BITS = np.uint64(32)
# Constants of Philox4x32 (Salmon et al. 2011): multipliers of a round, and what a round adds to the
# two words of the key (fractional parts of the golden ratio and of the root of 3).
_MULTIPLIER_0 = np.uint64(0xD2511F53)
_MULTIPLIER_1 = np.uint64(0xCD9E8D57)
_WEYL_0 = np.uint64(0x9E3779B9)
_WEYL_1 = np.uint64(0xBB67AE85)
_ROUNDS = 10
_UNIT = 2.0**-32  # a word times this lies within 0..1


@compiled
def philox_4x32(counter_0, counter_1, counter_2, counter_3, key):
    """Return four 32-bit words (as uint64) for a counter of four 32-bit words and a 64-bit key."""
    key_0 = key & _WORD
    key_1 = key >> _WORD_BITS
    for _ in range(_ROUNDS):
        product_0 = counter_0 * _MULTIPLIER_0
        product_1 = counter_2 * _MULTIPLIER_1
        high_0 = product_0 >> _WORD_BITS
        high_1 = product_1 >> _WORD_BITS
        counter_0 = high_1 ^ counter_1 ^ key_0
        counter_1 = product_1 & _WORD
        counter_2 = high_0 ^ counter_3 ^ key_1
        counter_3 = product_0 & _WORD
        key_0 = (key_0 + _WEYL_0) & _WORD
        key_1 = (key_1 + _WEYL_1) & _WORD
    return counter_0, counter_1, counter_2, counter_3


@compiled
def words(state, i, channel, bar, index):
    """Return two words for one use in the present episode of environment i of a block.

    The state's ``seed`` and ``episode`` are the key, (channel, bar, index) the counter.
    """
    word_0, word_1, _, _ = philox_4x32(
        counter_0=np.uint64(index),
        counter_1=np.uint64(bar),
        counter_2=channel,
        counter_3=state.episode[i],
        key=state.seed[i],
    )
    return word_0, word_1


@compiled
def uniform(state, i, channel, bar, index):
    """Return a number drawn uniformly from 0..1 for one use in one episode; see ``words``."""
    word, _ = words(state, i, channel, bar, index)
    return (float(word) + 0.5) * _UNIT


@compiled
def exponential(state, i, channel, bar, index):
    """Return an exponential number with mean 1 for one use in one episode; see ``words``."""
    return -log(uniform(state, i, channel, bar, index))


@compiled
def normals_of(word_0, word_1):
    """Return two independent standard normal numbers made of two words (Box and Muller 1958)."""
    # Half a unit keeps the logarithm's argument above 0.
    uniform_number = (float(word_0) + 0.5) * _UNIT
    radius = math.sqrt(-2.0 * log(uniform_number))
    turns = float(word_1) * _UNIT
    sine, cosine = sine_and_cosine(turns)
    return radius * cosine, radius * sine


@compiled
def standard_normals(state, i, channel, bar, index):
    """Return two independent standard normal numbers for one use in one episode; see ``words``."""
    word_0, word_1 = words(state, i, channel, bar, index)
    return normals_of(word_0, word_1)

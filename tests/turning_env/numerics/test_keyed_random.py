"""Random numbers as a pure function of key and counter."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import kstest, norm

from turning_env.numerics import keyed_random
from turning_env.numerics.keyed_random import (
    JOB_CHANNEL,
    exponential,
    named_channel,
    normals_of,
    philox_4x32,
    standard_normals,
    uniform,
    words,
)

MAX_WORD = 0xFFFFFFFF


# kat_vectors of Random123, lines "philox4x32 10".
@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        pytest.param(
            (0, 0, 0, 0),
            (0, 0),
            (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8),
            id="zeros",
        ),
        pytest.param(
            (MAX_WORD, MAX_WORD, MAX_WORD, MAX_WORD),
            (MAX_WORD, MAX_WORD),
            (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD),
            id="ones",
        ),
        pytest.param(
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
            id="digits of pi",
        ),
    ],
)
def test_published_vectors(counter, key, expected):
    counter_words = [np.uint64(word) for word in counter]
    low, high = key
    words = philox_4x32(*counter_words, np.uint64(low | high << 32))
    assert tuple(int(word) for word in words) == expected


def test_a_named_channel_is_a_word_that_its_name_alone_decides():
    # CRC-32 of "123456789", the check value of its catalogue entries.
    assert named_channel("123456789") == np.uint64(0xCBF43926)
    assert JOB_CHANNEL < named_channel("coolant") <= MAX_WORD


KEY = (0x0000000A00000005, 3)  # seed and episode


def state_of(seed: int = KEY[0], episode: int = KEY[1]) -> Any:
    """Return a state of two environments; the second one has the key."""
    return SimpleNamespace(
        seed=np.array([1, seed], np.uint64), episode=np.array([9, episode], np.uint64)
    )


CHANNEL = np.uint64(7)


def test_the_key_is_the_seed_and_the_counter_index_bar_channel_and_episode():
    expected = philox_4x32(
        np.uint64(11), np.uint64(2), CHANNEL, np.uint64(KEY[1]), np.uint64(KEY[0])
    )
    assert words(state_of(), 1, CHANNEL, 2.0, 11.0) == expected[:2]


def test_a_uniform_number_is_the_middle_of_its_words_share_of_0_to_1():
    word, _ = words(state_of(), 1, CHANNEL, 2, 11)
    number = uniform(state_of(), 1, CHANNEL, 2, 11)
    assert number == (int(word) + 0.5) / 2**32
    assert exponential(state_of(), 1, CHANNEL, 2, 11) == pytest.approx(-math.log(number))


@pytest.mark.parametrize(
    ("word_0", "word_1"),
    [(0, 0), (MAX_WORD, 2**30), (2**31, 2**31), (123456789, 3 * 2**30 + 77)],
)
def test_two_words_make_two_normal_numbers_by_box_and_muller(word_0, word_1):
    radius = math.sqrt(-2.0 * math.log((word_0 + 0.5) / 2**32))
    angle = 2.0 * math.pi * word_1 / 2**32
    numbers = normals_of(np.uint64(word_0), np.uint64(word_1))
    expected = (radius * math.cos(angle), radius * math.sin(angle))
    assert numbers == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_numbers_have_the_distributions_of_scipy():
    state = state_of()
    normals = np.array([standard_normals(state, 1, CHANNEL, 0, k) for k in range(1000)])
    assert kstest(normals.ravel(), norm.cdf).pvalue > 0.01
    assert abs(np.corrcoef(normals.T)[0, 1]) < 0.1
    exponentials = [exponential(state, 1, CHANNEL, 1, k) for k in range(1000)]
    assert kstest(exponentials, "expon").pvalue > 0.01
    assert standard_normals(state, 1, CHANNEL, 4, 5) == normals_of(*words(state, 1, CHANNEL, 4, 5))


def test_every_use_has_a_channel_of_its_own():
    names = ("EDGE", "BAR", "HARDNESS", "DEPTH", "SENSOR", "REFERENCE", "CHIPPING", "TANGLE", "JOB")
    channels = [int(getattr(keyed_random, f"{name}_CHANNEL")) for name in names]
    # Trajectories depend on these numbers.
    assert channels == list(range(1, 10))

"""Random numbers as a pure function of key and counter."""

import numpy as np
import pytest

from turning_env.numerics.keyed_random import JOB_CHANNEL, named_channel, philox_4x32

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

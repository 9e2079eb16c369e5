"""Damaged files: mostly valid ones with a few bytes cut out, put in or doubled, or with odd values; and bytes of any kind."""

from hypothesis import strategies as st

from tests.soundness.damage import damaged
from tests.soundness.readers import READERS


def damages_of(valid: bytes) -> st.SearchStrategy[bytes]:
    """The content of a file with one to four damages, or something else altogether."""
    random = st.randoms(use_true_random=False)
    return st.one_of(*[st.builds(damaged, st.just(valid), random)] * 9, st.binary(max_size=300))


def damages(name: str) -> st.SearchStrategy[bytes]:
    """The same of the files that a reader of ``READERS`` takes, also so that they keep their form."""
    reader = READERS[name]
    valid = reader.valid()
    kept = st.builds(reader.damaged, st.sampled_from(valid), st.randoms(use_true_random=False))
    return st.one_of(kept, *map(damages_of, valid))

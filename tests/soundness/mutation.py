"""Damaged files: a valid one with a few bytes cut out, put in or doubled; and bytes of any kind."""

from hypothesis import strategies as st

ODD = (b"", b"\0", b"\xff", b"\n", b'"', b"[" * 3_000, b"{", b"9" * 5_000, b"1e999", b"nan", b"-1", b"null", b"=", b",")
"""What readers tend to stumble over."""


@st.composite
def damaged(draw: st.DrawFn, valid: bytes) -> bytes:
    """The content of a file with one to four damages, or something else altogether."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=300))
    content = valid
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, len(content)))
        end = min(place + draw(st.sampled_from((0, 0, 1, 1, 4, 40, len(content)))), len(content))
        kind = draw(st.integers(0, 2))
        if kind == 0:
            new = draw(st.sampled_from(ODD))
        elif kind == 1:
            new = draw(st.binary(max_size=6))
        else:
            start = draw(st.integers(0, len(content)))
            new = content[start : start + draw(st.integers(0, 60))]
        content = content[:place] + new + content[end:]
    return content

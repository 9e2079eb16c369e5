"""Numbers as a program has them: plain decimals, for not every control reads an exponent alike."""

DECIMALS = 12
"""Of coefficients: the third power of a load of 200 % times half of the last decimal is 4e-6."""
NUMBER = rf"\d{{1,12}}(?:\.\d{{0,{DECIMALS}}})?|\.\d{{1,{DECIMALS}}}"
"""Regular expression of a number without sign."""


def number_text(value: float) -> str:
    """A number with at least one decimal and at most ``DECIMALS``, without needless zeros."""
    whole, _, decimals = f"{value:.{DECIMALS}f}".partition(".")
    text = f"{whole}.{decimals.rstrip('0') or '0'}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def as_written(value: float) -> float:
    """The number that a program has for a value."""
    return float(number_text(value))

"""Write programs in the language of a SINUMERIK control."""

import textwrap
from collections.abc import Iterable, Iterator

from turning_nc.expression import number_text
from turning_nc.program import (
    FEED_DECIMALS,
    LENGTH_DECIMALS,
    LIMIT_DECIMALS,
    RETRACTION,
    SPEED_DECIMALS,
    Block,
    Program,
)
from turning_nc.synchronous import Action, Condition, Evaluate, Law

WARNING = "SIMULATION OUTPUT: NOT FOR A MACHINE WITHOUT REVIEW"
SAFE_START = "G18 G40 G54 G64 G90 G95 G710 DIAMON"
"""Plane ZX; no tool radius compensation; first zero offset; no stop between blocks; absolute; feed per revolution; mm; X is a
diameter. G95 must stand before G96, which it would end."""
TOOL = "T1 D1"
UNITS = (
    "X: diameter in mm; Z: mm, 0 at the face of the bar; S: cutting speed in m/min (G96); F: feed in mm/rev; "
    "LIMS: highest spindle speed in rev/min"
)
NUMBER_STEP = 10
COMMENT_WIDTH = 100


def write(program: Program, comments: Iterable[str] = ()) -> str:
    """Return the text of a program: warning, comments, units, and numbered blocks."""
    lines = [f"; {line}" for text in (WARNING, *comments, UNITS) for line in textwrap.wrap(_plain(text), COMMENT_WIDTH) or [""]]
    for index, block in enumerate(_blocks(program), 1):
        lines.append(f"N{NUMBER_STEP * index} {block}")
    return "\n".join(lines) + "\n"


def _blocks(program: Program) -> Iterator[str]:
    yield SAFE_START
    yield TOOL
    if program.law is not None:
        yield from _law_blocks(program.law)
    limit = f" LIMS={program.max_spindle_speed:.{LIMIT_DECIMALS}f}"
    across = f"{program.diameter + 2.0 * RETRACTION:.{LENGTH_DECIMALS}f}"
    start = f"{program.start:.{LENGTH_DECIMALS}f}"
    for number, blocks in enumerate(program.bars):
        speed, feed = _speed(blocks[0]), _feed(blocks[0])
        yield f"G96 {speed} {feed}{limit} M03{_note(f'bar {number + 1}')}"
        limit = ""
        yield f"G00 X{across} Z{start}"
        yield f"G00 X{program.diameter:.{LENGTH_DECIMALS}f}"
        for block in blocks:
            words = [f"G01 Z{block.z:.{LENGTH_DECIMALS}f}"]
            if _speed(block) != speed:
                words.append(speed := _speed(block))
            if _feed(block) != feed:
                words.append(feed := _feed(block))
            yield " ".join(words) + _note(block.note)
        yield f"G00 X{across}"
        yield f"G00 Z{start}"
        yield "M05"
        if number + 1 < len(program.bars):
            yield f"M00{_note('the next bar is put in')}"
    yield "M30"


def _speed(block: Block) -> str:
    return f"S{block.cutting_speed:.{SPEED_DECIMALS}f}"


def _feed(block: Block) -> str:
    return f"F{block.feed:.{FEED_DECIMALS}f}"


def _note(text: str) -> str:
    return f" ; {_plain(text)}" if text else ""


def _plain(text: str) -> str:
    """Return a comment's text as one line of ASCII, which every control can show."""
    return " ".join(text.encode("ascii", "replace").decode().split())


def _law_blocks(law: Law) -> Iterator[str]:
    if law.initial:
        yield "STOPRE"
    for name, value in law.initial:
        yield f"{name}={number_text(value)}"
    for polynomial in law.polynomials:
        values = (polynomial.low, polynomial.high, *polynomial.coefficients)
        yield f"FCTDEF({polynomial.number},{','.join(map(number_text, values))})"
    for action in law.actions:
        yield _action(action)


def _action(action: Action) -> str:
    effect = action.effect
    if isinstance(effect, Evaluate):
        done = f"SYNFCT({effect.polynomial},{effect.output},{effect.input})"
    else:
        done = f"{effect.output}={effect.expression}"
    if not action.conditions:
        return f"ID={action.number} DO {done}"
    texts = [_condition(condition) for condition in action.conditions]
    condition = texts[0] if len(texts) == 1 else " AND ".join(f"({text})" for text in texts)
    return f"ID={action.number} WHENEVER {condition} DO {done}"


def _condition(condition: Condition) -> str:
    return f"{condition.variable}{condition.comparison}{condition.value}"

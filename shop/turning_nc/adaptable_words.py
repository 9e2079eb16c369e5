"""The F and S words of a program that may change, and the program's text with other values in them.

A word sets the feed or the speed of slices until another word replaces it. ``word_search`` chooses
the values; ``adapt`` says when a program is changed at all.
"""

import bisect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Situation
from turning_nc.dialects import with_line_feeds
from turning_nc.expression import number_text
from turning_nc.modal import Setting
from turning_nc.moves import Move
from turning_nc.words import NcError, Span
from turning_shop import Values

FEED_DECIMALS = 3
FEED_DECIMALS_INCH = 5
NO_WORD = -1
"""Index in place of a word's where none sets a value."""

Where = Literal["words", "blocks"]
"""Places of changes: existing words, or every block, which gets words of its own."""
Indices = NDArray[np.int64]


class FeedChange(NamedTuple):
    """Highest feed in metal before and after a change [mm/rev]."""

    before: float
    after: float


@dataclass(frozen=True)
class Change:
    """A word that was changed or put in."""

    line: int
    before: str  # the word as it was; empty if it was put in
    after: str
    feeds: FeedChange | None = None  # None for a speed


@dataclass(frozen=True)
class AdaptableWord:
    """A word whose value may change."""

    address: str  # F or S
    line: int
    span: Span | None  # place of its number in the text; None if the word is put in

    @property
    def is_feed(self) -> bool:
        """Whether it is an F word."""
        return self.address == "F"


class _Edit(NamedTuple):
    """A part of the text and what replaces it."""

    begin: int
    end: int
    text: str


class AdaptableWords:
    """The words of a program that may change.

    Attributes:
        words: the words; all other attributes name them by their indices here.
        scales: the value of each word, in mm/rev or m/min, over its number as written.
        feed_of: the word that sets the feed of each slice, or ``NO_WORD``.
        speed_of: the word that sets the speed of each slice, or ``NO_WORD``.
        slices_of_feed: the slices of each F word.
        slices_of_speed: the slices of each S word.
        finishing_feeds: feeds of the F words that stay, because their cuts make the surface
            [mm/rev].
    """

    def __init__(self, situation: Situation, where: Where, finishing_depth: float) -> None:
        """Find the words of a program.

        Args:
            situation: the program on its stock.
            where: what changes.
            finishing_depth: depth of cut up to which the feed stays [mm].

        Raises:
            NcError: no word can change.
        """
        self._situation = situation
        self._text = situation.moves.program.text
        self.words: list[AdaptableWord] = []
        self.scales: list[float] = []
        self.feed_of, self.speed_of = self._find(where)

        # A speed that cuts nothing in metal, as in an approach, stays as it is.
        in_metal = np.unique(self.speed_of[situation.engaged])
        self.speed_of[~np.isin(self.speed_of, in_metal)] = NO_WORD
        self.slices_of_feed = _grouped(self.feed_of)
        self.slices_of_speed = _grouped(self.speed_of)
        if not (self.slices_of_feed or self.slices_of_speed):
            raise NcError(
                "the program has no F word in mm/rev and no S word under G96, "
                "so nothing can be adapted"
            )
        self.finishing_feeds = {
            word: float(situation.feed[slices].max())
            for word, slices in self.slices_of_feed.items()
            if situation.is_finishing(slices, finishing_depth)
        }

    def _find(self, where: Where) -> tuple[Indices, Indices]:
        """Return the words that set the feed and the speed of each slice."""
        s = self._situation
        moves = s.moves.moves
        finder = _WordFinder(s, where)
        feed_of = np.full(len(s.tool), NO_WORD)
        speed_of = np.full(len(s.tool), NO_WORD)
        begins = np.searchsorted(s.removal.slices.move, np.arange(len(moves) + 1)).tolist()
        index_of: dict[AdaptableWord, int] = {}

        def index(word: AdaptableWord | None, scale: float) -> int:
            if word is None:
                return NO_WORD
            if word not in index_of:
                index_of[word] = len(self.words)
                self.words.append(word)
                self.scales.append(scale)
            return index_of[word]

        for number, move in enumerate(moves):
            if move.kind != "feed":
                continue
            slices = slice(begins[number], begins[number + 1])
            is_in_metal = bool(s.engaged[slices].any())
            if move.per_revolution:
                word = finder.word("F", move.feed, move=move, is_in_metal=is_in_metal)
                feed_of[slices] = index(word, move.feed.scale)
            if move.constant_cutting_speed:
                word = finder.word("S", move.speed, move=move, is_in_metal=is_in_metal)
                speed_of[slices] = index(word, move.speed.scale)
        return feed_of, speed_of

    def rounded_feed(self, feed: float, word: int) -> float:
        """Return a feed as a word can hold it.

        It is rounded down, so that limits are kept, but not below the machine's lowest.
        """
        if word in self.finishing_feeds:
            return feed
        step = self.scales[word] * 10.0 ** -self._decimals(word)
        steps = math.floor(feed / step + 1e-9)
        min_steps = math.ceil(self._situation.min_feed / step - 1e-9)
        return max(steps, min_steps) * step

    def _decimals(self, word: int) -> int:
        if not self.words[word].is_feed:
            return 0
        is_metric = self.scales[word] == 1.0
        return FEED_DECIMALS if is_metric else FEED_DECIMALS_INCH

    def written(self, values: Values, feed_before: Values) -> tuple[str, tuple[Change, ...]]:
        """Return the text with values in its words, and the words that changed.

        Args:
            values: a value for each word [mm/rev] or [m/min].
            feed_before: feeds of the slices before the change [mm/rev].
        """
        ends = {move.line: move.line_end for move in self._situation.moves.moves}
        used = sorted(self.slices_of_feed.keys() | self.slices_of_speed.keys())
        edits = []
        changes = []
        for index in used:
            word = self.words[index]
            number = self._number_text(index, values[index] / self.scales[index])
            after = f"{word.address}{number}"
            feeds = None
            if word.is_feed:
                feeds = self._feed_change(index, float(values[index]), feed_before=feed_before)
            if word.span is None:
                end = ends[word.line]
                edits.append(_Edit(end, end, text=f" {after}"))
                changes.append(Change(word.line, "", after=after, feeds=feeds))
                continue
            old_text = self._text[word.span.begin : word.span.end]
            old_number = "".join(old_text.split())  # controls skip blanks in numbers
            is_same = math.isclose(float(old_number), float(number), rel_tol=1e-9)
            if not is_same and index not in self.finishing_feeds:
                before = f"{word.address}{old_number}"
                edits.append(_Edit(word.span.begin, word.span.end, text=number))
                changes.append(Change(word.line, before, after=after, feeds=feeds))
        changes.sort(key=lambda change: change.line)
        return _edited(self._text, edits), tuple(changes)

    def _number_text(self, word: int, number: float) -> str:
        decimals = self._decimals(word)
        return number_text(number, decimals) if decimals else f"{number:.0f}"

    def _feed_change(self, word: int, feed: float, feed_before: Values) -> FeedChange:
        slices = self.slices_of_feed[word]
        in_metal = slices[self._situation.engaged[slices]]
        before = float(feed_before[in_metal].max(initial=0.0))
        return FeedChange(before=before, after=feed)


class _WordFinder:
    """Finds the word that would change the feed or speed of a move."""

    def __init__(self, situation: Situation, where: Where) -> None:
        self._where = where
        program = situation.moves.program
        text = with_line_feeds(program.text)
        self._line_ends = [place for place, letter in enumerate(text) if letter == "\n"]
        self._addresses: dict[int, set[str]] = {}
        for lines in program.parts.values():
            for line in lines:
                self._addresses[line.number] = {word.address for word in line.words}

    def word(
        self, address: str, setting: Setting, move: Move, is_in_metal: bool
    ) -> AdaptableWord | None:
        """Return the word; None if no word can change the setting."""
        line = 0
        if setting.span is not None:
            line = bisect.bisect_left(self._line_ends, setting.span.begin) + 1
        addresses = self._addresses.get(move.line, set())
        is_set_in_block = address in addresses or "CYCLE95" in addresses
        if self._where == "words" or line == move.line or is_set_in_block:
            if setting.span is None:  # the value is computed
                return None
            return AdaptableWord(address, line, span=setting.span)
        if is_in_metal:  # nothing is put into blocks in air
            return AdaptableWord(address, move.line, span=None)
        return None


def _edited(text: str, edits: list[_Edit]) -> str:
    """Return a text with parts of it replaced."""
    pieces = []
    place = 0
    for edit in sorted(edits):
        pieces.append(text[place : edit.begin])
        pieces.append(edit.text)
        place = edit.end
    pieces.append(text[place:])
    return "".join(pieces)


def _grouped(words: Indices) -> Mapping[int, Indices]:
    """Return the slices of every word."""
    order = np.argsort(words, kind="stable")
    distinct, starts = np.unique(words[order], return_index=True)
    groups = {}
    for word, slices in zip(distinct.tolist(), np.split(order, starts[1:]), strict=True):
        if word != NO_WORD:
            groups[word] = slices
    return groups

"""The F and S words of a program that may change, and the program's text with other values in them.

A word sets the feed or the speed of slices until another word replaces it. ``word_search`` chooses
the values; ``adapt`` says when a program is changed at all. ``finishing`` finds the contours that
get one speed.
"""

import bisect
import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Situation
from turning_nc.dialects import with_line_feeds
from turning_nc.expression import number_text
from turning_nc.finishing import Finishing
from turning_nc.modal import Setting
from turning_nc.moves import Move
from turning_nc.words import NcError, Span
from turning_shop import Values

FEED_DECIMALS = 3
FEED_DECIMALS_INCH = 5
MIN_CHANGE = 0.02  # relative change below which a word stays as it is [-]
SAME_VALUE = 1e-9  # relative difference of equal values [-]
NO_WORD = -1
"""Index in place of a word's where none sets a value."""

Where = Literal["words", "blocks"]
"""Places of changes: existing words, or every block, which gets words of its own."""
Indices = NDArray[np.int64]
Mask = NDArray[np.bool_]


class NothingToAdaptError(NcError):
    """No word of a program can change."""


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
    nose_radius: float = 0.0  # of the insert [mm]; 0 if it is not known


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


class _Range(NamedTuple):
    """Lowest and highest value of a word or of tied words, as programmed [mm/rev] or [m/min]."""

    low: float
    high: float


class _Edit(NamedTuple):
    """A part of the text and what replaces it."""

    begin: int
    end: int
    text: str


class AdaptableWords:
    """The words of a program that may change.

    Words that set the speed of one finishing contour are tied: they get one value, and one of
    them stands for all.

    Attributes:
        words: the words; all other attributes name them by their indices here.
        scales: the value of each word, in mm/rev or m/min, over its number as written.
        feed_of: the word that sets the feed of each slice, or ``NO_WORD``.
        speed_of: the word that sets the speed of each slice, or ``NO_WORD``.
        slices_of_feed: the slices of each F word.
        slices_of_speed: the slices of each S word.
        given_feeds: feeds of the F words that stay [mm/rev]; they make the surface, are those of
            tools that the scenario does not describe, or would hardly change.
        highest_feeds: feeds above which F words do not go [mm/rev]; they make the surface, but
            must fall, because they exceed a limit.
    """

    def __init__(self, situation: Situation, where: Where, is_overloaded: Mask) -> None:
        """Find the words of a program.

        Args:
            situation: the program on its stock.
            where: what changes.
            is_overloaded: slices that exceed a limit before the change.

        Raises:
            NothingToAdaptError: no word can change.
        """
        self._situation = situation
        self._text = situation.moves.program.text
        self.words: list[AdaptableWord] = []
        self.scales: list[float] = []

        count = len(situation.moves.moves)
        move_of_slice = situation.removal.slices.move
        self._cuts = np.bincount(move_of_slice, situation.engaged, minlength=count) > 0.0

        # The word that sets the feed and the speed of each move, before words are tied.
        self._feed_of_move = np.full(count, NO_WORD)
        self._speed_of_move = np.full(count, NO_WORD)
        self._find(where)
        self._contrary: set[int] = set()  # words that set several speeds of a finishing contour
        finishing = Finishing(situation)
        self._tied_to = self._ties(finishing.contours)
        self._programmed = self._programmed_ranges()
        self.feed_of = self._feed_of_move[move_of_slice]
        self.speed_of = np.append(self._tied_to, NO_WORD)[self._speed_of_move[move_of_slice]]

        # A speed that cuts nothing in metal, as in an approach, stays as it is. So does a word that
        # also sets the speed of a tool, a thread or a drill without a law.
        works = situation.engaged | situation.threads_and_drills
        lawless = works & ~(situation.engaged & situation.is_described)
        in_metal = np.unique(self.speed_of[situation.engaged])
        contrary = self._tied_to[sorted(self._contrary - {NO_WORD})]
        stays = ~np.isin(self.speed_of, in_metal) | np.isin(self.speed_of, contrary)
        stays |= np.isin(self.speed_of, self.speed_of[lawless])
        self.speed_of[stays] = NO_WORD
        self.slices_of_feed = _grouped(self.feed_of)
        self.slices_of_speed = _grouped(self.speed_of)
        if not (self.slices_of_feed or self.slices_of_speed):
            raise NothingToAdaptError(
                "the program has no F word in mm/rev and no S word under G96 of a tool that the "
                "scenario describes, so nothing can be adapted"
            )
        self.given_feeds: dict[int, float] = {}
        self.highest_feeds: dict[int, float] = {}
        self._hold_feeds(finishing, lawless, is_overloaded)

    def _hold_feeds(self, finishing: Finishing, lawless: Mask, is_overloaded: Mask) -> None:
        """Keep the programmed feeds that no law or the surface forbids to change.

        The feed of a surface may fall where it exceeds a limit.

        Args:
            finishing: finds the slices that make the surface.
            lawless: slices of tools, threads and drills without a law.
            is_overloaded: slices that exceed a limit before the change.
        """
        for word, slices in self.slices_of_feed.items():
            programmed = float(self._situation.feed[slices].max())
            if lawless[slices].any():
                self.given_feeds[word] = programmed
            elif finishing.is_finishing(slices):
                must_fall = is_overloaded[slices].any()
                feeds = self.highest_feeds if must_fall else self.given_feeds
                feeds[word] = programmed

    def _find(self, where: Where) -> None:
        """Find the words that set the feed and the speed of each move."""
        s = self._situation
        moves = s.moves.moves
        finder = _WordFinder(s, where)
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
            is_in_metal = bool(self._cuts[number])
            if move.per_revolution:
                word = finder.word("F", move.feed, move=move, is_in_metal=is_in_metal)
                self._feed_of_move[number] = index(word, move.feed.scale)
            if move.constant_cutting_speed:
                word = finder.word("S", move.speed, move=move, is_in_metal=is_in_metal)
                self._speed_of_move[number] = index(word, move.speed.scale)

    def _ties(self, contours: Iterable[range]) -> Indices:
        """Return the word to which each is tied: the first of those of a finishing contour.

        If the program itself changes the speed within a contour, all its speeds stay.
        """
        moves = self._situation.moves.moves
        tied_to = list(range(len(self.words)))

        def first(word: int) -> int:
            while tied_to[word] != word:
                word = tied_to[word]
            return word

        for contour in contours:
            cuts = [number for number in contour if self._cuts[number]]
            speeds = set()
            for number in cuts:
                speed = moves[number].speed
                speeds.add((speed.value, speed.scale))
            words = np.unique(self._speed_of_move[cuts]).tolist()
            if len(speeds) > 1 or NO_WORD in words:
                self._contrary.update(words)
            words = [word for word in words if word != NO_WORD]
            for word in words[1:]:
                low, high = sorted((first(words[0]), first(word)))
                tied_to[high] = low
        firsts = [first(word) for word in range(len(self.words))]
        return np.array(firsts, np.int64)

    def _programmed_ranges(self) -> list[_Range]:
        """Return the programmed values of each word, and of those that are tied to it."""
        ranges = [_Range(math.inf, 0.0)] * len(self.words)

        def add(word: int, value: float) -> None:
            low, high = ranges[word]
            ranges[word] = _Range(min(low, value), max(high, value))

        for number, move in enumerate(self._situation.moves.moves):
            feed = int(self._feed_of_move[number])
            speed = int(self._speed_of_move[number])
            if feed != NO_WORD:
                add(feed, move.feed.value)
            if speed != NO_WORD:
                add(speed, move.speed.value)
                add(int(self._tied_to[speed]), move.speed.value)
        return ranges

    def small_changes(self, values: Values) -> dict[int, float]:
        """Return the words that would change by less than ``MIN_CHANGE``, and by how much [-]."""
        small = {}
        for word in self.slices_of_feed.keys() | self.slices_of_speed.keys():
            if word in self.given_feeds:
                continue
            low, high = self._programmed[word]
            number = float(self._number_text(word, values[word])) * self.scales[word]
            rise = number / low - 1.0
            fall = number / high - 1.0
            change = max(rise, -fall)
            if SAME_VALUE < change < MIN_CHANGE:
                small[word] = rise
        return small

    def keeping(self, stay: Iterable[int]) -> Self:
        """Return the words with some more that stay as they are programmed."""
        words = copy.copy(self)
        words.given_feeds = dict(self.given_feeds)
        speeds = []
        for word in stay:
            if word in self.slices_of_feed:
                words.given_feeds[word] = self._programmed[word].high
            else:
                speeds.append(word)
        words.speed_of = np.where(np.isin(self.speed_of, speeds), NO_WORD, self.speed_of)
        words.slices_of_speed = _grouped(words.speed_of)
        return words

    def rounded_feed(self, feed: float, word: int) -> float:
        """Return a feed as a word can hold it.

        It is rounded down, so that limits are kept, but not below the machine's lowest.
        """
        if word in self.given_feeds:
            return feed
        if feed == self.highest_feeds.get(word):
            return feed
        decimals = self._decimals(word)
        step = self.scales[word] * 10.0**-decimals
        min_feed = self._situation.min_feed
        steps = math.floor(feed / step + 1e-9)
        min_steps = math.ceil(min_feed / step - 1e-9)
        return max(steps, min_steps) * step

    def _decimals(self, word: int) -> int:
        if not self.words[word].is_feed:
            return 0
        is_metric = self.scales[word] == 1.0
        return FEED_DECIMALS if is_metric else FEED_DECIMALS_INCH

    def _number_text(self, word: int, value: float) -> str:
        """Return a value [mm/rev] or [m/min] as a word holds it."""
        number = value / self.scales[word]
        decimals = self._decimals(word)
        return number_text(number, decimals) if decimals else f"{number:.0f}"

    def _exact_text(self, word: int, value: float) -> str:
        """Return a programmed value as a word holds it."""
        text = number_text(value / self.scales[word])
        return text if self.words[word].is_feed else text.removesuffix(".0")

    # The text with other values.

    def written(self, values: Values, feed_before: Values) -> tuple[str, tuple[Change, ...]]:
        """Return the text with values in its words, and the words that changed.

        Args:
            values: a value for each word [mm/rev] or [m/min].
            feed_before: feeds of the slices before the change [mm/rev].
        """
        ends = {move.line: move.line_end for move in self._situation.moves.moves}
        all_values = self._all_values(values)
        put_in = self._words_to_put_in(all_values)
        edits = []
        changes = []
        for index, value in enumerate(all_values):
            word = self.words[index]
            number = self._number_text(index, value)
            if not self._changes(index):
                number = self._exact_text(index, value)
            after = f"{word.address}{number}"
            feeds = None
            if word.is_feed:
                feeds = self._feed_change(index, value, feed_before=feed_before)
            if word.span is None:
                if index in put_in:
                    end = ends[word.line]
                    edits.append(_Edit(end, end, text=f" {after}"))
                    changes.append(Change(word.line, "", after=after, feeds=feeds))
                continue
            old_text = self._text[word.span.begin : word.span.end]
            old_number = "".join(old_text.split())  # controls skip blanks in numbers
            is_same = math.isclose(float(old_number), float(number), rel_tol=1e-9)
            if not is_same and self._changes(index):
                before = f"{word.address}{old_number}"
                edits.append(_Edit(word.span.begin, word.span.end, text=number))
                changes.append(Change(word.line, before, after=after, feeds=feeds))
        changes.sort(key=lambda change: change.line)
        return _edited(self._text, edits), tuple(changes)

    def _changes(self, word: int) -> bool:
        """Return whether the value of a word is searched."""
        if self.words[word].is_feed:
            return word in self.slices_of_feed and word not in self.given_feeds
        return int(self._tied_to[word]) in self.slices_of_speed

    def _all_values(self, values: Values) -> list[float]:
        """Return the value of every word: as searched, or as programmed if it stays."""
        all_values = []
        for word in range(len(self.words)):
            value = self._programmed[word].high
            if self._changes(word):
                value = float(values[self._tied_to[word]])
            all_values.append(value)
        return all_values

    def _words_to_put_in(self, values: Sequence[float]) -> set[int]:
        """Return the new words whose values are not in force where they would be put in."""
        moves = self._situation.moves.moves
        feeds = [move.feed for move in moves]
        speeds = [move.speed for move in moves]
        of_feeds = self._not_in_force(values, feeds, word_of_move=self._feed_of_move)
        of_speeds = self._not_in_force(values, speeds, word_of_move=self._speed_of_move)
        return of_feeds | of_speeds

    def _not_in_force(
        self, values: Sequence[float], settings: Sequence[Setting], word_of_move: Indices
    ) -> set[int]:
        """Return the words of moves, of those to put in, whose values are not in force before."""
        words: set[int] = set()
        # A word of the program makes a new setting each time that it is run. Cycles may put an
        # earlier one into force again.
        in_force: dict[int, float] = {}
        for setting, word in zip(settings, word_of_move.tolist(), strict=True):
            if word == NO_WORD:
                continue
            before = in_force.get(id(setting), setting.value)
            is_same = math.isclose(before, values[word], rel_tol=SAME_VALUE)
            if self.words[word].span is None and not is_same:
                words.add(word)
            in_force[id(setting)] = values[word]
        return words

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
    slices_of_words = np.split(order, starts[1:])
    groups = {}
    for word, slices in zip(distinct.tolist(), slices_of_words, strict=True):
        if word != NO_WORD:
            groups[word] = slices
    return groups

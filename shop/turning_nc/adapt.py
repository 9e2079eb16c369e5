"""Choose the feeds and speeds of a part program anew, and write it back with only its F and S words changed.

Every F word, and every S word of a constant cutting speed, gets the constant value that makes the program shortest. The limits
are the scenario's force and power with the edge worn as at its change, the machine's range, and the edges that the program
used before.
"""

import bisect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import (
    FINISHING_DEPTH,
    Play,
    Situation,
    highest_feed,
    play,
    spindle_speed,
    tool_life,
)
from turning_nc.dialects import with_line_feeds
from turning_nc.edges import change_wear
from turning_nc.expression import number_text
from turning_nc.moves import run
from turning_nc.words import NcError, divide
from turning_shop import Values
from turning_shop.whatif import CHANGES

from turning_env.extras import needed

with needed():
    from tqdm import tqdm

FEED_DECIMALS, FEED_DECIMALS_INCH = 3, 5
_LIFE_MARGIN = 0.998  # share of the allowed life that is planned for, as words are rounded
_MIN_PRICE, _MAX_PRICE = 1.0, 1e6  # range of prices of an edge's life that are tried [s]
_PRICE_STEP = 1.02  # ratio of prices that count as equal [-]
_CANDIDATES = 61
_MAX_VALUES = 1_000_000  # numbers of an array of cuts at several speeds: they take memory

Where = Literal["words", "blocks"]
Key = tuple[str, int, tuple[int, int] | None]
"""Key of a value: address, line, and the place of the number in it; None if a word is put in."""


@dataclass(frozen=True)
class Change:
    """A word that was changed or put in."""

    line: int
    before: str  # the word as it was; empty if it was put in
    after: str
    feeds: tuple[float, float] | None = (
        None  # highest feed in metal before and after [mm/rev]; None for a speed
    )


@dataclass(frozen=True)
class Adapted:
    """A program with other feeds and speeds, read again and played."""

    text: str
    changes: tuple[Change, ...]
    situation: Situation
    played: Play


def adapt(
    situation: Situation,
    wear: float | None = None,
    where: Where = "words",
    life: float = 1.0,
    finishing_depth: float = FINISHING_DEPTH,
) -> Adapted:
    """Return the program with the feeds and speeds that make it shortest; unchanged if none make it shorter.

    ``where`` says whether existing words change, or every block gets one. The program may use ``life`` times the edges that it
    used before [-]. These are changed at a flank wear ``wear`` [mm]; by default as ``change_wear`` says, and after that where the
    program is shortest. Feeds of words whose cuts are no deeper than ``finishing_depth`` [mm] stay.

    Raises:
        NcError: no F word per revolution and no S word of a constant cutting speed can be changed.
    """
    first = change_wear(situation) if wear is None else np.full(len(situation.tool), wear)
    before = play(situation, first)

    def planned(highest: float) -> tuple[float, _Search, Values]:
        search = _Search(situation, np.minimum(first, highest), where, finishing_depth)
        values = search.within_life(
            life * _LIFE_MARGIN * search.before.life_at_change / before.life_at_change
        )
        found = play(situation, search.wear, *search.settings(values))
        excess = max(float(found.load.max()) - 1.0, 0.0)
        if before.load.max() <= 1.0:  # an overload is removed at any price
            for mine in situation.by_tool.values():
                used, allowed = (
                    each.used_life[mine].sum() / each.life_at_change[mine][0]
                    for each in (found, before)
                )  # edges
                excess += max(float(used - life * allowed), 0.0)
        return float(found.time.sum()) + 1e6 * excess, search, values

    best = planned(first.max())
    earlier = CHANGES[::-1] * situation.scenario.tool.wear_criterion if wear is None else ()
    for highest in tqdm(earlier, "adapting", unit="wear", leave=False, disable=None):
        if highest < first.max():
            found = planned(highest)
            if found[0] >= best[0]:
                break
            best = found
    _, search, values = best
    text, changes = search.written(values)
    moves = run(divide(text, situation.moves.program.dialect), situation.moves.reading)
    if [move.path for move in moves.moves] != [move.path for move in situation.moves.moves]:
        raise NcError(
            "the program with other feeds and speeds makes other moves: a word of it cannot be changed alone"
        )
    again = Situation(
        situation.scenario, situation.machine, moves, situation.removal, situation.evidence
    )
    played = play(again, change_wear(again) if wear is None else search.wear)
    if (
        life >= 1.0 and before.load.max() <= 1.0 and before.time.sum() <= played.time.sum()
    ):  # it is as short as it can be
        return Adapted(search.text, (), situation, before)
    return Adapted(text, changes, again, played)


class _Search:
    """The words of a program that can change, and the times, loads and lives that follow."""

    def __init__(
        self, situation: Situation, wear: Values, where: Where, finishing_depth: float
    ) -> None:
        self.situation = s = situation
        self.wear = wear
        self.before = play(situation, wear)
        self.text = s.moves.program.text
        self.ends = {move.line: move.line_end for move in s.moves.moves}
        self._find_words(where)

        # A speed that cuts nothing in metal, as in an approach, stays as it is.
        in_metal = np.unique(self.speed_of[s.engaged])
        self.speed_of[~np.isin(self.speed_of, in_metal)] = -1
        self.cuts_of_feed = _grouped(self.feed_of)
        self.cuts_of_speed = _grouped(self.speed_of)
        self.used = sorted(self.cuts_of_feed.keys() | self.cuts_of_speed.keys())
        if not self.used:
            raise NcError(
                "the program has no F word in mm/rev and no S word under G96, so nothing can be adapted"
            )
        self.fixed = {
            key: float(s.feed[cuts].max())
            for key, cuts in self.cuts_of_feed.items()
            if s.is_finishing(cuts, finishing_depth)
        }

        self.tool_of = np.zeros(len(s.tool), np.int64)
        for number, mine in enumerate(s.by_tool.values()):
            self.tool_of[mine] = number
        self._sort_words()

    def _find_words(self, where: Where) -> None:
        """Find the words that can change, and the slices of which each sets the feed or the speed."""
        s = self.situation
        keys: dict[Key, int] = {}
        self.scales: list[float] = []
        self.feed_of, self.speed_of = np.full((2, len(s.tool)), -1)
        line_ends = [
            place for place, letter in enumerate(with_line_feeds(self.text)) if letter == "\n"
        ]
        words = {
            line.number: line.words for part in s.moves.program.parts.values() for line in part
        }
        begins = np.searchsorted(s.removal.slices.move, np.arange(len(s.moves.moves) + 1)).tolist()

        def index(key: Key, scale: float) -> int:
            if key not in keys:
                keys[key] = len(keys)
                self.scales.append(scale)
            return keys[key]

        for number, move in enumerate(s.moves.moves):
            mine = slice(begins[number], begins[number + 1])
            feed = "F", move.feed, move.per_revolution, self.feed_of
            for address, setting, changes, of in (
                feed,
                ("S", move.speed, move.constant_cutting_speed, self.speed_of),
            ):
                if move.kind != "feed" or not changes:
                    continue
                line = (
                    0
                    if setting.span is None
                    else bisect.bisect_left(line_ends, setting.span[0]) + 1
                )
                written = any(
                    word.address in ("CYCLE95", address) for word in words.get(move.line, ())
                )
                if where == "words" or line == move.line or written:
                    of[mine] = (
                        -1
                        if setting.span is None
                        else index((address, line, setting.span), setting.scale)
                    )
                elif s.engaged[mine].any():  # nothing is put into blocks in air
                    of[mine] = index((address, move.line, None), setting.scale)
        self.keys = list(keys)

    def _sort_words(self) -> None:
        """Find the speeds that can be chosen each for itself, as their feeds go with no other speed; and all others."""
        speeds_of_feed = {
            feed: _distinct(self.speed_of[cuts]) for feed, cuts in self.cuts_of_feed.items()
        }
        feeds_of_speed = {
            speed: _distinct(self.feed_of[cuts]) for speed, cuts in self.cuts_of_speed.items()
        }
        self.shared = any(
            np.unique(self.speed_of[cuts]).size > 1 for cuts in self.cuts_of_feed.values()
        )
        self.choices_together: list[_Choices] = []
        self.choices_alone: list[_Choices] = []
        by_scale: dict[float, list[int]] = {}
        for speed, feeds in feeds_of_speed.items():
            if all(speeds_of_feed[feed] == [speed] for feed in feeds):
                by_scale.setdefault(self.scales[speed], []).append(speed)
            else:
                self.choices_alone.append(_Choices(self, [speed], feeds_of_speed))
        for speeds in by_scale.values():
            self.choices_together.append(_Choices(self, speeds, feeds_of_speed))
        loose = [cuts for feed, cuts in self.cuts_of_feed.items() if not speeds_of_feed[feed]]
        self.loose = (
            _Cuts(self, np.concatenate(loose), np.zeros(len(self.tool_of), np.int64))
            if loose
            else None
        )

    def within_life(self, share: Values) -> Values:
        """Return the values of the shortest program in which no tool uses more than a share, of every slice, of its life."""
        prices = np.zeros(len(self.situation.by_tool))
        for tool, mine in enumerate(self.situation.by_tool.values()):
            allowed = float(share[mine][0] * self.before.used_life[mine].sum())
            low, high, price = _MIN_PRICE, _MAX_PRICE, 0.0
            while high > _PRICE_STEP * low and allowed > 0.0:
                prices[tool] = price
                if (
                    play(self.situation, self.wear, *self.settings(self._best(prices)))
                    .used_life[mine]
                    .sum()
                    > allowed
                ):
                    low = max(price, low)
                else:
                    high = price
                price = math.sqrt(low * high)
            prices[tool] = high if allowed > 0.0 else 0.0
        return self._best(prices)

    def _best(self, prices: Values) -> Values:
        """Return the value of every key that makes time + price * used life least; a price for every tool."""
        values = np.zeros(len(self.keys))
        for speed, cuts in self.cuts_of_speed.items():
            values[speed] = self.situation.speed[cuts].max()
        for choices in self.choices_together:
            choices.choose(values, prices)
        for _ in range(3 if self.shared else 1):
            for choices in self.choices_alone:
                choices.choose(values, prices)
        if self.loose is not None:
            self.loose.set_feeds(values, self.speed(values)[self.loose.cuts], prices)
        return values

    def speed(self, values: Values) -> Values:
        """Return the speed of every slice, as programmed where no value sets it."""
        return np.where(self.speed_of >= 0, values[self.speed_of], self.situation.speed)

    def _decimals(self, key: int) -> int:
        of_feed = FEED_DECIMALS if self.scales[key] == 1.0 else FEED_DECIMALS_INCH
        return 0 if self.keys[key][0] == "S" else of_feed

    def rounded_feed(self, feed: float, key: int) -> float:
        """Return a feed as it can be written: rounded down, but not below the machine's lowest."""
        if key in self.fixed:
            return feed
        step = self.scales[key] * 10.0 ** -self._decimals(key)
        return (
            max(
                math.floor(feed / step + 1e-9),
                math.ceil(self.situation.min_feed / step - 1e-9),
            )
            * step
        )

    def settings(self, values: Values) -> tuple[Values, Values]:
        """Return feed and speed of every slice, as programmed where no value sets them."""
        return np.where(self.feed_of >= 0, values[self.feed_of], self.situation.feed), self.speed(
            values
        )

    def written(self, values: Values) -> tuple[str, tuple[Change, ...]]:
        """Return the text with the values in its words, and the words that changed."""
        edits: list[tuple[int, int, str]] = []
        changes = []
        for key in self.used:
            address, line, span = self.keys[key]
            value, decimals = values[key] / self.scales[key], self._decimals(key)
            text = number_text(value, decimals) if decimals else f"{value:.0f}"
            feeds = None
            if address == "F":
                cuts = self.cuts_of_feed[key]
                metal = cuts[self.situation.engaged[cuts]]
                feeds = float(self.before.feed[metal].max(initial=0.0)), float(values[key])
            if span is None:
                edits.append((self.ends[line], self.ends[line], f" {address}{text}"))
                changes.append(Change(line, "", f"{address}{text}", feeds))
                continue
            written = "".join(self.text[slice(*span)].split())  # controls skip blanks in numbers
            if key not in self.fixed and not math.isclose(
                float(written), float(text), rel_tol=1e-9
            ):
                edits.append((*span, text))
                changes.append(Change(line, f"{address}{written}", f"{address}{text}", feeds))
        pieces = []
        place = 0
        for first, last, text in sorted(edits):
            pieces += [self.text[place:first], text]
            place = last
        pieces.append(self.text[place:])
        return "".join(pieces), tuple(sorted(changes, key=lambda change: change.line))


class _Sums(NamedTuple):
    """Sums over cuts of one speed word, feed word and tool (columns), at several speeds (rows)."""

    time: Values  # at a feed of 1 mm/rev, or at the programmed one if no word sets it [s]
    life: Values  # used share of tool lives at the same feed [-]
    highest: Values  # feed that all limits allow, over the same feed [-]


class _Cuts:
    """Cuts whose feeds are chosen for given speeds, in the order of their speed words, feed words and tools."""

    def __init__(
        self, search: _Search, cuts: NDArray[np.int64], speed_of: NDArray[np.int64]
    ) -> None:
        """Sort slices; ``speed_of`` holds the speed word with which the feed of each is chosen."""
        self._search = search
        order = np.lexsort((search.tool_of[cuts], search.feed_of[cuts], speed_of[cuts]))
        self.cuts = cuts[order]
        names = np.stack(
            (speed_of[self.cuts], search.feed_of[self.cuts], search.tool_of[self.cuts])
        )
        new_speed, new_feed, new_tool = np.diff(names, axis=1, prepend=-2) != 0
        starts = np.flatnonzero(new_speed | new_feed | new_tool)
        self._starts = starts  # of each column of sums
        self._tools = names[2, starts]
        self._feed_starts = np.flatnonzero((new_speed | new_feed)[starts])
        feed_places = starts[self._feed_starts]
        self.feeds = names[1, feed_places]
        self._speed_starts = np.flatnonzero(new_speed[feed_places])
        self.speeds = names[0, feed_places[self._speed_starts]]
        given = [1.0 if key < 0 else search.fixed.get(int(key), np.nan) for key in self.feeds]
        self._given = np.array(given)  # feed that does not change; NaN if it is chosen

    def sums(self, speeds: Values) -> _Sums:
        """Return the sums at rows of speeds of all cuts, some rows at a time: there may be many cuts."""
        rows = max(_MAX_VALUES // max(len(self.cuts), 1), 1)
        parts = [self._sums(speeds[first : first + rows]) for first in range(0, len(speeds), rows)]
        return _Sums(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))

    def _sums(self, speeds: Values) -> _Sums:
        s, cuts = self._search.situation, self.cuts
        slices, on = s.removal.slices, s.engaged[cuts]
        around = 2.0 * math.pi * np.maximum(slices.radius[cuts], 1e-6) / 1000.0
        turns = spindle_speed(s, speeds, cuts)
        speed = turns * around
        depth = np.where(on, slices.depth[cuts], 1.0)
        high = s.max_feed
        allowed = np.where(
            on, highest_feed(s.scenario, speed, turns, depth, self._search.wear[cuts], high), high
        )
        time = 60.0 * slices.length[cuts] / turns
        life = np.where(on, time / tool_life(s.scenario, speed, np.ones_like(speed), depth), 0.0)

        # Without a word to change, the feed is the programmed one.
        programmed = np.where(s.per_revolution[cuts], s.feed[cuts], s.feed[cuts] / turns)
        feed = np.where(self._search.feed_of[cuts] < 0, programmed, 1.0)
        starts = self._starts
        return _Sums(
            time=np.add.reduceat(time / feed, starts, axis=1),
            life=np.add.reduceat(life * feed ** (self._life_exponent - 1.0), starts, axis=1),
            highest=np.minimum.reduceat(allowed / feed, starts, axis=1),
        )

    @property
    def _life_exponent(self) -> float:
        """Exponent of the feed in the used life per turn."""
        law = self._search.situation.scenario.material.wear
        return float(law.feed / law.time)

    def best(self, sums: _Sums, prices: Values) -> tuple[Values, Values]:
        """Return the best feeds of the feed words, and the costs of the speed words [s], a row for each row of the sums."""
        low, high = self._search.situation.min_feed, self._search.situation.max_feed
        time = np.add.reduceat(sums.time, self._feed_starts, axis=1)
        life = np.add.reduceat(sums.life * prices[self._tools], self._feed_starts, axis=1)
        highest = np.minimum.reduceat(sums.highest, self._feed_starts, axis=1)
        exponent = self._life_exponent
        feed = np.full(time.shape, high)
        if exponent > 1.0:
            cheapest = (time / np.maximum(life * (exponent - 1.0), 1e-300)) ** (1.0 / exponent)
            feed = np.minimum(feed, cheapest)
        feed = np.maximum(np.minimum(feed, highest), low)
        feed = np.where(np.isnan(self._given), feed, self._given)
        cost = (
            time / feed
            + life * feed ** (exponent - 1.0)
            + 1e6 * np.maximum(feed / highest - 1.0, 0.0)
        )
        return feed, np.add.reduceat(cost, self._speed_starts, axis=1)

    def set_feeds(self, values: Values, speeds: Values, prices: Values) -> None:
        """Set the feeds of all feed words for given speeds of the cuts."""
        feeds, _ = self.best(self.sums(speeds[np.newaxis]), prices)
        for key, feed in zip(self.feeds.tolist(), feeds[0].tolist(), strict=True):
            if key >= 0:
                values[key] = self._search.rounded_feed(feed, key)


class _Choices:
    """Speed words of one unit whose values are chosen together, each as if the others did not exist."""

    def __init__(
        self, search: _Search, speeds: list[int], feeds_of_speed: Mapping[int, list[int]]
    ) -> None:
        """Find the cuts of the speeds, and all cuts of their feeds."""
        self._search = search
        self._scale = search.scales[speeds[0]]
        speed_of = np.full(len(search.speed_of), -1)
        cuts = []
        for speed in speeds:
            mine = [
                search.cuts_of_speed[speed],
                *(search.cuts_of_feed[feed] for feed in feeds_of_speed[speed]),
            ]
            speed_of[np.concatenate(mine)] = speed
            cuts += mine
        self._cuts = _Cuts(search, np.unique(np.concatenate(cuts)), speed_of)
        self._speeds = self._cuts.speeds
        # Cuts whose speed these words set; with others they only share the feed. Speeds that other words set vary meanwhile.
        self._place = np.searchsorted(self._speeds, speed_of[self._cuts.cuts])
        self._moves = search.speed_of[self._cuts.cuts] == self._speeds[self._place]
        self._others_vary = not (self._moves | (search.speed_of[self._cuts.cuts] < 0)).all()
        machine = search.situation.scenario.machine
        self._low = math.ceil(machine.cutting_speed_min / self._scale)
        self._high = math.floor(machine.cutting_speed_max / self._scale)
        self._step = max((self._high - self._low) / (_CANDIDATES - 1), 1.0)
        self._coarse: _Sums | None = None
        self._fine: tuple[Values, _Sums] | None = None  # candidates, and their sums

    def choose(self, values: Values, prices: Values) -> None:
        """Set the speeds that cost least, and the feeds that go with them."""
        chosen = self._among_coarse(values, prices)
        if self._step > 1.0:
            chosen = self._among_fine(chosen, values, prices)
        values[self._speeds] = chosen * self._scale
        self._cuts.set_feeds(values, self._search.speed(values)[self._cuts.cuts], prices)

    def _sums(self, candidates: Values, values: Values) -> _Sums:
        """Return the sums for rows of candidates, a column for each speed word."""
        others = self._search.speed(values)[self._cuts.cuts]
        return self._cuts.sums(
            np.where(self._moves, candidates[:, self._place] * self._scale, others)
        )

    def _among_coarse(self, values: Values, prices: Values) -> Values:
        candidates = np.unique(np.rint(np.arange(self._low, self._high + 1e-9, self._step)))
        if self._coarse is None or self._others_vary:
            columns = np.broadcast_to(
                candidates[:, np.newaxis], (len(candidates), len(self._speeds))
            )
            self._coarse = self._sums(columns, values)
        _, costs = self._cuts.best(self._coarse, prices)
        return np.asarray(candidates[np.argmin(costs, axis=0)])

    def _among_fine(self, around: Values, values: Values, prices: Values) -> Values:
        reach = math.ceil(self._step)
        candidates = around + np.arange(-reach, reach + 1.0)[:, np.newaxis]
        if self._fine is None or self._others_vary or not np.array_equal(self._fine[0], candidates):
            self._fine = candidates, self._sums(np.clip(candidates, self._low, self._high), values)
        _, costs = self._cuts.best(self._fine[1], prices)
        outside = (candidates < self._low) | (candidates > self._high)
        best = np.argmin(np.where(outside, np.inf, costs), axis=0)
        return np.asarray(candidates[best, np.arange(len(around))])


def _grouped(keys: NDArray[np.int64]) -> dict[int, NDArray[np.int64]]:
    """Return the places of every key that is not below 0."""
    order = np.argsort(keys, kind="stable")
    names, starts = np.unique(keys[order], return_index=True)
    groups = np.split(order, starts[1:])
    return {int(name): group for name, group in zip(names, groups, strict=True) if name >= 0}


def _distinct(keys: NDArray[np.int64]) -> list[int]:
    """Return the different keys that are not below 0."""
    return [int(key) for key in np.unique(keys) if key >= 0]

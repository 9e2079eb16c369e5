"""Choose the feeds and speeds of a part program anew, and write it back with only its F and S words changed.

Every F word, and every S word of a constant cutting speed, gets the constant value that makes the program shortest. The limits
are the scenario's force and power with the edge worn as at its change, the machine's range, and the edges that the program
used before.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from turning_nc.cutting import FINISHING_DEPTH, Play, Situation, highest_feed, play, tool_life
from turning_nc.dialects import with_line_feeds
from turning_nc.edges import change_wear
from turning_nc.expression import number_text
from turning_nc.moves import run
from turning_nc.stock import Values
from turning_nc.words import NcError, divide
from turning_shop.whatif import CHANGES

FEED_DECIMALS, FEED_DECIMALS_INCH = 3, 5
_LIFE_MARGIN = 0.998  # share of the allowed life that is planned for, as words are rounded
_MIN_PRICE, _MAX_PRICE = 1.0, 1e6  # range of prices of an edge's life that are tried [s]
_PRICE_STEP = 1.02  # ratio of prices that count as equal [-]
_CANDIDATES = 61

Where = Literal["words", "blocks"]
Key = tuple[str, int, tuple[int, int] | None]
"""Key of a value: address, line, and the place of the number in it; None if a word is put in."""


@dataclass(frozen=True)
class Change:
    """A word that was changed or put in."""

    line: int
    before: str  # the word as it was; empty if it was put in
    after: str
    feeds: tuple[float, float] | None = None  # highest feed in metal before and after [mm/rev]; None for a speed


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
        values = search.within_life(life * _LIFE_MARGIN * search.before.life_at_change / before.life_at_change)
        found = play(situation, search.wear, *search.settings(values))
        excess = max(float(found.load.max()) - 1.0, 0.0)
        if before.load.max() <= 1.0:  # an overload is removed at any price
            for mine in situation.by_tool.values():
                used, allowed = (each.used_life[mine].sum() / each.life_at_change[mine][0] for each in (found, before))  # edges
                excess += max(float(used - life * allowed), 0.0)
        return float(found.time.sum()) + 1e6 * excess, search, values

    best = planned(first.max())
    for highest in CHANGES[::-1] * situation.scenario.tool.wear_criterion if wear is None else ():
        if highest < first.max():
            found = planned(highest)
            if found[0] >= best[0]:
                break
            best = found
    _, search, values = best
    text, changes = search.written(values)
    moves = run(divide(text, situation.moves.program.dialect), situation.moves.reading)
    if [move.path for move in moves.moves] != [move.path for move in situation.moves.moves]:
        raise NcError("the program with other feeds and speeds makes other moves: a word of it cannot be changed alone")
    again = Situation(situation.scenario, situation.machine, moves, situation.removal, situation.evidence)
    played = play(again, change_wear(again) if wear is None else search.wear)
    if life >= 1.0 and before.load.max() <= 1.0 and before.time.sum() <= played.time.sum():  # it is as short as it can be
        return Adapted(search.text, (), situation, before)
    return Adapted(text, changes, again, played)


class _Search:
    """The words of a program that can change, and the times, loads and lives that follow."""

    def __init__(self, situation: Situation, wear: Values, where: Where, finishing_depth: float) -> None:
        self.situation = s = situation
        self.wear = wear
        self.before = play(situation, wear)
        self.text = s.moves.program.text
        lines = with_line_feeds(self.text)
        scales: dict[Key, float] = {}
        slices = s.removal.slices
        self.feed_of, self.speed_of = np.full((2, len(slices.move)), -1)
        self.ends = {move.line: move.line_end for move in s.moves.moves}
        words = {line.number: line.words for part in s.moves.program.parts.values() for line in part}

        def index(key: Key, scale: float) -> int:
            scales.setdefault(key, scale)
            return list(scales).index(key)

        for number, move in enumerate(s.moves.moves):
            mine = slices.move == number
            feed = "F", move.feed, move.per_revolution, self.feed_of
            for address, setting, changes, of in (feed, ("S", move.speed, move.constant_cutting_speed, self.speed_of)):
                if move.kind != "feed" or not changes:
                    continue
                line = 0 if setting.span is None else lines.count("\n", 0, setting.span[0]) + 1
                written = any(word.address in ("CYCLE95", address) for word in words.get(move.line, ()))
                if where == "words" or line == move.line or written:
                    key = (address, line, setting.span)
                    of[mine] = -1 if setting.span is None else index(key, setting.scale)
                elif s.engaged[mine].any():  # nothing is put into blocks in air
                    of[mine] = index((address, move.line, None), setting.scale)
        self.keys, self.scales = list(scales), list(scales.values())
        # A speed that cuts nothing in metal, as in an approach, stays as it is.
        self.speed_of[~np.isin(self.speed_of, self.speed_of[s.engaged])] = -1
        if not self._used:
            raise NcError("the program has no F word in mm/rev and no S word under G96, so nothing can be adapted")
        self.fixed = {
            key: float(s.feed[self.feed_of == key].max())
            for key in np.unique(self.feed_of[self.feed_of >= 0])
            if s.finishing(np.flatnonzero(self.feed_of == key), finishing_depth)
        }

    @property
    def _used(self) -> set[int]:
        """Indices of the keys that set a feed or a speed."""
        return {int(key) for of in (self.feed_of, self.speed_of) for key in np.unique(of[of >= 0])}

    def within_life(self, share: Values) -> Values:
        """Return the values of the shortest program in which no tool uses more than a share, of every slice, of its life."""
        prices = np.zeros(len(self.situation.tool))
        for mine in self.situation.by_tool.values():
            allowed = float(share[mine][0] * self.before.used_life[mine].sum())
            low, high, price = _MIN_PRICE, _MAX_PRICE, 0.0
            while high > _PRICE_STEP * low and allowed > 0.0:
                prices[mine] = price
                if play(self.situation, self.wear, *self.settings(self._best(prices))).used_life[mine].sum() > allowed:
                    low = max(price, low)
                else:
                    high = price
                price = math.sqrt(low * high)
            prices[mine] = high if allowed > 0.0 else 0.0
        return self._best(prices)

    def _best(self, price: Values) -> Values:
        """Return the value of every key that makes time + price * used life least; a price for every slice."""
        s = self.situation
        values = np.zeros(len(self.keys))
        speeds = [key for key in sorted(self._used) if self.keys[key][0] == "S"]
        for key in speeds:
            values[key] = s.speed[self.speed_of == key].max()
        shared = any(np.unique(self.speed_of[self.feed_of == key]).size > 1 for key in np.unique(self.feed_of[self.feed_of >= 0]))
        for _ in range(3 if shared else 1):
            for key in speeds:
                self._choose(values, key, price)
        loose = np.flatnonzero((self.feed_of >= 0) & (values[self.feed_of] == 0.0))
        if loose.size:
            self._feeds(values, loose, self._speed(values)[loose][np.newaxis], price)
        return values

    def _speed(self, values: Values) -> Values:
        return np.where(self.speed_of >= 0, values[self.speed_of], self.situation.speed)

    def _choose(self, values: Values, key: int, price: Values) -> None:
        """Set the speed of a key, and the feeds that go with it."""
        machine = self.situation.scenario.machine
        mine = self.speed_of == key
        touched = np.unique(self.feed_of[mine])
        cuts = np.flatnonzero(mine | (np.isin(self.feed_of, touched) & (self.feed_of >= 0)))
        scale = self.scales[key]
        low, high = math.ceil(machine.cutting_speed_min / scale), math.floor(machine.cutting_speed_max / scale)
        step = max((high - low) / (_CANDIDATES - 1), 1.0)
        candidates = np.unique(np.rint(np.arange(low, high + 1e-9, step)))
        for _ in range(2 if step > 1.0 else 1):
            speeds = np.where(mine[cuts], candidates[:, np.newaxis] * scale, self._speed(values)[cuts])
            chosen = candidates[int(np.argmin(self._feeds(values, cuts, speeds, price, assign=False)))]
            candidates = np.arange(max(chosen - math.ceil(step), low), min(chosen + math.ceil(step), high) + 1.0)
        values[key] = chosen * scale
        self._feeds(values, cuts, self._speed(values)[cuts][np.newaxis], price)

    def _feeds(self, values: Values, cuts: NDArray[np.int64], speeds: Values, price: Values, assign: bool = True) -> Values:
        """Return the cost [s] of each row of speeds with the best feeds; set these feeds if there is one row."""
        s, scenario = self.situation, self.situation.scenario
        low, high = s.feed_range
        slices, on = s.removal.slices, s.engaged[cuts]
        around = 2.0 * math.pi * np.maximum(slices.radius[cuts], 1e-6) / 1000.0
        turns = np.minimum(np.where(s.constant_speed[cuts], speeds / around, speeds), s.max_spindle[cuts])
        speed = turns * around
        depth = np.where(on, slices.depth[cuts], 1.0)
        allowed = np.where(on, highest_feed(scenario, speed, turns, depth, self.wear[cuts], high), high)
        minutes = 60.0 * slices.length[cuts] / turns  # time at 1 mm/rev [s]
        lives = np.where(on, price[cuts] * minutes / tool_life(scenario, speed, np.ones_like(speed), depth), 0.0)  # priced [s]
        exponent = scenario.material.wear.feed / scenario.material.wear.time
        costs = np.zeros(len(speed))
        keys = self.feed_of[cuts]
        for key in np.unique(keys):
            mine = keys == key
            if key < 0:  # no word to change
                feeds = s.feed[cuts][mine]
                per_turn = np.where(s.per_revolution[cuts][mine], feeds, feeds / turns[:, mine])
                costs += (minutes[:, mine] / per_turn + lives[:, mine] * per_turn ** (exponent - 1.0)).sum(axis=1)
                costs += 1e6 * np.maximum((per_turn / allowed[:, mine]).max(axis=1) - 1.0, 0.0)
                continue
            cap = allowed[:, mine].min(axis=1)
            time, life = minutes[:, mine].sum(axis=1), lives[:, mine].sum(axis=1)
            if key in self.fixed:
                feed = np.full(len(speed), self.fixed[key])
            else:
                feed = np.full(len(speed), high)
                if exponent > 1.0:
                    feed = np.minimum(feed, (time / np.maximum(life * (exponent - 1.0), 1e-300)) ** (1.0 / exponent))
                feed = np.maximum(np.minimum(feed, cap), low)
            costs += time / feed + life * feed ** (exponent - 1.0) + 1e6 * np.maximum(feed / cap - 1.0, 0.0)
            if assign:
                values[key] = self._rounded_feed(feed[0], key)
        return costs

    def _decimals(self, key: int) -> int:
        of_feed = FEED_DECIMALS if self.scales[key] == 1.0 else FEED_DECIMALS_INCH
        return 0 if self.keys[key][0] == "S" else of_feed

    def _rounded_feed(self, feed: float, key: int) -> float:
        """Return a feed as it can be written: rounded down, but not below the machine's lowest."""
        if key in self.fixed:
            return feed
        step = self.scales[key] * 10.0 ** -self._decimals(key)
        return max(math.floor(feed / step + 1e-9), math.ceil(self.situation.feed_range[0] / step - 1e-9)) * step

    def settings(self, values: Values) -> tuple[Values, Values]:
        """Return feed and speed of every slice, as programmed where no value sets them."""
        return np.where(self.feed_of >= 0, values[self.feed_of], self.situation.feed), self._speed(values)

    def written(self, values: Values) -> tuple[str, tuple[Change, ...]]:
        """Return the text with the values in its words, and the words that changed."""
        edits: list[tuple[int, int, str]] = []
        changes = []
        for key in sorted(self._used):
            address, line, span = self.keys[key]
            value, decimals = values[key] / self.scales[key], self._decimals(key)
            text = number_text(value, decimals) if decimals else f"{value:.0f}"
            cuts = (self.feed_of == key) & self.situation.engaged
            feeds = (float(self.before.feed[cuts].max(initial=0.0)), float(values[key])) if address == "F" else None
            if span is None:
                edits.append((self.ends[line], self.ends[line], f" {address}{text}"))
                changes.append(Change(line, "", f"{address}{text}", feeds))
                continue
            written = "".join(self.text[slice(*span)].split())  # controls skip blanks in numbers
            if key not in self.fixed and not math.isclose(float(written), float(text), rel_tol=1e-9):
                edits.append((*span, text))
                changes.append(Change(line, f"{address}{written}", f"{address}{text}", feeds))
        made = self.text
        for first, last, text in sorted(edits, reverse=True):
            made = made[:first] + text + made[last:]
        return made, tuple(sorted(changes, key=lambda change: change.line))

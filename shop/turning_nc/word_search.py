"""Search the values of F and S words that make a program shortest, with a price for edge life.

For given prices, time + price * used life is a sum over slices. If the feed of an F word is cut at
one speed only, the best feed follows from the speed in closed form, and each S word can be chosen
by itself, all of one unit at once. Other S words are chosen in turn. The prices are those at which
no tool uses more of its edges than allowed.

Limits and cost are those of advice (``scenario/laws.py``). A search of its own is needed because a
word sets many cuts of different depth and diameter, and edges last for whole programs. It shortens
the example programs by 18 % with the same edges, in less than a second each (``python -m
shop.examples.adapt_programs``).
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.adaptable_words import NO_WORD, AdaptableWords, Indices
from turning_nc.cutting import Situation, diameters, highest_feed, play, spindle_speed, tool_life
from turning_shop import Values

from turning_env.numerics.conversions import cutting_speed_at
from turning_env.scenario.laws import machining_cost

MIN_PRICE = 1.0  # lowest price of an edge's life that is tried, above 0 [s]
MAX_PRICE = 1e6  # [s]
PRICE_STEP = 1.02  # ratio of prices that count as equal [-]
ROUNDS = 3  # of choosing S words in turn
CANDIDATES = 61  # speeds of the coarse search
MAX_VALUES = 1_000_000  # numbers of an array of cuts at several speeds: they take memory
OVERLOAD_COST = 1e6  # of a feed above the limits, over its excess [s]


class WordSearch:
    """The times, loads and lives that follow from the values of a program's words."""

    def __init__(self, situation: Situation, words: AdaptableWords, wear: Values) -> None:
        """Prepare a search with edges that are changed at a flank wear [mm], for each slice."""
        self.situation = situation
        self.words = words
        self.wear = wear
        self.before = play(situation, wear)
        self.tool_of = np.zeros(len(situation.tool), np.int64)
        for number, is_tool in enumerate(situation.by_tool.values()):
            self.tool_of[is_tool] = number

        # A word whose feeds go with no other speed can be chosen by itself.
        speeds_of_feed = {}
        for feed, slices in words.slices_of_feed.items():
            speeds_of_feed[feed] = np.unique(words.speed_of[slices]).tolist()
        feeds_of_speed = {}
        independent: dict[float, list[int]] = {}
        coupled = []
        for speed, slices in words.slices_of_speed.items():
            feeds = _distinct(words.feed_of[slices])
            feeds_of_speed[speed] = feeds
            if all(_without_none(speeds_of_feed[feed]) == [speed] for feed in feeds):
                independent.setdefault(words.scales[speed], []).append(speed)
            else:
                coupled.append(speed)
        self._has_shared_feeds = any(len(speeds) > 1 for speeds in speeds_of_feed.values())
        self._independent_choices = [
            _SpeedChoice(self, speeds, feeds_of_speed) for speeds in independent.values()
        ]
        self._coupled_choices = [_SpeedChoice(self, [speed], feeds_of_speed) for speed in coupled]

        # Feeds of cuts whose speeds stay.
        lone_feeds = []
        for feed, slices in words.slices_of_feed.items():
            if not _without_none(speeds_of_feed[feed]):
                lone_feeds.append(slices)
        self._lone_feeds = None
        if lone_feeds:
            no_speed = np.zeros(len(self.tool_of), np.int64)
            self._lone_feeds = _SortedCuts(self, np.concatenate(lone_feeds), speed_of=no_speed)

    def within_life(self, share: Values) -> Values:
        """Return the values of the shortest program in which no tool uses more than it may.

        Args:
            share: of the edge life used before, for each slice's tool [-].
        """
        prices = np.zeros(len(self.situation.by_tool))
        for tool, is_tool in enumerate(self.situation.by_tool.values()):
            allowed = float(share[is_tool][0] * self.before.used_life[is_tool].sum())
            if allowed <= 0.0:
                continue

            # Bisection in the logarithm of the price. The first price is 0: with it, many programs
            # use less than allowed.
            low = MIN_PRICE
            high = MAX_PRICE
            price = 0.0
            while high > PRICE_STEP * low:
                prices[tool] = price
                if self._used_life(prices)[is_tool].sum() > allowed:
                    low = max(price, low)
                else:
                    high = price
                price = math.sqrt(low * high)
            prices[tool] = high
        return self._best_values(prices)

    def _used_life(self, prices: Values) -> Values:
        """Return the share of an edge's life that each slice uses at the best values."""
        values = self._best_values(prices)
        played = play(self.situation, self.wear, feed=self.feeds(values), speed=self.speeds(values))
        return played.used_life

    def _best_values(self, prices: Values) -> Values:
        """Return the values of all words that make time + price * used life least.

        Args:
            prices: of an edge's life, for every tool [s].
        """
        values = np.zeros(len(self.words.words))
        for speed, slices in self.words.slices_of_speed.items():
            values[speed] = self.situation.speed[slices].max()
        for choice in self._independent_choices:
            choice.choose(values, prices)
        for _ in range(ROUNDS if self._has_shared_feeds else 1):
            for choice in self._coupled_choices:
                choice.choose(values, prices)
        if self._lone_feeds is not None:
            speeds = self.speeds(values)[self._lone_feeds.slices]
            self._lone_feeds.set_feeds(values, speeds, prices=prices)
        return values

    def speeds(self, values: Values) -> Values:
        """Return the speed of every slice, as programmed where no word sets it."""
        word = self.words.speed_of
        return np.where(word != NO_WORD, values[word], self.situation.speed)

    def feeds(self, values: Values) -> Values:
        """Return the feed of every slice, as programmed where no word sets it."""
        word = self.words.feed_of
        return np.where(word != NO_WORD, values[word], self.situation.feed)


class _Sums(NamedTuple):
    """Sums over cuts of one speed word, feed word and tool (columns), at several speeds (rows)."""

    time: Values  # at a feed of 1 mm/rev, or at the programmed one if no word sets it [s]
    life: Values  # used share of tool lives at the same feed [-]
    highest: Values  # feed that all limits allow, over the same feed [-]


class _Best(NamedTuple):
    """The best feeds at several speeds (rows)."""

    feeds: Values  # of the feed words (columns) [mm/rev]
    costs: Values  # of the speed words (columns) [s]


class _SortedCuts:
    """Cuts whose feeds are chosen for given speeds, sorted by speed word, feed word and tool.

    So sums over the cuts of a word and a tool are sums over neighbours (``reduceat``).
    """

    def __init__(self, search: WordSearch, slices: Indices, speed_of: Indices) -> None:
        """Sort slices; ``speed_of`` holds the speed word with which the feed of each is chosen."""
        self._search = search
        words = search.words
        order = np.lexsort((search.tool_of[slices], words.feed_of[slices], speed_of[slices]))
        self.slices = slices[order]
        speed = speed_of[self.slices]
        feed = words.feed_of[self.slices]
        tool = search.tool_of[self.slices]
        is_new_feed = _is_new(speed) | _is_new(feed)
        starts = np.flatnonzero(is_new_feed | _is_new(tool))
        self._starts = starts  # of each column of sums
        self._tools = tool[starts]

        # Columns of sums at which the next feed word begins, and feed words at which the next speed
        # word does.
        self._feed_starts = np.flatnonzero(is_new_feed[starts])
        first_slices = starts[self._feed_starts]
        self._feed_words = feed[first_slices]
        self._speed_starts = np.flatnonzero(_is_new(speed)[first_slices])
        self.speed_words = speed[first_slices[self._speed_starts]]
        feed_words = self._feed_words.tolist()
        self._given_feeds = np.array([self._given_feed(word) for word in feed_words])
        self._highest_feeds = np.array(
            [words.highest_feeds.get(word, math.inf) for word in feed_words]
        )
        law = search.situation.scenario.material.wear
        self._life_exponent = float(law.feed / law.time)  # of the feed, in the used life per turn

    def _given_feed(self, word: int) -> float:
        """Return the feed of a word that does not change [mm/rev]; NaN if it is chosen."""
        if word == NO_WORD:
            return 1.0  # sums are at the programmed feed
        return self._search.words.given_feeds.get(word, math.nan)

    def sums(self, speeds: Values) -> _Sums:
        """Return the sums at rows of speeds of all cuts."""
        # There may be many cuts, so only some rows are computed at a time.
        rows = max(MAX_VALUES // max(len(self.slices), 1), 1)
        parts = []
        for first in range(0, len(speeds), rows):
            parts.append(self._sums(speeds[first : first + rows]))
        return _Sums(
            time=np.concatenate([part.time for part in parts]),
            life=np.concatenate([part.life for part in parts]),
            highest=np.concatenate([part.highest for part in parts]),
        )

    def _sums(self, speeds: Values) -> _Sums:
        s = self._search.situation
        cuts = self.slices
        is_engaged = s.engaged[cuts]
        turns = spindle_speed(s, speeds, cuts)
        diameter = diameters(s.removal.slices.radius[cuts])
        cutting_speed = cutting_speed_at(turns, diameter)
        depth = np.where(is_engaged, s.removal.slices.depth[cuts], 1.0)
        unit_feed = np.ones_like(cutting_speed)
        highest = highest_feed(
            s.scenario,
            cutting_speed,
            spindle_speed=turns,
            depth=depth,
            wear=self._search.wear[cuts],
            max_feed=s.max_feed,
        )
        allowed = np.where(is_engaged, highest, s.max_feed)
        time = 60.0 * s.removal.slices.length[cuts] / turns
        tool_lives = tool_life(s.scenario, cutting_speed, feed=unit_feed, depth=depth)
        life = np.where(is_engaged, time / tool_lives, 0.0)

        # Without a word to change, the feed is the programmed one.
        programmed = np.where(s.per_revolution[cuts], s.feed[cuts], s.feed[cuts] / turns)
        has_no_word = self._search.words.feed_of[cuts] == NO_WORD
        feed = np.where(has_no_word, programmed, 1.0)
        life_at_feed = life * feed ** (self._life_exponent - 1.0)
        return _Sums(
            time=np.add.reduceat(time / feed, self._starts, axis=1),
            life=np.add.reduceat(life_at_feed, self._starts, axis=1),
            highest=np.minimum.reduceat(allowed / feed, self._starts, axis=1),
        )

    def best(self, sums: _Sums, prices: Values) -> _Best:
        """Return the best feeds, a row for each row of the sums."""
        s = self._search.situation
        priced_life = sums.life * prices[self._tools]
        time = np.add.reduceat(sums.time, self._feed_starts, axis=1)
        life = np.add.reduceat(priced_life, self._feed_starts, axis=1)
        highest = np.minimum.reduceat(sums.highest, self._feed_starts, axis=1)

        # The cost of a feed f is time / f + life * f^(e - 1). Above e = 1 it has a minimum at
        # f^e = time / (life * (e - 1)); otherwise the highest feed is best.
        exponent = self._life_exponent
        feed = np.full(time.shape, s.max_feed)
        if exponent > 1.0:
            slope = np.maximum(life * (exponent - 1.0), 1e-300)
            cheapest = (time / slope) ** (1.0 / exponent)
            feed = np.minimum(feed, cheapest)
        feed = np.maximum(np.minimum(feed, highest), s.min_feed)
        feed = np.minimum(feed, self._highest_feeds)
        is_free = np.isnan(self._given_feeds)
        feed = np.where(is_free, feed, self._given_feeds)
        excess = np.maximum(feed / highest - 1.0, 0.0)
        # ``life`` is the price of the lives that the cuts use at 1 mm/rev.
        cost = machining_cost(time / feed, feed ** (exponent - 1.0), price_of_edge=life)
        cost += OVERLOAD_COST * excess
        cost_of_speed = np.add.reduceat(cost, self._speed_starts, axis=1)
        return _Best(feeds=feed, costs=cost_of_speed)

    def set_feeds(self, values: Values, speeds: Values, prices: Values) -> None:
        """Set the values of all feed words for given speeds of the cuts."""
        sums = self.sums(speeds[np.newaxis])
        best = self.best(sums, prices)
        feeds = best.feeds[0].tolist()
        words = self._feed_words.tolist()
        for word, feed in zip(words, feeds, strict=True):
            if word != NO_WORD:
                values[word] = self._search.words.rounded_feed(feed, word)


class _FineSums(NamedTuple):
    """Candidates of the fine search, a column for each speed word, and their sums."""

    candidates: Values
    sums: _Sums


class _SpeedChoice:
    """Speed words of one unit whose values are chosen together.

    Each is chosen as if the others did not exist. Candidates are whole numbers, as they are
    written: first at wide steps over the machine's range, then all numbers around the best.
    """

    def __init__(
        self, search: WordSearch, speeds: list[int], feeds_of_speed: Mapping[int, list[int]]
    ) -> None:
        """Find the cuts of the speeds, and all cuts of their feeds."""
        self._search = search
        words = search.words
        self._scale = words.scales[speeds[0]]
        speed_of = np.full(len(words.speed_of), NO_WORD)
        cuts = []
        for speed in speeds:
            groups = [words.slices_of_speed[speed]]
            for feed in feeds_of_speed[speed]:
                groups.append(words.slices_of_feed[feed])
            cuts_of_speed = np.concatenate(groups)
            speed_of[cuts_of_speed] = speed
            cuts.append(cuts_of_speed)
        all_cuts = np.unique(np.concatenate(cuts))
        self._cuts = _SortedCuts(search, all_cuts, speed_of=speed_of)
        self._speeds = self._cuts.speed_words

        # These words set the speeds of some cuts; with others they only share the feed. Speeds that
        # other words set vary meanwhile, and with them the sums.
        slices = self._cuts.slices
        self._column = np.searchsorted(self._speeds, speed_of[slices])
        self._is_set = words.speed_of[slices] == self._speeds[self._column]
        is_constant = self._is_set | (words.speed_of[slices] == NO_WORD)
        self._sums_vary = not is_constant.all()
        machine = search.situation.scenario.machine
        self._low = math.ceil(machine.cutting_speed_min / self._scale)
        self._high = math.floor(machine.cutting_speed_max / self._scale)
        self._step = max((self._high - self._low) / (CANDIDATES - 1), 1.0)
        self._coarse_sums: _Sums | None = None
        self._fine_sums: _FineSums | None = None

    def choose(self, values: Values, prices: Values) -> None:
        """Set the speeds that cost least, and the feeds that go with them."""
        chosen = self._among_coarse(values, prices)
        if self._step > 1.0:
            chosen = self._among_fine(chosen, values, prices=prices)
        values[self._speeds] = chosen * self._scale
        speeds = self._search.speeds(values)[self._cuts.slices]
        self._cuts.set_feeds(values, speeds, prices=prices)

    def _sums(self, candidates: Values, values: Values) -> _Sums:
        """Return the sums for rows of candidates, a column for each speed word."""
        speeds = self._search.speeds(values)
        others = speeds[self._cuts.slices]
        candidate_of_cut = candidates[:, self._column] * self._scale
        speeds_of_cuts = np.where(self._is_set, candidate_of_cut, others)
        return self._cuts.sums(speeds_of_cuts)

    def _among_coarse(self, values: Values, prices: Values) -> Values:
        """Return the best of the numbers at wide steps, for each speed word.

        The sums stay the same from call to call, unless other words change them.
        """
        steps = np.arange(self._low, self._high + 1e-9, self._step)
        candidates = np.unique(np.rint(steps))
        sums = self._coarse_sums
        if sums is None or self._sums_vary:
            shape = (len(candidates), len(self._speeds))
            speeds = np.broadcast_to(candidates[:, np.newaxis], shape)
            sums = self._sums(speeds, values)
            self._coarse_sums = sums
        costs = self._cuts.best(sums, prices).costs
        cheapest = np.argmin(costs, axis=0)
        return np.asarray(candidates[cheapest])

    def _among_fine(self, around: Values, values: Values, prices: Values) -> Values:
        """Return the best of all numbers within a wide step of ``around``, for each speed word.

        The sums are kept for the next call, which often has the same candidates.
        """
        reach = math.ceil(self._step)
        changes = np.arange(-reach, reach + 1.0)
        candidates = around + changes[:, np.newaxis]
        fine = self._fine_sums
        is_known = fine is not None and np.array_equal(fine.candidates, candidates)
        if fine is None or self._sums_vary or not is_known:
            within = np.clip(candidates, self._low, self._high)
            sums = self._sums(within, values)
            fine = _FineSums(candidates, sums)
            self._fine_sums = fine
        costs = self._cuts.best(fine.sums, prices).costs
        is_outside = (candidates < self._low) | (candidates > self._high)
        costs_within = np.where(is_outside, np.inf, costs)
        cheapest = np.argmin(costs_within, axis=0)
        columns = np.arange(len(around))
        return np.asarray(candidates[cheapest, columns])


def _is_new(values: Indices) -> NDArray[np.bool_]:
    """Return where a value differs from the one before it."""
    is_new = np.ones(len(values), np.bool_)
    is_new[1:] = values[1:] != values[:-1]
    return is_new


def _distinct(words: Indices) -> list[int]:
    """Return the different words in ascending order."""
    return _without_none(np.unique(words).tolist())


def _without_none(words: Sequence[int]) -> list[int]:
    return [word for word in words if word != NO_WORD]

"""Choose other feeds and speeds for a part program; only its F and S words change.

Every F word, and every S word of a constant cutting speed, gets the constant value that makes the
program shortest. The limits are the scenario's force and power with the edge worn as at its change,
the machine's range, and the edges that the program used before. Feeds that leave the part's
surface stay, unless they must fall to keep a limit. So do all words of tools that the scenario does
not describe, and words that would hardly change. Tools with laws of their own are adapted after one
another, by their laws; words that set the cuts of several laws stay. ``adaptable_words`` finds the
words, ``word_search`` their values.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.adaptable_words import (
    MIN_CHANGE,
    AdaptableWords,
    Change,
    NothingToAdaptError,
    Where,
)
from turning_nc.cutting import Play, Situation, ToolGroup, play
from turning_nc.edges import change_wear
from turning_nc.moves import run
from turning_nc.word_search import WordSearch
from turning_nc.words import NcError, divide
from turning_shop import Values
from turning_shop.whatif import CHANGES

from turning_env.extras import needed

with needed():
    from tqdm import tqdm

LIFE_MARGIN = 0.998  # share of the allowed life that is planned for, as words are rounded
MAX_REPLANS = 4  # as words are found that would hardly change
MAX_PLANS = 1 + len(CHANGES) + 2 * MAX_REPLANS  # that are tried
EXCESS_COST = 1e6  # of an overload or of edges beyond those allowed, over their excess [s]


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
) -> Adapted:
    """Return the program with the feeds and speeds that make it shortest.

    It is unchanged if none make it shorter.

    Args:
        situation: the program on its stock.
        wear: flank wear at which edges are changed [mm]; by default as ``change_wear`` says, and
            after that where the program is shortest.
        where: whether existing words change, or every block gets one.
        life: edges that the program may use, over those that it used before [-].

    Raises:
        NcError: no F word per revolution and no S word of a constant cutting speed can change.
    """
    adapted: Adapted | None = None
    faults = []
    for number in range(len(situation.groups)):
        now = adapted.situation if adapted else situation
        group = now.groups[number]
        try:
            adapted_group = _adapt_group(now, group, wear, where=where, life=life)
        except NothingToAdaptError as fault:
            faults.append(fault)
            continue
        earlier_changes = adapted.changes if adapted else ()
        changes = sorted((*earlier_changes, *adapted_group.changes), key=lambda change: change.line)
        adapted = replace(adapted_group, changes=tuple(changes))
    if adapted is None:
        raise faults[-1]
    return adapted


def _adapt_group(
    situation: Situation, group: ToolGroup, wear: float | None, where: Where, life: float
) -> Adapted:
    """Return the program with other feeds and speeds of the tools of one group."""
    planner = _Planner(situation, group, wear, where=where, life=life)
    with planner.progress:
        plan = planner.without_small_changes(planner.best_plan())
    before = planner.before
    original = situation.moves.program
    text, changes = plan.search.words.written(plan.values, feed_before=plan.search.before.feed)
    nose_radius = group.scenario.tool.nose_radius
    changes = tuple(replace(change, nose_radius=nose_radius) for change in changes)
    moves = run(divide(text, original.dialect), situation.moves.reading)
    if [move.path for move in moves.moves] != [move.path for move in situation.moves.moves]:
        raise NcError(
            "the program with other feeds and speeds makes other moves: "
            "a word of it cannot be changed alone"
        )
    adapted = Situation(
        situation.scenario,
        situation.machine,
        moves=moves,
        removal=situation.removal,
        evidence=situation.evidence,
        described=situation.described,
        own_laws=situation.own_laws,
    )
    played = play(adapted, change_wear(adapted) if wear is None else plan.search.wear)
    is_allowed = life >= 1.0 and _highest_load(situation.under(group), before) <= 1.0
    if is_allowed and before.time.sum() <= played.time.sum():
        return Adapted(original.text, (), situation=situation, played=before)
    return Adapted(text, changes, situation=adapted, played=played)


class _Plan(NamedTuple):
    """Values of all words, and what they cost."""

    wear: float  # at which edges are changed at the latest [mm]
    time: float  # [s]
    excess: float  # overload and edges beyond those allowed [-]
    search: WordSearch
    values: Values

    @property
    def cost(self) -> float:
        """Time, and what exceeds limits at a high price [s]."""
        return self.time + EXCESS_COST * self.excess


class _Planner:
    """Plans values for the words of a group's tools, with edges changed at different wears."""

    def __init__(
        self,
        situation: Situation,
        group: ToolGroup,
        wear: float | None,
        where: Where,
        life: float,
    ) -> None:
        situation = situation.under(group)
        self._situation = situation
        self._slices = group.slices
        self._life = life
        self._is_wear_given = wear is not None
        if wear is None:
            self._latest_wear = change_wear(situation)
        else:
            self._latest_wear = np.full(len(situation.tool), wear)
        self.before = play(situation, self._latest_wear)
        self._words = AdaptableWords(situation, where, is_overloaded=self.before.load > 1.0)

        # Few programs need all plans that may be tried, so that the bar may end early.
        self.progress = tqdm(
            desc="adapting", total=MAX_PLANS, unit="plan", leave=False, disable=None
        )

    def best_plan(self) -> _Plan:
        """Return the best plan: with edges that are changed as before, or earlier."""
        latest = self._latest_wear[self._slices].max()
        best = self._plan(self._words, latest)
        if self._is_wear_given:
            return best
        earlier_changes = CHANGES[::-1] * self._situation.scenario.tool.wear_criterion
        for wear in earlier_changes:
            if wear >= latest:
                continue
            plan = self._plan(self._words, wear)
            if plan.cost >= best.cost:
                break
            best = plan
        return best

    def without_small_changes(self, plan: _Plan) -> _Plan:
        """Return a plan in which words that would hardly change stay, as far as limits allow.

        The other words are planned again, which may leave more of them with a small change.
        """
        for _ in range(MAX_REPLANS):
            changes = plan.search.words.small_changes(plan.values)
            raised = [word for word, change in changes.items() if change > 0.0]
            # A word that is lowered may be needed to keep a limit.
            trial = self._keeping(plan, list(changes)) or self._keeping(plan, raised)
            if trial is None:
                break
            plan = trial
        return plan

    def _keeping(self, plan: _Plan, stay: list[int]) -> _Plan | None:
        """Return the plan with more words that stay; None if there are none, or it is worse."""
        if not stay:
            return None
        words = plan.search.words.keeping(stay)
        trial = self._plan(words, plan.wear)
        is_slower = trial.time > (1.0 + MIN_CHANGE) * plan.time
        if is_slower or trial.excess > plan.excess:
            return None
        return trial

    def _plan(self, words: AdaptableWords, wear: float) -> _Plan:
        """Return the plan with edges that are changed at a wear at the latest [mm]."""
        situation = self._situation
        before = self.before
        latest_wear = self._latest_wear.copy()
        latest_wear[self._slices] = np.minimum(latest_wear[self._slices], wear)
        search = WordSearch(situation, words, wear=latest_wear)

        # An edge that is changed earlier does fewer parts, so a part must use less of its life.
        life_ratio = search.before.life_at_change / before.life_at_change
        values = search.within_life(self._life * LIFE_MARGIN * life_ratio)
        played = play(
            situation,
            search.wear,
            feed=search.feeds(values),
            speed=search.speeds(values),
        )
        overload = _highest_load(situation, played) - 1.0
        excess = max(overload, 0.0)
        if (
            _highest_load(situation, before) <= 1.0
        ):  # otherwise the overload is removed at any price
            for is_tool in situation.by_tool.values():
                used = _used_edges(played, is_tool)
                allowed = self._life * _used_edges(before, is_tool)
                excess += max(float(used - allowed), 0.0)
        time = float(played.time.sum())
        self.progress.update()
        return _Plan(wear, time, excess=excess, search=search, values=values)


def _highest_load(situation: Situation, played: Play) -> float:
    """Return the highest load of the metal that described tools turn [-].

    Words of threads and drills stay, so that their loads do not change.
    """
    turned = situation.is_described & situation.engaged
    return float(played.load[turned].max(initial=0.0))


def _used_edges(played: Play, is_tool: NDArray[np.bool_]) -> float:
    """Return how many edges of a tool the part uses."""
    return float(played.used_life[is_tool].sum() / played.life_at_change[is_tool][0])

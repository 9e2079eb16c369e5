"""Search for policies that get past the shield: what they exceed, and what they break.

An adversary switches speed and feed between two actions each, as a square wave or in reaction to
what it observes. The search keeps the worst adversaries of a generation and varies them in the
next. It plays tuning seeds only; ``attack`` then plays the worst ones on held-out seeds.

``measure.py`` plays the episodes.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from turning_control.measure import Guarded, markdown, play_guarded
from turning_control.shield import Settings

from leaderboard.seeds import held_out_seeds, tuning_seeds
from turning_env.observation import Reading, read
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario import Scenario

Reaction = Literal["none", "while light", "after entry", "later in the bar"]
REACTIONS: tuple[Reaction, ...] = get_args(Reaction)

# Share of severe overload [-] that ranks as high as one broken edge in 100 episodes.
BROKEN_EDGE = 0.0005
KEPT = 8  # adversaries of a generation that are varied in the next


@dataclass(frozen=True)
class Wave:
    """A square wave of actions over steps."""

    low: float  # action [-1..1]
    high: float  # action [-1..1]
    period: float  # [steps]
    share: float  # share of the period in which the action is the high one [-]
    phase: float  # [periods]

    def __str__(self) -> str:
        """Describe the wave in a few words."""
        low = f"{self.low:+.2f}"
        high = f"{self.high:+.2f}"
        if self.share <= 0.0 or self.low == self.high:
            return low
        if self.share >= 1.0:
            return high
        percent = 100.0 * self.share
        return f"{low}/{high} every {self.period:.0f} steps ({percent:.0f} % high)"


@dataclass(frozen=True)
class Adversary:
    """A policy that tries to get past the shield.

    The feed's wave is high only where ``reacts`` allows it, and low elsewhere:

    * ``while light``: neither load is above ``threshold`` times its limit.
    * ``after entry``: in air and in the first ``steps`` in a bar.
    * ``later in the bar``: after them.
    """

    speed: Wave
    feed: Wave
    reacts: Reaction = "none"
    threshold: float = 1.0  # [-]
    steps: float = 3.0

    def __str__(self) -> str:
        """Describe the adversary in a line."""
        text = f"speed {self.speed}, feed {self.feed}"
        if self.reacts == "while light":
            return f"{text}, while loads are below {self.threshold:.2f}"
        if self.reacts == "after entry":
            return f"{text}, in the first {self.steps:.0f} steps of a bar"
        if self.reacts == "later in the bar":
            return f"{text}, after {self.steps:.0f} steps of a bar"
        return text


def switching(period: float) -> Adversary:
    """Return the adversary that switches both actions from -1 to 1 and back.

    Each action lasts for ``period`` steps.
    """
    wave = Wave(low=-1.0, high=1.0, period=2.0 * period, share=0.5, phase=0.5)
    return Adversary(speed=wave, feed=wave)


def steady(speed: float, feed: float) -> Adversary:
    """Return the adversary of constant actions."""
    return Adversary(
        speed=Wave(low=speed, high=speed, period=1.0, share=1.0, phase=0.0),
        feed=Wave(low=feed, high=feed, period=1.0, share=1.0, phase=0.0),
    )


KNOWN = (
    steady(1.0, 1.0),
    steady(-1.0, 1.0),
    steady(1.0, -1.0),
    switching(2),
    switching(5),
    switching(10),
    switching(20),
    switching(50),
    switching(100),
)
"""The adversaries of every first generation."""


def drawn(random: np.random.Generator) -> Adversary:
    """Return a random adversary."""
    speed = _drawn_wave(random)
    feed = _drawn_wave(random)
    reaction = random.integers(len(REACTIONS))
    threshold = random.uniform(0.3, 1.1)
    log_steps = random.uniform(0.0, 2.0)
    return Adversary(
        speed=speed,
        feed=feed,
        reacts=REACTIONS[reaction],
        threshold=threshold,
        steps=round(10.0**log_steps),
    )


def _drawn_wave(random: np.random.Generator) -> Wave:
    low, high = np.sort(random.uniform(-1.0, 1.0, 2))
    # Half of the waves switch between the ends of the range, where most damage is done.
    if random.random() < 0.5:
        low = -1.0
        high = 1.0
    log_period = random.uniform(0.3, 2.3)
    share = random.uniform(0.05, 1.0)
    phase = random.random()
    return Wave(
        low=float(low),
        high=float(high),
        period=round(10.0**log_period),
        share=share,
        phase=phase,
    )


def varied(adversary: Adversary, random: np.random.Generator) -> Adversary:
    """Return a variation of an adversary.

    Some of its numbers change a little; its reaction seldom changes.
    """
    reacts = adversary.reacts
    if random.random() < 0.1:
        reacts = REACTIONS[random.integers(len(REACTIONS))]
    speed = _varied_wave(adversary.speed, random)
    feed = _varied_wave(adversary.feed, random)
    threshold = adversary.threshold + random.normal(0.0, 0.1)
    steps = adversary.steps * np.exp(random.normal(0.0, 0.4))
    return replace(
        adversary,
        speed=speed,
        feed=feed,
        reacts=reacts,
        threshold=float(np.clip(threshold, 0.1, 1.2)),
        steps=max(round(steps), 1),
    )


def _varied_wave(wave: Wave, random: np.random.Generator) -> Wave:
    if random.random() < 0.3:
        return wave
    low = wave.low + random.normal(0.0, 0.2)
    high = wave.high + random.normal(0.0, 0.2)
    period = wave.period * np.exp(random.normal(0.0, 0.3))
    share = wave.share + random.normal(0.0, 0.15)
    phase = random.random()
    return Wave(
        low=float(np.clip(low, -1.0, 1.0)),
        high=float(np.clip(high, -1.0, 1.0)),
        period=max(round(period), 2),
        share=float(np.clip(share, 0.0, 1.0)),
        phase=phase,
    )


# The fields of ``Wave``, in the same order.
WAVE = np.dtype(
    [
        ("low", np.float64),
        ("high", np.float64),
        ("period", np.float64),
        ("share", np.float64),
        ("phase", np.float64),
    ]
)


class Adversaries(Policy):
    """Adversaries, each of which plays ``episodes`` environments in a row."""

    def __init__(self, adversaries: Sequence[Adversary], episodes: int, scenario: Scenario) -> None:
        self._scenario = scenario
        speeds = [astuple(adversary.speed) for adversary in adversaries]
        feeds = [astuple(adversary.feed) for adversary in adversaries]
        reactions = [adversary.reacts for adversary in adversaries]
        thresholds = [adversary.threshold for adversary in adversaries]
        steps = [adversary.steps for adversary in adversaries]
        num_envs = len(adversaries) * episodes
        self._speed = np.repeat(np.array(speeds, WAVE), episodes)
        self._feed = np.repeat(np.array(feeds, WAVE), episodes)
        self._reacts = np.repeat(reactions, episodes)
        self._threshold = np.repeat(thresholds, episodes)
        self._first_steps = np.repeat(steps, episodes)
        self._step = np.zeros(num_envs)
        self._in_metal = np.zeros(num_envs)  # [steps]

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Restart the waves of environments."""
        self._step[mask] = 0.0
        self._in_metal[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        """Return the actions of the waves."""
        reading = read(observations, self._scenario)
        self._in_metal = np.where(reading.cutting, self._in_metal + 1.0, 0.0)
        speed = _levels(self._speed, self._step)
        feed = _levels(self._feed, self._step)
        feed = np.where(self._may_be_high(reading), feed, self._feed["low"])
        self._step += 1.0

        # Entries after speed and feed change the edge, which adversaries never do.
        actions = np.full((len(feed), action_size(self._scenario)), -1.0, np.float32)
        if self._scenario.control.action == "override":
            actions[:, 0] = feed
        else:
            actions[:, 0] = speed
            actions[:, 1] = feed
        return actions

    def _may_be_high(self, reading: Reading) -> NDArray[np.bool_]:
        """Return where the feed may be high."""
        limits = self._scenario.limits
        power_share = reading.power / limits.power
        force_share = reading.thrust_force / limits.thrust_force
        is_light = np.maximum(power_share, force_share) < self._threshold
        is_early = self._in_metal <= self._first_steps
        while_light = (self._reacts == "while light") & is_light
        after_entry = (self._reacts == "after entry") & is_early
        later_in_the_bar = (self._reacts == "later in the bar") & ~is_early
        always = self._reacts == "none"
        allowed: NDArray[np.bool_] = always | while_light | after_entry | later_in_the_bar
        return allowed


def _levels(waves: NDArray[Any], step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the levels of waves, a record array of ``WAVE``, at a step."""
    position = (step / waves["period"] + waves["phase"]) % 1.0
    return np.where(position < waves["share"], waves["high"], waves["low"])


@dataclass(frozen=True)
class Attack:
    """An adversary's result against the shield."""

    env_id: str
    adversary: Adversary
    seeds: str  # their kind: tuning or held-out
    figures: Guarded


@dataclass(frozen=True)
class Budget:
    """How much a search tries."""

    candidates: int  # adversaries per generation
    generations: int
    episodes: int  # tuning seeds that each adversary plays
    worst: int  # adversaries to report
    held_out: int  # held-out seeds that these play in the end


def attack(env_id: str, scenario: Scenario, budget: Budget, settings: Settings) -> Iterator[Attack]:
    """Search with tuning seeds, then play the worst adversaries on held-out seeds.

    Yield the worst adversaries of the search first, then the same ones on held-out seeds.
    """
    worst = search(env_id, scenario, budget, settings)[: budget.worst]
    yield from worst
    if budget.held_out > 0:
        yield from _played(
            env_id,
            scenario,
            adversaries=[attack.adversary for attack in worst],
            kind="held-out",
            seeds=held_out_seeds(budget.held_out),
            settings=settings,
        )


def search(env_id: str, scenario: Scenario, budget: Budget, settings: Settings) -> list[Attack]:
    """Return the adversaries that were tried on tuning seeds, the worst first."""
    random = np.random.default_rng(0)
    attacks: list[Attack] = []
    for generation in range(budget.generations):
        if generation == 0:
            tried = _first_generation(budget.candidates, random)
        else:
            tried = _next_generation(attacks[:KEPT], budget.candidates, random)
        attacks += _played(
            env_id,
            scenario,
            adversaries=tried,
            kind="tuning",
            seeds=tuning_seeds(budget.episodes),
            settings=settings,
        )
        attacks.sort(key=badness, reverse=True)
        progress = f"{env_id}: generation {generation + 1} of {budget.generations}"
        print(f"{progress}: {line(attacks[0])}", file=sys.stderr, flush=True)
    return attacks


def _first_generation(candidates: int, random: np.random.Generator) -> list[Adversary]:
    adversaries = list(KNOWN[:candidates])
    while len(adversaries) < candidates:
        adversaries.append(drawn(random))
    return adversaries


def _next_generation(
    worst: Sequence[Attack], candidates: int, random: np.random.Generator
) -> list[Adversary]:
    """Return variations of the worst adversaries, which take turns."""
    return [varied(worst[k % len(worst)].adversary, random) for k in range(candidates)]


def badness(attack: Attack) -> float:
    """Return the share of cutting time in severe overload, and a charge for broken edges [-]."""
    figures = attack.figures
    return figures.severe + BROKEN_EDGE * 100.0 * figures.edges_broken / figures.episodes


def _played(
    env_id: str,
    scenario: Scenario,
    adversaries: Sequence[Adversary],
    kind: str,
    seeds: list[int],
    settings: Settings,
) -> list[Attack]:
    """Play all adversaries in one batch, each with the same seeds, whose kind is given."""
    played = play_guarded(
        scenario,
        Adversaries(adversaries, len(seeds), scenario),
        seeds=seeds * len(adversaries),
        settings=settings,
        label=f"{env_id}: {len(adversaries)} adversaries",
    )
    attacks = []
    for k, adversary in enumerate(adversaries):
        figures = played.total(slice(k * len(seeds), (k + 1) * len(seeds)))
        attacks.append(Attack(env_id=env_id, adversary=adversary, seeds=kind, figures=figures))
    return attacks


def line(attack: Attack) -> str:
    """Return an attack as a line of text."""
    figures = attack.figures
    result = f"{100.0 * figures.severe:.3f} % over, {figures.edges_broken} edges broken"
    return f"{result}: {attack.adversary}"


def table(attacks: Sequence[Attack]) -> str:
    """Return attacks as a Markdown table."""
    heads = (
        "Task",
        "Seeds",
        "Adversary",
        "Over 5 % [% of cutting time]",
        "Edges broken",
        "MRR [cm3/min]",
        "Takeovers",
    )
    rows = []
    for attack in attacks:
        figures = attack.figures
        rows.append(
            (
                attack.env_id,
                f"{figures.episodes} {attack.seeds}",
                str(attack.adversary),
                f"{100.0 * figures.severe:.3f}",
                f"{figures.edges_broken}",
                f"{figures.removal_rate:.1f}",
                f"{figures.takeovers}",
            )
        )
    return markdown(heads, rows)

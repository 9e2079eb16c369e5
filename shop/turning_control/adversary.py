"""Search for policies that get past the shield: what they exceed, and what they break.

An adversary switches speed and feed between two actions each, as a square wave or in reaction to what it observes. The search
keeps the worst adversaries of a generation and varies them in the next. It plays tuning seeds only; ``attack`` then plays the
worst ones on held-out seeds.
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from turning_control.measure import Guarded, markdown, play_guarded
from turning_control.shield import Settings

from turning_env.observation import Reading, read
from turning_env.physics.quantities import action_size
from turning_env.scenario import Scenario
from turning_env.scoring.policy import Actions, Observations, Policy
from turning_env.scoring.seeds import held_out_seeds, tuning_seeds

Reaction = Literal["none", "while light", "after entry", "later in the bar"]
REACTIONS: tuple[Reaction, ...] = get_args(Reaction)

BROKEN_EDGE = 0.0005  # share of severe overload that counts as much as a broken edge per 100 episodes, in the ranking [-]
KEPT = 8  # adversaries of a generation that are varied in the next


@dataclass(frozen=True)
class Wave:
    """A square wave of actions over steps."""

    low: float  # action [-1..1]
    high: float  # action [-1..1]
    period: float  # [steps]
    share: float  # share of the period in which the action is the high one [-]
    phase: float  # [periods]


@dataclass(frozen=True)
class Adversary:
    """A policy that tries to get past the shield.

    The feed's wave is high only where ``reacts`` allows it, and low elsewhere: ``while light``, if neither load is above
    ``threshold`` times its limit; ``after entry``, in air and in the first ``steps`` in a bar; ``later in the bar``, after them.
    """

    speed: Wave
    feed: Wave
    reacts: Reaction = "none"
    threshold: float = 1.0  # [-]
    steps: float = 3.0

    def __str__(self) -> str:
        """Describe the adversary in a line."""
        parts = [
            f"{name} {_wave_text(wave)}"
            for name, wave in (("speed", self.speed), ("feed", self.feed))
        ]
        if self.reacts == "while light":
            parts.append(f"while loads are below {self.threshold:.2f}")
        elif self.reacts == "after entry":
            parts.append(f"in the first {self.steps:.0f} steps of a bar")
        elif self.reacts == "later in the bar":
            parts.append(f"after {self.steps:.0f} steps of a bar")
        return ", ".join(parts)


def _wave_text(wave: Wave) -> str:
    if wave.share <= 0.0 or wave.low == wave.high:
        return f"{wave.low:+.2f}"
    if wave.share >= 1.0:
        return f"{wave.high:+.2f}"
    return f"{wave.low:+.2f}/{wave.high:+.2f} every {wave.period:.0f} steps ({100.0 * wave.share:.0f} % high)"


def switching(period: float) -> Adversary:
    """Return the adversary that switches both actions from -1 to 1 and back every ``period`` steps."""
    wave = Wave(low=-1.0, high=1.0, period=2.0 * period, share=0.5, phase=0.5)
    return Adversary(speed=wave, feed=wave)


def steady(speed: float, feed: float) -> Adversary:
    """Return the adversary of constant actions."""
    return Adversary(
        speed=Wave(low=speed, high=speed, period=1.0, share=1.0, phase=0.0),
        feed=Wave(low=feed, high=feed, period=1.0, share=1.0, phase=0.0),
    )


def drawn(random: np.random.Generator) -> Adversary:
    """Return a random adversary."""
    return Adversary(
        speed=_drawn_wave(random),
        feed=_drawn_wave(random),
        reacts=REACTIONS[random.integers(len(REACTIONS))],
        threshold=random.uniform(0.3, 1.1),
        steps=round(10.0 ** random.uniform(0.0, 2.0)),
    )


def _drawn_wave(random: np.random.Generator) -> Wave:
    low, high = np.sort(random.uniform(-1.0, 1.0, 2))
    if random.random() < 0.5:
        low, high = -1.0, 1.0
    return Wave(
        low=float(low),
        high=float(high),
        period=round(10.0 ** random.uniform(0.3, 2.3)),
        share=random.uniform(0.05, 1.0),
        phase=random.random(),
    )


def varied(adversary: Adversary, random: np.random.Generator) -> Adversary:
    """Return an adversary like another one: some of its numbers change a little, seldom its reaction."""
    reacts = adversary.reacts
    if random.random() < 0.1:
        reacts = REACTIONS[random.integers(len(REACTIONS))]
    return replace(
        adversary,
        speed=_varied_wave(adversary.speed, random),
        feed=_varied_wave(adversary.feed, random),
        reacts=reacts,
        threshold=float(np.clip(adversary.threshold + random.normal(0.0, 0.1), 0.1, 1.2)),
        steps=max(round(adversary.steps * np.exp(random.normal(0.0, 0.4))), 1),
    )


def _varied_wave(wave: Wave, random: np.random.Generator) -> Wave:
    if random.random() < 0.3:
        return wave
    return Wave(
        low=float(np.clip(wave.low + random.normal(0.0, 0.2), -1.0, 1.0)),
        high=float(np.clip(wave.high + random.normal(0.0, 0.2), -1.0, 1.0)),
        period=max(round(wave.period * np.exp(random.normal(0.0, 0.3))), 2),
        share=float(np.clip(wave.share + random.normal(0.0, 0.15), 0.0, 1.0)),
        phase=random.random(),
    )


class Adversaries(Policy):
    """Adversaries, each of which plays ``episodes`` environments in a row."""

    def __init__(self, adversaries: Sequence[Adversary], episodes: int, scenario: Scenario) -> None:
        self._scenario = scenario
        self._size = action_size(scenario)
        self._speed = _columns([each.speed for each in adversaries], episodes)
        self._feed = _columns([each.feed for each in adversaries], episodes)
        self._reacts = np.repeat([each.reacts for each in adversaries], episodes)
        self._threshold = np.repeat([each.threshold for each in adversaries], episodes)
        self._first_steps = np.repeat([each.steps for each in adversaries], episodes)
        self._step, self._in_metal = np.zeros((2, len(self._reacts)))

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Start the waves of environments anew."""
        self._step[mask] = 0.0
        self._in_metal[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        """Return the actions of the waves."""
        reading = read(observations, self._scenario)
        self._in_metal = np.where(reading.cutting, self._in_metal + 1.0, 0.0)
        speed = _values(self._speed, self._step)
        feed = np.where(self._allowed(reading), _values(self._feed, self._step), self._feed["low"])
        self._step += 1.0
        columns = [feed] if self._scenario.control.action == "override" else [speed, feed]
        while len(columns) < self._size:
            columns.append(np.full(len(feed), -1.0))  # never changes the edge
        return np.stack(columns, axis=1).astype(np.float32)

    def _allowed(self, reading: Reading) -> NDArray[np.bool_]:
        """Return where the feed may be high."""
        limits = self._scenario.limits
        load = np.maximum(reading.power / limits.power, reading.thrust_force / limits.thrust_force)
        early = self._in_metal <= self._first_steps
        allowed: NDArray[np.bool_] = (
            (self._reacts == "none")
            | ((self._reacts == "while light") & (load < self._threshold))
            | ((self._reacts == "after entry") & early)
            | ((self._reacts == "later in the bar") & ~early)
        )
        return allowed


def _columns(waves: Sequence[Wave], episodes: int) -> dict[str, NDArray[np.float64]]:
    """Return the fields of waves, each for ``episodes`` environments."""
    names = ("low", "high", "period", "share", "phase")
    return {name: np.repeat([getattr(wave, name) for wave in waves], episodes) for name in names}


def _values(
    waves: dict[str, NDArray[np.float64]], step: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the values of waves at a step."""
    position = (step / waves["period"] + waves["phase"]) % 1.0
    return np.where(position < waves["share"], waves["high"], waves["low"])


KNOWN = (
    steady(1.0, 1.0),
    steady(-1.0, 1.0),
    steady(1.0, -1.0),
    *(switching(period) for period in (2, 5, 10, 20, 50, 100)),
)
"""The adversaries of every first generation."""


@dataclass(frozen=True)
class Attack:
    """An adversary's result against the shield."""

    env_id: str
    adversary: Adversary
    seeds: str  # which ones: tuning or held-out
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
    """Yield the worst adversaries of a search on tuning seeds, then the same ones on held-out seeds."""
    found = search(env_id, scenario, budget, settings)[: budget.worst]
    yield from found
    if budget.held_out > 0:
        adversaries = [each.adversary for each in found]
        yield from _played(
            env_id, scenario, adversaries, "held-out", held_out_seeds(budget.held_out), settings
        )


def search(env_id: str, scenario: Scenario, budget: Budget, settings: Settings) -> list[Attack]:
    """Return the adversaries that were tried on tuning seeds, the worst first."""
    random = np.random.default_rng(0)
    found: list[Attack] = []
    for generation in range(budget.generations):
        if generation == 0:
            tried = [*KNOWN, *(drawn(random) for _ in range(budget.candidates - len(KNOWN)))][
                : budget.candidates
            ]
        else:
            worst = [attack.adversary for attack in found[:KEPT]]
            tried = [varied(worst[k % len(worst)], random) for k in range(budget.candidates)]
        found.extend(
            _played(env_id, scenario, tried, "tuning", tuning_seeds(budget.episodes), settings)
        )
        found.sort(key=badness, reverse=True)
        progress = (
            f"{env_id}: generation {generation + 1} of {budget.generations}: {line(found[0])}"
        )
        print(progress, file=sys.stderr, flush=True)
    return found


def badness(attack: Attack) -> float:
    """Return the share of cutting time in severe overload, and a charge for broken edges [-]."""
    figures = attack.figures
    return figures.severe + BROKEN_EDGE * 100.0 * figures.edges_broken / figures.episodes


def _played(
    env_id: str,
    scenario: Scenario,
    adversaries: Sequence[Adversary],
    seeds: str,
    numbers: list[int],
    settings: Settings,
) -> list[Attack]:
    policy = Adversaries(adversaries, len(numbers), scenario)
    label = f"{env_id}: {len(adversaries)} adversaries"
    played = play_guarded(scenario, policy, numbers * len(adversaries), settings, label)
    attacks = []
    for k, adversary in enumerate(adversaries):
        group = slice(k * len(numbers), (k + 1) * len(numbers))
        attacks.append(
            Attack(env_id=env_id, adversary=adversary, seeds=seeds, figures=played.total(group))
        )
    return attacks


def line(attack: Attack) -> str:
    """Return an attack as a line of text."""
    figures = attack.figures
    return f"{100.0 * figures.severe:.3f} % over, {figures.edges_broken} edges broken: {attack.adversary}"


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
        severe, removal = f"{100.0 * figures.severe:.3f}", f"{figures.removal_rate:.1f}"
        seeds = f"{figures.episodes} {attack.seeds}"
        row = (
            attack.env_id,
            seeds,
            str(attack.adversary),
            severe,
            f"{figures.edges_broken}",
            removal,
            f"{figures.takeovers}",
        )
        rows.append(row)
    return markdown(heads, rows)

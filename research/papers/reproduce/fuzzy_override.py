"""The fuzzy override paper: over-regulation of its first form, the cure, and the time saved.

All is played on the stepped bar without randomness (``research/papers/stepped_bar.py``). The paper
gives the ripple of depth, 2 %, but not its period, so many are played. Over-regulation is any swing
beyond the one that the load requires. Against a slow ripple of 2 %, that is 2 % over the exponent
of feed in the power law.

The text has neither idle torque nor lags. One idle torque is chosen, with which an override of
145 % holds the target load at 2 mm; the time saved follows from it. The servo's time constant is
chosen for the swing of the first form. Equations (1) to (7) are in ``baselines/fuzzy_override.py``.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from baselines.fuzzy_override import FIRST_FORM, MODIFIED_FORM, fuzzy_override, new_override
from baselines.load_override import RULES as LOAD_RULES
from baselines.models.part_program import PartProgram
from research.papers.reproduce.checks import Check, aligned_table, at_least, at_most, claim
from research.papers.stepped_bar import RIPPLE, STEPS, Trajectory, play_bar, stepped_bar
from turning_env import Scenario
from turning_env.policy import Policy

FORMS = {"first form": FIRST_FORM, "modified form": MODIFIED_FORM}
TARGET = 0.6  # M_z of the paper's test [-]
OVERRIDE_MAX = 2.0  # O_m of the paper [-]
LOAD_AT_1_MM = 0.25  # load at 1 mm and programmed feed, as the text has it [-]
DEEP = 3.0  # depth of cut at which the load is held [mm]
PERIODS = (0.25, 0.35, 0.5, 0.7, 1.0, 2.0, 4.0, 10.0)  # periods of the ripple [s]
TRANSIENT = 5.0  # time after which the override has settled on a bar of one depth [s]
# Programmed feed above that at 3 mm under control [mm/s], which settles at 0.84 of 3.9 mm/s.
FEED_VELOCITY = 4.0
STRONG = 2.0  # torque of a strong drive over that of the test's, in place of the wheel lathe's [-]


class Lags(NamedTuple):
    """Lags of a lathe."""

    servo: float  # time constant of the feed servo [s]
    chip: float  # lag of the chip [turns]


LAGS = (
    Lags(servo=0.13, chip=0.0),
    Lags(servo=0.13, chip=0.5),
    Lags(servo=0.13, chip=1.0),  # those of the preset `surface`
    Lags(servo=0.02, chip=0.0),
    Lags(servo=0.02, chip=1.0),  # those of the paper's test
)


def fuzzy(scenario: Scenario, form: str) -> Policy:
    """Return the controller of one form, with the paper's target."""
    return fuzzy_override(PartProgram(scenario, {}), 1, target=1.0, **FORMS[form])


@cache
def rippled(form: str, period: float | None, torque: float = 1.0, **machine: float) -> Trajectory:
    """Return the settled trajectory of a form on a bar of 3 mm.

    Args:
        form: name in ``FORMS``.
        period: period of the ripple [s]; None for a smooth bar.
        torque: torque of the drive over that of the test's, at the same speeds [-].
        machine: other values of the machine, see ``stepped_bar``.
    """
    # Two periods of the ripple, and 3 s at least.
    settled_time = 3.0
    if period is not None:
        settled_time = max(settled_time, 2.0 * period)
    # A strong drive feeds up to twice as fast.
    max_velocity = FEED_VELOCITY if torque <= 1.0 else 2.0 * FEED_VELOCITY
    scenario = stepped_bar(
        depths=(DEEP,),
        bar_length=max_velocity * (TRANSIENT + settled_time),
        ripple_period=period,
        torque=torque,
        **machine,
    )
    trajectory = play_bar(lambda num_envs: fuzzy(scenario, form), scenario)
    return trajectory.after(TRANSIENT)


def swing(settled: Trajectory) -> float:
    """Return the amplitude of the override, half of its range [%]."""
    return 50.0 * float(np.ptp(settled.override))


def worst_swing(form: str, torque: float = 1.0, **machine: float) -> float:
    """Return the amplitude of the override at the worst period of the ripple [%]."""
    return max(swing(rippled(form, period, torque=torque, **machine)) for period in PERIODS)


def required_swing() -> float:
    """Return the amplitude of the override that holds the load at 3 mm against a slow ripple [%].

    Power is proportional to depth and feed^e, so feed must swing 1/e times as far as depth.
    """
    exponent = stepped_bar().material.power.feed
    mean_override = float(rippled("first form", period=None).override.mean())
    return 100.0 * mean_override * RIPPLE / exponent


@cache
def stepped(name: str, depths: tuple[float, ...] = STEPS) -> Trajectory:
    """Return the trajectory of a form, or of the programmed feed, on a stepped bar."""
    scenario = stepped_bar(depths)

    def make_policy(num_envs: int) -> Policy:
        if name in FORMS:
            return fuzzy(scenario, name)
        return LOAD_RULES["programmed_feed"].controller(scenario, num_envs)

    return play_bar(make_policy, scenario)


def saved(form: str) -> float:
    """Return the time that a form saves on three equal sections of 1, 2 and 3 mm [%].

    It is compared with the programmed feed.
    """
    time = stepped(form).time[-1]
    programmed_time = stepped("programmed feed").time[-1]
    return 100.0 * float(1.0 - time / programmed_time)


def resting(idle: float) -> list[float]:
    """Return the overrides [-] at which the load rests at 1, 2 and 3 mm.

    Args:
        idle: idle load [-].
    """
    # The load is idle + (M_1 - idle) t O^e with M_1 at t = 1 mm and O = 1. It equals M_z.
    exponent = stepped_bar().material.power.feed
    overrides = []
    for depth in STEPS:
        cutting_load = (LOAD_AT_1_MM - idle) * depth
        override = ((TARGET - idle) / cutting_load) ** (1.0 / exponent)
        overrides.append(min(override, OVERRIDE_MAX))
    return overrides


def saved_at_rest(overrides: Sequence[float], lengths: Sequence[float]) -> float:
    """Return the time that overrides save over sections of given lengths [%]."""
    times = [length / override for length, override in zip(lengths, overrides, strict=True)]
    return 100.0 * (1.0 - sum(times) / sum(lengths))


def largest_jump() -> float:
    """Return the largest change of the first form's new override across the target load [%]."""
    present = np.linspace(0.0, OVERRIDE_MAX, num=201)
    at_target = np.full(201, TARGET)
    below_target = np.full(201, TARGET - 1e-9)
    below, above = (
        new_override(present, load, target=TARGET, override_max=OVERRIDE_MAX, **FIRST_FORM)
        for load in (below_target, at_target)
    )
    return 100.0 * float(np.abs(below - above).max())


def value_checks() -> Iterator[Check]:
    """Yield the checks of the statement on Figure 3.

    The functions of the load are continuous, with values in (0, 200 %].
    """
    reason = (
        "just below the target, (1) and (3) raise the override by 0.67 % of its distance from "
        "200 %, and (4) keeps it"
    )
    yield at_most(
        "override over load: largest jump, at the target [%]; continuous",
        0.001,
        ours=largest_jump(),
        not_reproduced=reason,
    )
    overrides = np.linspace(0.01, OVERRIDE_MAX, num=200)
    loads = np.linspace(0.0, 1.0, num=201)
    present, load = np.meshgrid(overrides, loads)
    values = new_override(present, load, target=TARGET, override_max=OVERRIDE_MAX, **FIRST_FORM)
    yield claim(
        "override over load: above 0 and at most 200 %", (values > 0.0) & (values <= OVERRIDE_MAX)
    )


def swing_checks() -> Iterator[Check]:
    """Yield the checks of over-regulation: the first form swings, the modified form does not."""
    for form in FORMS:
        held = 100.0 * float(rippled(form, period=None).load.mean())
        yield Check(f"{form}: load held at 3 mm [%]", 60.0, ours=held, tolerance=0.5)
    yield at_least(
        "first form: swing of override at the worst period of the ripple [%]",
        10.0,
        ours=worst_swing("first form"),
    )
    yield at_most(
        "modified form: swing at the worst period, what the load asks for [%]",
        required_swing(),
        ours=worst_swing("modified form"),
    )


def time_checks() -> Iterator[Check]:
    """Yield the checks of the overrides on the stepped bar, and of the time that they save."""
    for form in FORMS:
        yield claim(f"{form}: faster than the programmed feed on 1, 2 and 3 mm", saved(form) > 0.0)
    held = 100.0 * float(stepped("first form").at_depth(2.0, settled=2.0).override.mean())
    yield Check("first form: override that holds 60 % at 2 mm [%]", 145.0, ours=held, tolerance=1.0)

    # The load if the force is proportional to feed. Idle torque and a lower exponent make it less.
    highest_load = LOAD_AT_1_MM * 1.45
    raised = new_override(
        np.array([1.45]),
        np.array([highest_load]),
        target=TARGET,
        override_max=OVERRIDE_MAX,
        **FIRST_FORM,
    )
    yield claim(
        "first form: no rest at 145 % and 1 mm, where the load is 36 % at most",
        highest_load < TARGET and raised[0] > 1.45,
    )
    yield Check(
        "first form: time saved on three equal sections [%]",
        20.0,
        ours=saved("first form"),
        tolerance=1.0,
    )


def checks() -> Iterator[Check]:
    """Yield the checks of the paper."""
    shallow = stepped("programmed feed").at_depth(1.0, settled=1.0)
    yield Check(
        "load at 1 mm and programmed feed [%]",
        25.0,
        ours=100.0 * float(shallow.load.mean()),
        tolerance=0.5,
    )
    yield from swing_checks()
    yield from time_checks()
    yield from value_checks()
    yield at_most(
        "wheel lathe: swing of the first form on a drive of twice the torque [%]",
        required_swing(),
        ours=worst_swing("first form", torque=STRONG),
    )


def rest_table() -> Iterator[str]:
    """Yield the table of overrides at rest and the time saved, by idle torque."""
    yield (
        "Overrides at rest over the idle torque's share of the rated one, and the time saved on "
        "sections of 1, 2 and 3 mm [%]."
    )
    section_lengths = ((1, 1, 1), (2, 1, 1), (1, 2, 1), (1, 1, 2))
    heads = ["idle", "override [%]"]
    for lengths in section_lengths:
        heads.append("lengths " + ":".join(str(length) for length in lengths))

    lines = []
    for idle in (0.0, 0.02, 0.035, 0.05):
        overrides = resting(idle)
        cells = [f"{idle:.1%}", ", ".join(f"{100 * override:.0f}" for override in overrides)]
        for lengths in section_lengths:
            cells.append(f"{saved_at_rest(overrides, lengths):.1f}")
        lines.append(cells)
    yield from aligned_table(heads, lines)


def swing_table() -> Iterator[str]:
    """Yield the table of the swing by lags."""
    yield (
        "Swing of the override at 3 mm by the time constant of the feed servo and the lag of the "
        "chip [%]."
    )
    heads = [
        "servo, chip",
        "first form, smooth bar",
        "with the worst ripple",
        "modified form, the same",
    ]
    lines = []
    for lags in LAGS:
        machine = {"feed_time_constant": lags.servo, "chip_lag": lags.chip}
        swings = [
            swing(rippled("first form", period=None, **machine)),
            worst_swing("first form", **machine),
            worst_swing("modified form", **machine),
        ]
        cells = [f"{lags.servo} s, {lags.chip} turns"]
        cells += [f"{value:.1f}" for value in swings]
        lines.append(cells)
    yield from aligned_table(heads, lines)


def tables() -> Iterator[str]:
    """Yield the tables of overrides at rest and the time saved, and of the swing by lags."""
    yield from rest_table()
    yield ""
    yield from swing_table()

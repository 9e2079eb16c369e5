"""Figures 1, 2, 3 and 6 of the fuzzy override paper: its formulas, over load and override.

The copy used lacks the figures; its formulas are printed. All are drawn for the target load of the
paper's test, M_z = 60 %.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from baselines.fuzzy_override import (
    FIRST_FORM,
    MODIFIED_FORM,
    conjunction,
    disjunction,
    falling_correction,
    new_override,
    rising_correction,
)
from research.papers.figures import legend, lettered
from research.papers.reproduce.fuzzy_override import OVERRIDE_MAX, TARGET
from turning_env.rendering import plot_style as style

BELOW = np.linspace(0.0, TARGET - 1e-9, num=201)  # loads M_a [-]; (4) holds at the target itself
ABOVE = np.linspace(TARGET, 1.0, num=401)
OVERRIDES = (0.25, 0.5, 1.0, 1.5, 2.0)  # present overrides O_a [-]
CORRECTIONS = (0.0, 0.25, 0.5, 0.75, 1.0)  # W_k [-]
COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.GREY)


def _mark_target(axes: Axes) -> None:
    """Mark the target load, at which the functions jump."""
    axes.axvline(100.0 * TARGET, color=style.GREY, linewidth=0.9, linestyle=":")
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("load $M_a$ [%]")


def draw_correction() -> Figure:
    """Draw Figure 1: the correction W_k over the load, and its derivative."""
    figure, (correction_axes, derivative_axes) = lettered((style.DOUBLE, 2.6), rows=1, columns=2)
    # Equations (1) and (2).
    rising = rising_correction(BELOW, TARGET, k=FIRST_FORM["k"])
    falling = falling_correction(ABOVE, TARGET, p=FIRST_FORM["p"])
    for load, correction in ((BELOW, rising), (ABOVE, falling)):
        load_percent = 100.0 * load
        derivative = np.gradient(correction, load_percent)
        correction_axes.plot(load_percent, correction, color=style.BLUE)
        derivative_axes.plot(load_percent, derivative, color=style.VERMILLION)
    correction_axes.set_ylabel("correction $W_k$")
    derivative_axes.set_ylabel("derivative of $W_k$ [1/%]")
    _mark_target(correction_axes)
    _mark_target(derivative_axes)
    return style.readable(figure)


def draw_aggregation() -> Figure:
    """Draw Figure 2: the new override by disjunction and by conjunction, over the present one."""
    figure, (raised_axes, lowered_axes) = lettered(
        (style.DOUBLE, 3.0), rows=1, columns=2, sharey=True
    )
    override = np.linspace(0.0, OVERRIDE_MAX, num=50)
    override_percent = 100.0 * override
    looks: dict[str, dict[str, Any]] = {}
    for correction, colour in zip(CORRECTIONS, COLOURS, strict=True):
        constant = np.full_like(override, correction)
        # Equations (3) and (4).
        raised = disjunction(override, constant, override_max=OVERRIDE_MAX)
        lowered = conjunction(override, constant, d=FIRST_FORM["d"])
        raised_axes.plot(override_percent, 100.0 * raised, color=colour)
        lowered_axes.plot(override_percent, 100.0 * lowered, color=colour)
        looks[f"$W_k$ = {correction:g}"] = {"color": colour}
    raised_axes.set_ylabel("new override $O_n$ [%]")
    for axes in (raised_axes, lowered_axes):
        axes.set_xlabel("present override $O_a$ [%]")
    legend(figure, looks, columns=len(looks))
    return style.readable(figure)


def draw_override() -> Figure:
    """Draw Figure 3: the new override over the load, for several present overrides.

    Panel b enlarges the jump at the target.
    """
    figure, (whole_axes, jump_axes) = lettered((style.DOUBLE, 3.2), rows=1, columns=2)
    looks: dict[str, dict[str, Any]] = {}
    for present, colour in zip(OVERRIDES, COLOURS, strict=True):
        for load in (BELOW, ABOVE):
            before = np.full_like(load, present)
            after = new_override(
                before, load, target=TARGET, override_max=OVERRIDE_MAX, **FIRST_FORM
            )
            change = after - present
            load_percent = 100.0 * load
            whole_axes.plot(load_percent, 100.0 * after, color=colour)
            jump_axes.plot(load_percent, 100.0 * change, color=colour)
        looks[f"$O_a$ = {100 * present:.0f} %"] = {"color": colour}
    _mark_target(whole_axes)
    _mark_target(jump_axes)
    jump_axes.set_xlim(58.0, 62.0)
    jump_axes.set_ylim(-1.5, 2.0)
    whole_axes.set_ylabel("new override $O_n$ [%]")
    jump_axes.set_ylabel("change $O_n - O_a$ [%]")
    legend(figure, looks, columns=len(looks))
    return style.readable(figure)


def draw_conjunction() -> Figure:
    """Draw Figure 6: the conjunction with d = 0, dashed, and with the d of the modified form."""
    figure, (axes,) = lettered((style.SINGLE, 3.2), rows=1, columns=1)
    axes.set_title("")
    override = np.linspace(0.0, OVERRIDE_MAX, num=50)
    override_percent = 100.0 * override
    looks: dict[str, dict[str, Any]] = {}
    for correction, colour in zip(CORRECTIONS, COLOURS, strict=True):
        constant = np.full_like(override, correction)
        # Equations (4) and (7).
        without_d = conjunction(override, constant, d=FIRST_FORM["d"])
        with_d = conjunction(override, constant, d=MODIFIED_FORM["d"])
        axes.plot(
            override_percent,
            100.0 * without_d,
            color=colour,
            linestyle="--",
            linewidth=0.8,
        )
        axes.plot(override_percent, 100.0 * with_d, color=colour)
        looks[f"$W_k$ = {correction:g}"] = {"color": colour}
    axes.set_xlabel("present override $O_a$ [%]")
    axes.set_ylabel("new override $O_n$ [%]")
    legend(figure, looks, columns=3)
    return style.readable(figure)

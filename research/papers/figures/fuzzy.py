"""Figures 1, 2, 3 and 6 of the fuzzy override paper: its formulas, over load and override.

The copy used lacks the figures; its formulas are printed. All are drawn for the target load of the paper's test, M_z = 60 %.
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

BELOW = np.linspace(0.0, TARGET - 1e-9, 201)  # loads M_a [-]; (4) holds at the target itself
ABOVE = np.linspace(TARGET, 1.0, 401)
OVERRIDES = (0.25, 0.5, 1.0, 1.5, 2.0)  # present overrides O_a [-]
CORRECTIONS = (0.0, 0.25, 0.5, 0.75, 1.0)  # W_k [-]
COLOURS = (style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.GREY)


def _jump(axes: Axes) -> None:
    """Mark the target load, at which the functions jump."""
    axes.axvline(100.0 * TARGET, color=style.GREY, linewidth=0.9, linestyle=":")
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("load $M_a$ [%]")


def draw_correction() -> Figure:
    """Draw Figure 1: the correction W_k over the load, and its derivative."""
    figure, (correction_axes, derivative_axes) = lettered((style.DOUBLE, 2.6), 1, 2)
    for load, correction in (
        (BELOW, rising_correction(BELOW, TARGET, FIRST_FORM["k"])),
        (ABOVE, falling_correction(ABOVE, TARGET, FIRST_FORM["p"])),
    ):
        correction_axes.plot(100.0 * load, correction, color=style.BLUE)
        derivative_axes.plot(
            100.0 * load, np.gradient(correction, 100.0 * load), color=style.VERMILLION
        )
    correction_axes.set_ylabel("correction $W_k$")
    derivative_axes.set_ylabel("derivative of $W_k$ [1/%]")
    _jump(correction_axes)
    _jump(derivative_axes)
    return style.readable(figure)


def draw_aggregation() -> Figure:
    """Draw Figure 2: the new override by disjunction and by conjunction, over the present one."""
    figure, (raised_axes, lowered_axes) = lettered((style.DOUBLE, 3.0), 1, 2, sharey=True)
    override = np.linspace(0.0, OVERRIDE_MAX, 50)
    looks: dict[str, dict[str, Any]] = {}
    for correction, colour in zip(CORRECTIONS, COLOURS, strict=True):
        look: dict[str, Any] = {"color": colour}
        constant = np.full_like(override, correction)
        raised = disjunction(override, constant, OVERRIDE_MAX)
        lowered = conjunction(override, constant, FIRST_FORM["d"])
        raised_axes.plot(100.0 * override, 100.0 * raised, **look)
        lowered_axes.plot(100.0 * override, 100.0 * lowered, **look)
        looks[f"$W_k$ = {correction:g}"] = look
    raised_axes.set_ylabel("new override $O_n$ [%]")
    for axes in (raised_axes, lowered_axes):
        axes.set_xlabel("present override $O_a$ [%]")
    legend(figure, looks, columns=len(looks))
    return style.readable(figure)


def draw_override() -> Figure:
    """Draw Figure 3: the new override over the load, for several present overrides; b enlarges the jump at the target."""
    figure, (whole_axes, jump_axes) = lettered((style.DOUBLE, 3.2), 1, 2)
    looks: dict[str, dict[str, Any]] = {}
    for present, colour in zip(OVERRIDES, COLOURS, strict=True):
        look: dict[str, Any] = {"color": colour}
        for load in (BELOW, ABOVE):
            before = np.full_like(load, present)
            after = new_override(before, load, TARGET, OVERRIDE_MAX, **FIRST_FORM)
            whole_axes.plot(100.0 * load, 100.0 * after, **look)
            jump_axes.plot(100.0 * load, 100.0 * (after - present), **look)
        looks[f"$O_a$ = {100 * present:.0f} %"] = look
    _jump(whole_axes)
    _jump(jump_axes)
    jump_axes.set_xlim(58.0, 62.0)
    jump_axes.set_ylim(-1.5, 2.0)
    whole_axes.set_ylabel("new override $O_n$ [%]")
    jump_axes.set_ylabel("change $O_n - O_a$ [%]")
    legend(figure, looks, columns=len(looks))
    return style.readable(figure)


def draw_conjunction() -> Figure:
    """Draw Figure 6: the conjunction with d = 0, dashed, and with the d of the modified form."""
    figure, (axes,) = lettered((style.SINGLE, 3.2), 1, 1)
    axes.set_title("")
    override = np.linspace(0.0, OVERRIDE_MAX, 50)
    looks: dict[str, dict[str, Any]] = {}
    for correction, colour in zip(CORRECTIONS, COLOURS, strict=True):
        look: dict[str, Any] = {"color": colour}
        constant = np.full_like(override, correction)
        without = conjunction(override, constant, FIRST_FORM["d"])
        with_d = conjunction(override, constant, MODIFIED_FORM["d"])
        axes.plot(100.0 * override, 100.0 * without, linestyle="--", linewidth=0.8, **look)
        axes.plot(100.0 * override, 100.0 * with_d, **look)
        looks[f"$W_k$ = {correction:g}"] = look
    axes.set_xlabel("present override $O_a$ [%]")
    axes.set_ylabel("new override $O_n$ [%]")
    legend(figure, looks, columns=3)
    return style.readable(figure)

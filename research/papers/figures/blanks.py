"""The gain of correcting the path to the measured blank, and the limits that bind in each case (Sharmazanashvili 2008)."""

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from baselines.models.process import Process
from baselines.two_limits import TWO_LIMITS, binding
from research.papers.figures import legend
from research.papers.reproduce.part_programming import IMPROVED, NOT_NECESSARY, blanks, gain
from research.papers.reproduce.part_programming_cases import CASES
from turning_env import Scenario
from turning_env.rendering import plot_style as style


def draw_gains() -> Figure:
    """Draw psi in a table whose cells are darker where more is gained."""
    unsaid = tuple(rule for rule in TWO_LIMITS if rule not in (*IMPROVED, *NOT_NECESSARY))
    kinds, groups = (
        blanks(),
        {"improved, says the paper": IMPROVED, "not necessary": NOT_NECESSARY, "not said": unsaid},
    )
    rules = [rule for group in groups.values() for rule in group]
    gains = np.array([[gain(rule, blank)[1] for rule in rules] for blank in kinds])
    figure = Figure(figsize=(style.DOUBLE, 3.2), layout="constrained")
    axes = figure.subplots()
    picture = axes.imshow(gains, cmap="Blues", vmin=0.0, vmax=1.25 * gains.max(), aspect="auto")
    for (row, column), value in np.ndenumerate(gains):
        colour = "white" if value > 0.7 * gains.max() else style.BLACK
        axes.text(column, row, f"{value:.1f}", ha="center", va="center", color=colour)
    end = -0.5
    for title, group in groups.items():
        axes.text(end + 0.5 * len(group), -0.7, title, ha="center", va="bottom")
        end += len(group)
        if end < len(rules) - 1:
            axes.axvline(end, color=style.BLACK, linewidth=1.0)
    axes.set_xticks(range(len(rules)), [f"[{rule}]" for rule in rules])
    axes.set_yticks(
        range(len(kinds)),
        [f"{blank.name}, {blank.source}: {blank.least:.1f}-{blank.largest:.1f}" for blank in kinds],
    )
    axes.tick_params(length=0.0)
    axes.set_xlabel("the two limits along which speed and feed are set")
    axes.set_ylabel("kind of blank, source: allowance [mm]")
    bar = figure.colorbar(
        picture,
        ax=axes,
        boundaries=np.linspace(0.0, gains.max(), 100),
        ticks=range(0, int(gains.max()) + 1, 5),
    )
    bar.set_label("gain psi [%]")
    return figure


PAIRS = {
    "R_z V": style.SKY,
    "R_z N": style.BLUE,
    "R_z T": style.GREEN,
    "P_y V": style.PURPLE,
    "P_y N": style.ORANGE,
    "P_y T": style.VERMILLION,
    "": style.LIGHT,
}
"""Colours of the pairs of limits that bind in the cases; "" if no speed and feed of the lathe keep all limits."""


def draw_pairs() -> Figure:
    """Draw which two limits fix the economic optimum, over depth of cut and hardness, in each typical case."""
    depths, hardness = np.meshgrid(np.linspace(0.1, 10.0, 250), np.linspace(0.54, 1.46, 150))
    figure = Figure(figsize=(style.DOUBLE, 4.4), layout="constrained")
    panels = list(figure.subplots(2, 3, sharex=True, sharey=True).flat)
    numbers = {pair: number for number, pair in enumerate(PAIRS)}
    for axes, name in zip(panels, CASES, strict=False):
        pairs = binding(Process.of(Scenario.load(name)), depths, hardness)
        picture = np.vectorize(numbers.__getitem__)(pairs)
        axes.pcolormesh(
            depths,
            hardness,
            picture,
            cmap=ListedColormap(list(PAIRS.values())),
            vmin=-0.5,
            vmax=len(PAIRS) - 0.5,
        )
        axes.set_title(name)
        axes.tick_params(labelbottom=True)
    panels[-1].axis("off")
    figure.supxlabel("depth of cut t [mm]")
    figure.supylabel("hardness over nominal [-]")
    looks = {
        f"[{pair}]" if pair else "none keeps all limits": {"facecolor": colour}
        for pair, colour in PAIRS.items()
    }
    legend(figure, looks, 1, loc="lower right", bbox_to_anchor=(0.97, 0.12))
    return figure

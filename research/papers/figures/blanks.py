"""The figures on Sharmazanashvili (2008).

They show the gain from correcting the path to the measured blank, and the limits that bind in each
typical case.
"""

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from baselines.models.process import Process
from baselines.two_limits import TWO_LIMITS, binding
from research.papers.figures import legend
from research.papers.reproduce.part_programming import (
    CLAIMED,
    IMPROVED,
    NOT_NECESSARY,
    blanks,
    gain,
)
from research.papers.reproduce.part_programming_cases import CASES
from turning_env import Scenario
from turning_env.rendering import plot_style as style


def draw_gains() -> Figure:
    """Draw psi in a table whose cells are darker where more is gained."""
    groups = {
        "improved, says the paper": IMPROVED,
        "not necessary": NOT_NECESSARY,
        "not said": tuple(rule for rule in TWO_LIMITS if rule not in CLAIMED),
    }
    rules: list[str] = []
    for group in groups.values():
        rules.extend(group)
    kinds = blanks()
    gains = np.empty((len(kinds), len(rules)))
    for row, blank in enumerate(kinds):
        gains[row] = [gain(rule, blank) for rule in rules]

    figure = Figure(figsize=(style.DOUBLE, 3.2), layout="constrained")
    axes = figure.subplots()
    picture = axes.imshow(gains, cmap="Blues", vmin=0.0, vmax=1.25 * gains.max(), aspect="auto")
    for (row, column), value in np.ndenumerate(gains):
        colour = "white" if value > 0.7 * gains.max() else style.BLACK
        axes.text(column, row, f"{value:.1f}", ha="center", va="center", color=colour)

    # Cells are centred at whole numbers, so the first column begins at -0.5.
    end = -0.5
    for title, group in groups.items():
        axes.text(end + 0.5 * len(group), -0.7, title, ha="center", va="bottom")
        end += len(group)
        if end < len(rules) - 1:
            axes.axvline(end, color=style.BLACK, linewidth=1.0)

    axes.set_xticks(range(len(rules)), [f"[{rule}]" for rule in rules])
    row_labels = [
        f"{blank.name}, {blank.source}: {blank.least:.1f}-{blank.largest:.1f}" for blank in kinds
    ]
    axes.set_yticks(range(len(kinds)), row_labels)
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
"""Colours of the pairs of limits that bind in the cases.

The pair is "" if no speed and feed of the lathe keep all limits.
"""


def draw_pairs() -> Figure:
    """Draw which two limits fix the economic optimum in each typical case.

    The axes are depth of cut and hardness.
    """
    # The slides' dispersion of hardness is 46 % of its mean (iron alloys).
    depths, hardness = np.meshgrid(
        np.linspace(0.1, 10.0, num=250), np.linspace(0.54, 1.46, num=150)
    )
    colours = ListedColormap(list(PAIRS.values()))
    numbers = {pair: number for number, pair in enumerate(PAIRS)}
    figure = Figure(figsize=(style.DOUBLE, 4.4), layout="constrained")
    panels = list(figure.subplots(2, 3, sharex=True, sharey=True).flat)
    for axes, name in zip(panels, CASES, strict=False):
        process = Process.of(Scenario.load(name))
        pairs = binding(process, depths, hardness)
        # Colours belong to numbers, not to names.
        picture = np.vectorize(numbers.__getitem__)(pairs)
        axes.pcolormesh(
            depths,
            hardness,
            picture,
            cmap=colours,
            vmin=-0.5,
            vmax=len(PAIRS) - 0.5,
        )
        axes.set_title(name)
        axes.tick_params(labelbottom=True)
    panels[-1].axis("off")  # the legend's place
    figure.supxlabel("depth of cut t [mm]")
    figure.supylabel("hardness over nominal [-]")
    looks = {}
    for pair, colour in PAIRS.items():
        label = f"[{pair}]" if pair else "none keeps all limits"
        looks[label] = {"facecolor": colour}
    legend(figure, looks, columns=1, loc="lower right", bbox_to_anchor=(0.97, 0.12))
    return figure

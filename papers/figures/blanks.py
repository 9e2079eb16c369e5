"""The gain of correcting the path to the measured blank, by kind of blank and rule (Sharmazanashvili 2008)."""

import numpy as np
from matplotlib.figure import Figure

from baselines.two_limits import TWO_LIMITS
from papers.figures.paper_figure import PaperFigure
from papers.reproduce.part_programming import IMPROVED, NOT_NECESSARY, blanks, checks, gain
from turning_env.workshop import plot_style as style


def columns() -> dict[str, tuple[str, ...]]:
    """Return the rules by what the paper says of the correction with them."""
    said = (*IMPROVED, *NOT_NECESSARY)
    return {
        "improved, says the paper": IMPROVED,
        "not necessary": NOT_NECESSARY,
        "not said": tuple(rule for rule in TWO_LIMITS if rule not in said),
    }


def draw() -> Figure:
    """Draw psi in a table whose cells are darker where more is gained."""
    kinds, groups = blanks(), columns()
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
        range(len(kinds)), [f"{blank.name}, {blank.source}: {blank.least:.1f}-{blank.largest:.1f}" for blank in kinds]
    )
    axes.tick_params(length=0.0)
    axes.set_xlabel("the two limits along which speed and feed are set")
    axes.set_ylabel("kind of blank, source: allowance [mm]")
    bar = figure.colorbar(
        picture, ax=axes, boundaries=np.linspace(0.0, gains.max(), 100), ticks=range(0, int(gains.max()) + 1, 5)
    )
    bar.set_label("gain psi [%]")
    return figure


FIGURES = (
    PaperFigure(
        "part_programming_psi",
        "Sharmazanashvili (2008), the gain psi by type of blank",
        "The gain psi from correcting the tool path to the measured blank, by kind of blank and by the two limits that set speed "
        "and feed (P force, V cutting speed, S feed, N power, M torque, T life).",
        draw,
        checks,
        "The paper's figures are lost. The project uses its dispersions of the allowance with handbook exponents.",
    ),
)

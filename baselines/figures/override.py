"""Figures 5 and 7 of the fuzzy override paper: step responses of the laws of feed override."""

from matplotlib.figure import Figure

from baselines import step_response
from baselines.figures import style
from baselines.figures.plate import Plate
from baselines.reproduce.fuzzy_override import checks
from baselines.stepped_bar import stepped_bar


def draw() -> Figure:
    """What ``python -m baselines.step_response`` draws, in the size of a page."""
    scenario = stepped_bar(step_response.DEPTHS)
    figure = step_response.draw(step_response.responses(scenario), scenario)
    figure.set_size_inches(style.DOUBLE, 6.0)
    legend = next(legend for axes in figure.axes if (legend := axes.get_legend()))
    legend.set_in_layout(False)  # else its column would be wider than the others
    legend.set_loc("upper right")
    return style.readable(figure)


PLATES = (
    Plate(
        "override_steps",
        "Fuzzy feed override, Figures 5 and 7; FANUC iAdaptS, Caron TMAC and OMATIVE ACM as patents and manuals describe them",
        "What every law of feed override does on the same stepped bar, undisturbed: depth of cut above, commanded override and "
        "spindle load below, with the load's highest value.",
        draw,
        checks,
        "The curves of the paper's own bar are lost; what its text says is compared. Nothing is printed of the other laws.",
    ),
)

"""Draw every figure of the papers with the project's own models and controllers.

    python -m research.papers.figures
    python -m research.papers.figures --only grid_search_03 grid_search_12 --format svg

Without --only it also writes an index, README.md, with captions and comparisons with the papers.
With --only it prints the captions and comparisons of the figures that it draws. All figures take
about a minute.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path

from matplotlib.figure import Figure
from tqdm import tqdm

from research.papers.catalogue import FIGURES, PAPERS, Paper
from research.papers.figures import blanks, fuzzy, life, minutes, override, roughness, servo
from turning_env.console import described, exits
from turning_env.files import write_file
from turning_env.rendering import plot_style as style

DRAW: dict[str, Callable[[], Figure]] = {
    "grid_search_02": partial(minutes.draw_best, 1),
    "grid_search_03": partial(minutes.draw_plane, 1),
    "grid_search_04": partial(minutes.draw_best, 2),
    "grid_search_06": partial(minutes.draw_plane, 2),
    "grid_search_07": partial(minutes.draw_plane, 14),
    "grid_search_08": partial(minutes.draw_best, 14),
    "grid_search_09": partial(minutes.draw_best, 15),
    "grid_search_10": partial(minutes.draw_plane, 15),
    "grid_search_11": life.draw_responses,
    "grid_search_12": life.draw_pairs,
    "grid_search_13": life.draw_rivals,
    "fuzzy_01": fuzzy.draw_correction,
    "fuzzy_02": fuzzy.draw_aggregation,
    "fuzzy_03": fuzzy.draw_override,
    "fuzzy_06": fuzzy.draw_conjunction,
    "override_steps": override.draw,
    "roughness_control": roughness.draw_control,
    "part_programming_psi": blanks.draw_gains,
    "part_programming_pairs": blanks.draw_pairs,
    "servo_current": servo.draw_current,
    "servo_estimate": servo.draw_estimate,
}
"""Functions that draw the figures of ``data/figures.toml``, to be called in ``style.for_print``."""
INDEX = "README.md"
HEAD = """# Figures of the papers

`python -m research.papers.figures` writes this page and draws every figure with the project's own models and controllers. Open circles
are values that a paper prints or states.

The copies of the papers used lack their figures. Captions, tables and text say what each figure showed. The lines below each
figure count these numbers and claims by [verdict](../papers.md). `python -m research.papers.reproduce` lists every comparison.
"""  # noqa: E501, the page's text, wrapped as in docs


all_checks = cache(Paper.checks)  # several figures of a paper need them, and they take a while


@exits(ValueError, interrupted="interrupted: the figures drawn so far are complete")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m research.papers.figures", **described(__doc__))
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("docs/figures"),
        metavar="FOLDER",
        help="folder to write to (default: %(default)s)",
    )
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        help=f"figures to draw, from {', '.join(FIGURES)} (default: all)",
    )
    parser.add_argument(
        "--format",
        nargs="+",
        choices=style.FORMATS,
        default=["png"],
        help="file formats (default: png)",
    )
    options = parser.parse_args(arguments)
    wanted = options.only or list(FIGURES)
    unknown = [name for name in wanted if name not in FIGURES]
    if unknown:
        raise ValueError(f"there is no figure {', '.join(unknown)}; there are {', '.join(FIGURES)}")
    chosen = [name for name in FIGURES if name in wanted]

    bar = tqdm(chosen, unit="figure", disable=None)
    for name in bar:
        bar.set_postfix_str(name)
        with style.for_print():
            drawn = DRAW[name]()
            for kind in options.format:
                style.save(drawn, options.out / f"{name}.{kind}")

    descriptions = {name: description(name) for name in chosen}
    if options.only is None:
        text = index(descriptions, options.format)
        write_file(options.out / INDEX, text)
        print(options.out / INDEX)
    else:
        for name, lines in descriptions.items():
            print(name, *lines, sep="\n  ")
    return 0


def description(name: str) -> list[str]:
    """Return the lines below a figure: its caption, and whether the paper's claims agree.

    Raises:
        KeyError: No item of a paper has this figure.
    """
    for paper in PAPERS:
        for item in paper.items:
            if item.figure == name:
                checks = all_checks(paper) if item.pattern else []
                return item.description(checks)
    raise KeyError(name)


def index(descriptions: Mapping[str, Sequence[str]], formats: Sequence[str]) -> str:
    """Return a page that shows figures, whose files lie beside it.

    Args:
        descriptions: lines below each figure, by its name.
        formats: file formats; the page shows the first.
    """
    text = HEAD
    for name, (caption, *lines) in descriptions.items():
        image = f"![{name}]({name}.{formats[0]})"
        text += f"\n## {name}\n\n{image}\n\n{caption}\n"
        if lines:
            text += "\n"
        for line in lines:
            text += f"* {line}\n"
    return text


if __name__ == "__main__":
    sys.exit(main())

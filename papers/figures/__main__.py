"""Draw every figure of the papers with the project's own models and controllers.

    python -m papers.figures
    python -m papers.figures --only grid_search_03 grid_search_12 --format svg --out build/figures

Without --only it also writes an index, README.md, with captions and comparisons with the papers. With --only it prints the
captions and comparisons of the figures that it draws. All figures take about a minute.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from tqdm import tqdm

from papers.figures import blanks, life, minutes, override, roughness, servo
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_render import plot_style as style

_GRID_SEARCH = sorted((*minutes.FIGURES, *life.FIGURES), key=lambda figure: figure.name)
FIGURES = {
    figure.name: figure for figure in (*_GRID_SEARCH, *override.FIGURES, *roughness.FIGURES, *blanks.FIGURES, *servo.FIGURES)
}
"""All figures by name, in the order of the index. Add a figure to its group's file."""
INDEX = "README.md"
HEAD = """# Figures of the papers

`python -m papers.figures` writes this page and draws every figure with the project's own models and controllers. Open circles
are values that a paper prints or states.

The copies of the papers used lack their figures. Captions, tables and text say what each figure showed. The lines below each
figure count how many of these numbers and claims agree. `python -m papers.reproduce` lists every comparison.
"""


@exits(ValueError, interrupted="interrupted: the figures drawn so far are complete")
def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m papers.figures", **described(__doc__))
    parser.add_argument(
        "--out", type=Path, default=Path("docs/figures"), metavar="FOLDER", help="folder to write to (default: %(default)s)"
    )
    parser.add_argument("--only", nargs="+", metavar="NAME", help=f"figures to draw, from {', '.join(FIGURES)} (default: all)")
    parser.add_argument("--format", nargs="+", choices=style.FORMATS, default=["png"], help="file formats (default: png)")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.only or () if name not in FIGURES]:
        raise ValueError(f"there is no figure {', '.join(unknown)}; there are {', '.join(FIGURES)}")
    described_figures = {}
    for name in (bar := tqdm([name for name in FIGURES if name in (options.only or FIGURES)], unit="figure", disable=None)):
        bar.set_postfix_str(name)
        with style.for_print():
            drawn = FIGURES[name].draw()
            for kind in options.format:
                style.save(drawn, options.out / f"{name}.{kind}")
        described_figures[name] = FIGURES[name].description()
    if options.only is None:
        text = index(described_figures, options.format)
        replace_file(options.out / INDEX, lambda partial: partial.write_text(text, encoding="utf-8"))
        print(options.out / INDEX)
    else:
        for name, lines in described_figures.items():
            print(name, *lines, sep="\n  ")
    return 0


def index(descriptions: Mapping[str, Sequence[str]], formats: Sequence[str]) -> str:
    """Return a page that shows figures, by name and description, whose files in these formats lie beside it."""
    shown = [kind for kind in style.FORMATS if kind in formats]
    text = HEAD
    for name, (caption, *lines) in descriptions.items():
        files = [f"{name}.{kind}" for kind in shown]
        picture = f"[{files[0]}]({files[0]})" if shown == ["pdf"] else f"![{name}]({files[0]})"
        text += f"\n## {name}\n\n{picture}\n\n{caption}\n"
        if lines:
            text += "\n" + "".join(f"* {line}\n" for line in lines)
        if len(files) > 1:
            text += "\nAlso as " + ", ".join(f"[{file}]({file})" for file in files[1:]) + ".\n"
    return text


if __name__ == "__main__":
    sys.exit(main())

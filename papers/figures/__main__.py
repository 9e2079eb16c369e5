"""Draws every figure of the papers anew, from what the project's own models and controllers do.

    python -m papers.figures
    python -m papers.figures --only grid_search_03 grid_search_12 --format svg --out build/figures

Without --only it also writes an index, README.md, with the captions and with what agrees with the papers; with it, that is
printed for the figures drawn. Takes about a minute.
"""

import argparse
import sys
from pathlib import Path

from tqdm import tqdm

from papers.figures import index
from papers.figures.catalogue import PLATES, chosen
from turning_env.console import described, exits
from turning_env.workshop import plot_style as style


@exits(ValueError, interrupted="interrupted: figures that were drawn are whole")
def main(arguments: list[str] | None = None) -> int:
    """Command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m papers.figures", **described(__doc__))
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), metavar="FOLDER", help="default: %(default)s")
    parser.add_argument("--only", nargs="+", metavar="NAME", help=f"figures to draw, of {', '.join(PLATES)} (default: all)")
    parser.add_argument("--format", nargs="+", choices=style.FORMATS, default=["png"], help="default: png")
    parsed = parser.parse_args(arguments)
    out: Path = parsed.out
    plates, said = chosen(parsed.only), {}
    for plate in (bar := tqdm(plates, unit="figure", disable=None)):
        bar.set_postfix_str(plate.name)
        with style.for_print():
            figure = plate.draw()
            for kind in parsed.format:
                style.save(figure, out / f"{plate.name}.{kind}")
        said[plate.name] = index.described(plate)
    if parsed.only is None:
        print(index.write(said, parsed.format, out))
    else:
        for name, lines in said.items():
            print(name, *lines, sep="\n  ")
    return 0


if __name__ == "__main__":
    sys.exit(main())

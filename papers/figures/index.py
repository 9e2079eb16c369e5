"""The page that shows all figures, with what is said of each."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from papers.figures.plate import Plate
from turning_env.files import replace_file
from turning_env.workshop.plot_style import FORMATS

NAME = "README.md"
HEAD = """# Figures of the papers

Written by `python -m papers.figures`, which computes every figure anew from the project's own models and controllers. Open
circles are what a paper prints or states. The copies of the papers used lack their figures: captions, tables and text say what
each showed, and what they say is compared and counted below. `python -m papers.reproduce` lists every comparison of numbers.
"""


def described(plate: Plate) -> list[str]:
    """What is said of a figure: caption with its source, and what agrees."""
    return [f"{plate.caption} ({plate.source}.)", *plate.agreement()]


def page(said: Mapping[str, Sequence[str]], formats: Sequence[str]) -> str:
    """The page's text, of what is said of each figure by its name, for figures in these formats beside it."""
    shown = [kind for kind in FORMATS if kind in formats]
    text = HEAD
    for name, (caption, *lines) in said.items():
        files = [f"{name}.{kind}" for kind in shown]
        picture = f"[{files[0]}]({files[0]})" if shown == ["pdf"] else f"![{name}]({files[0]})"
        text += f"\n## {name}\n\n{picture}\n\n{caption}\n"
        if lines:
            text += "\n" + "".join(f"* {line}\n" for line in lines)
        if len(files) > 1:
            text += "\nAlso as " + ", ".join(f"[{file}]({file})" for file in files[1:]) + ".\n"
    return text


def write(said: Mapping[str, Sequence[str]], formats: Sequence[str], folder: Path) -> Path:
    """Write the page, whole or not at all; returns its path.

    Raises:
        OSError: it cannot be written.
    """
    path, text = folder / NAME, page(said, formats)
    replace_file(path, lambda partial: partial.write_text(text, encoding="utf-8"))
    return path

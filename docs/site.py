"""A hook of MkDocs.

It generates pages from the code, and adds pages of the repository's root and of shop/docs.
"""

import html
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import griffe
import gymnasium
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import turning_env
from leaderboard import page
from leaderboard.ranking import Leaderboard, read_leaderboards
from leaderboard.table import VERDICTS
from turning_env.physics.quantities import INFO, OBSERVATION, layout

ROOT = Path(__file__).parents[1]
LEADERBOARD = "leaderboard-page.html"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for path, text in pages().items():
        files.append(File.generated(config, path, content=text))
    for source in sorted((ROOT / "shop" / "docs").iterdir()):
        files.append(File.generated(config, f"shop/{source.name}", abs_src_path=str(source)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Adapt links between docs/ and shop/docs/, as the latter is the folder shop/ of the site."""
    if page.file.src_uri.startswith("shop/"):
        return markdown.replace("](../../docs/", "](../")
    return re.sub(r"\]\(\.\./((?:\.\./)*)shop/docs/", r"](\1shop/", markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Link every picture to its file, which a phone can enlarge."""
    return re.sub(r'<img [^>]*\bsrc="([^"]+)"[^>]*>', r'<a href="\1">\g<0></a>', content)


def pages() -> dict[str, str]:
    """Return the text of all generated pages by path."""
    leaderboards = read_leaderboards(ROOT / "leaderboard" / "results", {})
    others = [
        _specification(env_id, 2) for env_id in turning_env.IDS if env_id != "RoughTurning-v0"
    ]
    return {
        "index.md": _from_root("README.md"),
        "contributing.md": _from_root("CONTRIBUTING.md"),
        "changelog.md": _from_root("CHANGELOG.md"),
        "cite.md": f"# How to cite\n\n```yaml\n{(ROOT / 'CITATION.cff').read_text('utf-8')}```\n",
        "environment.md": _specification("RoughTurning-v0"),
        "tasks.md": "\n".join(["# The other tasks\n", *others]),
        "scenario.md": "\n".join(_scenario()),
        "leaderboard.md": "\n".join(_leaderboard(leaderboards)),
        LEADERBOARD: page.render(leaderboards),
    }


def _from_root(name: str) -> str:
    """Return a page of the repository's root with links relative to docs.

    Links to files outside the site become text.
    """
    text = (ROOT / name).read_text("utf-8")
    text = re.sub(r"\]\((?:docs/|(shop/)docs/)([^)]*)\)", r"](\1\2)", text)
    text = text.replace("](CONTRIBUTING.md)", "](contributing.md)")
    text = text.replace("](CHANGELOG.md)", "](changelog.md)")
    text = text.replace("](README.md)", "](index.md)")
    outside = r"(?<!!)\[([^\]]*)\]\((?![a-z_/]*\.md|https?:|#|tutorials/|papers/)[^)]*\)"
    return re.sub(outside, r"\1", text)


def _specification(env_id: str, level: int = 1) -> str:
    """Return the docstring of an id's class under a heading, with the tables that it lacks."""
    entry_point = gymnasium.spec(env_id).entry_point
    assert isinstance(entry_point, str)
    module, name = entry_point.split(":")
    text = inspect.getdoc(getattr(__import__(module, fromlist=[name]), name)) or ""
    names = layout(turning_env.Scenario.load(turning_env.IDS[env_id]))
    if level == 1:  # all ids have the same info
        text += "\n\n## Table of info\n\n| Name | Unit | Meaning |\n|---|---|---|"
        for quantity in INFO:
            text += f"\n| `{quantity.name}` | {quantity.unit} | {quantity.meaning} |"
    elif len(names) != len(layout(turning_env.Scenario())):
        text += "\n\n## Table of the observation\n\n| Index | Entry | Meaning | Range |"
        text += "\n|---|---|---|---|"
        entries = {quantity.name: quantity for quantity in OBSERVATION}
        for index, name in enumerate(names):
            entry = entries[name]
            text += f"\n| {index} | {name} | {entry.meaning} | {entry.low:g} to {entry.high:g} |"
    text = re.sub(r"^##(?= )", "#" * (level + 1), text, flags=re.MULTILINE)
    return f"{'#' * level} {env_id}\n\n{text}\n"


def _scenario() -> Iterator[str]:
    yield "# Scenario files\n"
    yield "A scenario defines an episode except for its [seed](glossary.md#seed). A TOML file"
    yield 'states its differences from the defaults or, with `base = "PRESET"`, from a preset.'
    yield "Unknown keys are refused."
    yield "`python -m turning_env schema` prints the tables below as JSON.\n"
    schema = turning_env.Scenario.model_json_schema()
    sections = griffe.load("turning_env.scenario.sections")
    for key, value in schema["properties"].items():
        if "$ref" not in value:
            continue
        class_name = value["$ref"].rpartition("/")[2]
        section = schema["$defs"][class_name]
        source = sections[class_name]
        yield f"## {key}\n\n{section.get('description', '')}\n"
        yield "| Field | Default | Allowed | Meaning |\n|---|---|---|---|"
        for name, field in section["properties"].items():
            default = value.get("default", {}).get(name, field.get("default"))
            meaning = field.get("description", "")
            docstring = source[name].docstring
            if not meaning and docstring:  # it describes a field without a quantity
                meaning = " ".join(docstring.value.split())
            shown = html.escape(meaning, quote=False)
            yield f"| `{name}` | {_shown(default)} | {_allowed(field)} | {shown} |"
        yield ""
    yield "## Presets\n\n| Name | Description |\n|---|---|"
    folder = Path(turning_env.__path__[0]) / "scenario" / "presets"
    for preset in turning_env.presets():
        # A preset's file begins with a comment that describes it.
        comment = []
        for line in (folder / f"{preset}.toml").read_text("utf-8").splitlines():
            if not line.startswith("#"):
                break
            comment.append(line.removeprefix("#").strip())
        yield f"| `{preset}` | {html.escape(' '.join(comment), quote=False)} |"


def _shown(default: Any) -> str:
    if isinstance(default, dict):
        return ", ".join(f"{name} {value:g}" for name, value in default.items() if value)
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"


def _allowed(field: dict[str, Any]) -> str:
    if "enum" in field:
        return ", ".join(f"`{value}`" for value in field["enum"])
    return (
        f"{field['minimum']:g} to {field['maximum']:g}"
        if "minimum" in field and "maximum" in field
        else ""
    )


def _leaderboard(leaderboards: list[Leaderboard]) -> Iterator[str]:
    yield "# Leaderboard\n"
    yield "Each table lists the five best [policies](glossary.md#policy) on a task."
    yield f"[The full leaderboard]({LEADERBOARD}) adds"
    yield "confidence intervals, limits, splits and trajectories.\n"
    for leaderboard in leaderboards:
        if leaderboard.task.scenario.name in turning_env.SPLITS:
            continue
        yield f"## {leaderboard.task.env_id}\n"
        yield "| Policy | Return [s], 95 % interval | Feasible |\n|---|---|---|"
        for standing in leaderboard.standings[:5]:
            mean = standing.mean_return
            feasible = VERDICTS[standing.feasibility].lower()
            interval = f"{mean.value:.1f} ({mean.low:.1f} to {mean.high:.1f})"
            yield f"| `{standing.name}` | {interval} | {feasible} |"
        yield ""

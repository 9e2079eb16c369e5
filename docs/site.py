"""A hook of MkDocs: it generates pages from the code, and adds the repository's root and shop/docs to the site."""

import html
import inspect
import re
import tomllib
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
    """Let links between docs/ and shop/docs/ lead to the pages of the site, where shop/ is a folder of docs/."""
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
    """Return a page of the repository's root with links relative to docs; links to files outside the site become text."""
    text = (ROOT / name).read_text("utf-8")
    text = re.sub(r"\]\((?:docs/|(shop/)docs/)([^)]*)\)", r"](\1\2)", text)
    for root, site in {
        "CONTRIBUTING.md": "contributing.md",
        "CHANGELOG.md": "changelog.md",
        "README.md": "index.md",
    }.items():
        text = text.replace(f"]({root})", f"]({site})")
    return re.sub(
        r"(?<!!)\[([^\]]*)\]\((?![a-z_/]*\.md|https?:|#|tutorials/|papers/)[^)]*\)", r"\1", text
    )


def _specification(env_id: str, level: int = 1) -> str:
    """Return the docstring of an id's class under a heading of a level, with the tables that it lacks."""
    entry_point = gymnasium.spec(env_id).entry_point
    assert isinstance(entry_point, str)
    module, name = entry_point.split(":")
    text = inspect.getdoc(getattr(__import__(module, fromlist=[name]), name)) or ""
    names = layout(turning_env.Scenario.load(turning_env.IDS[env_id]))
    if level == 1:  # all ids have the same info
        rows = "\n".join(f"| `{each.name}` | {each.unit} | {each.meaning} |" for each in INFO)
        text += f"\n\n## Table of info\n\n| Name | Unit | Meaning |\n|---|---|---|\n{rows}"
    elif len(names) != len(layout(turning_env.Scenario())):
        entries = [next(each for each in OBSERVATION if each.name == name) for name in names]
        rows = "\n".join(
            f"| {i} | {e.name} | {e.meaning} | {e.low:g} to {e.high:g} |"
            for i, e in enumerate(entries)
        )
        text += f"\n\n## Table of the observation\n\n| Index | Entry | Meaning | Range |\n|---|---|---|---|\n{rows}"
    return (
        f"{'#' * level} {env_id}\n\n"
        + re.sub(r"^##(?= )", "#" * (level + 1), text, flags=re.MULTILINE)
        + "\n"
    )


def _scenario() -> Iterator[str]:
    yield "# Scenario files\n"
    yield "A scenario defines an episode except for its [seed](glossary.md#seed). A TOML file states its differences from"
    yield 'the defaults or, with `base = "PRESET"`, from a preset. Unknown keys are refused.'
    yield "`python -m turning_env schema` prints the tables below as JSON.\n"
    schema, sections = (
        turning_env.Scenario.model_json_schema(),
        griffe.load("turning_env.scenario.sections"),
    )
    for key, value in schema["properties"].items():
        if "$ref" not in value:
            continue
        class_name = value["$ref"].rpartition("/")[2]
        section, source = schema["$defs"][class_name], sections[class_name]
        yield f"## {key}\n\n{section.get('description', '')}\n"
        yield "| Field | Default | Allowed | Meaning |\n|---|---|---|---|"
        for name, field in section["properties"].items():
            default = value.get("default", {}).get(name, field.get("default"))
            docstring = source[name].docstring  # describes a field without a quantity
            meaning = field.get("description") or (
                " ".join(docstring.value.split()) if docstring else ""
            )
            yield f"| `{name}` | {_shown(default)} | {_allowed(field)} | {html.escape(meaning, False)} |"
        yield ""
    yield "## Presets\n\n| Name | Description |\n|---|---|"
    for preset in turning_env.presets():
        text = (
            Path(turning_env.__path__[0]) / "scenario" / "presets" / f"{preset}.toml"
        ).read_text("utf-8")
        tomllib.loads(text)
        first = " ".join(
            line.removeprefix("#").strip() for line in re.match(r"(?:#.*\n)*", text)[0].splitlines()
        )  # type: ignore[index]
        yield f"| `{preset}` | {html.escape(first, False)} |"


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
    yield f"Each table lists the five best [policies](glossary.md#policy) on a task. [The full leaderboard]({LEADERBOARD}) adds"
    yield "confidence intervals, limits, splits and trajectories.\n"
    for leaderboard in leaderboards:
        if leaderboard.task.scenario.name in turning_env.SPLITS:
            continue
        yield f"## {leaderboard.task.env_id}\n\n| Policy | Return [s], 95 % interval | Feasible |\n|---|---|---|"
        for standing in leaderboard.standings[:5]:
            mean = standing.mean_return
            feasible = VERDICTS[standing.feasibility].lower()
            yield f"| `{standing.name}` | {mean.value:.1f} ({mean.low:.1f} to {mean.high:.1f}) | {feasible} |"
        yield ""

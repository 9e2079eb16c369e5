"""A hook of MkDocs: pages that are generated from the code and the results.

It also adds pages of the repository's root and of shop/docs. The other pages are in docs/, and
packaging/mkdocs.yml lists all.
"""

import html
import importlib
import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import griffe
import gymnasium
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import turning_env
from leaderboard import page
from leaderboard.ranking import read_leaderboards
from leaderboard.result import RESULTS
from turning_env.physics.quantities import INFO, OBSERVATION, layout

ROOT = Path(__file__).parents[1]
LEADERBOARD = "leaderboard-page.html"
WIDE = "---\nhide: [toc]\n---\n"
"""Begins a page whose table takes the place of its contents."""
MAIN_ID = "RoughTurning-v0"
"""The id that comes first on the page of the tasks."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the generated pages."""
    for path, text in pages().items():
        files.append(File.generated(config, path, content=text))
    for source in sorted((ROOT / "shop" / "docs").iterdir()):
        path = f"shop/{source.name}"
        files.append(File.generated(config, path, abs_src_path=str(source)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Add the fields of scenarios to their page, and adapt links that leave docs/.

    On the site, shop/docs/ is the folder shop/.
    """
    if page.file.src_uri == "scenario.md":
        markdown += "\n".join(_scenario())
    if page.file.src_uri.startswith("shop/"):
        markdown = markdown.replace("](../../docs/", "](../")
        return markdown.replace("](../README.md", "](index.md")
    to_root = r"\]\(\.\./((?:\.\./)*)"
    markdown = re.sub(to_root + r"README\.md", r"](\1index.md", markdown)
    markdown = re.sub(to_root + r"CONTRIBUTING\.md", r"](\1contributing.md", markdown)
    return re.sub(to_root + "shop/docs/", r"](\1shop/", markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Link every picture to its file, which a phone can enlarge, and mark cells of numbers."""
    picture = r'<img [^>]*\bsrc="([^"]+)"[^>]*>'
    content = re.sub(picture, r'<a href="\1">\g<0></a>', content)
    number = r"-?\d[\d.,]*(?: [kM%])?"
    interval = r"(?: \([^<]*\))?"
    return re.sub(f"<td([^>]*)>({number}{interval})</td>", r'<td class="number"\1>\2</td>', content)


def pages() -> dict[str, str]:
    """Return the text of all generated pages by path."""
    return {
        "index.md": WIDE + _from_root("README.md") + _citation(),
        "shop/index.md": _shop(),
        "contributing.md": _from_root("CONTRIBUTING.md"),
        "environment.md": _tasks(),
        LEADERBOARD: page.render(read_leaderboards(RESULTS)),
    }


def _citation() -> str:
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    return f"\n## How to cite\n\n```yaml\n{citation}```\n"


def _tasks() -> str:
    """Return the specifications of all ids, that of the main id first."""
    sections = [_specification(MAIN_ID)]
    for env_id in turning_env.IDS:
        if env_id != MAIN_ID:
            sections.append(_specification(env_id, level=2))
    return "\n".join(sections)


def _from_root(name: str) -> str:
    """Return a page of the repository's root with links relative to docs.

    Links to files outside the site become text.
    """
    text = (ROOT / name).read_text("utf-8")
    to_docs = r"\]\((?:docs/|(shop/)docs/)([^)]*)\)"
    text = re.sub(to_docs, r"](\1\2)", text)
    text = text.replace("](CONTRIBUTING.md)", "](contributing.md)")
    text = text.replace("](shop/README.md)", "](shop/index.md)")
    text = text.replace("](CITATION.cff)", "](#how-to-cite)")
    text = text.replace("](README.md)", "](index.md)")
    # Of a link that leads to no page, anchor or other site, only the text stays.
    outside = r"(?<!!)\[([^\]]*)\]\((?![a-z_/]*\.md|https?:|#|tutorials/)[^)]*\)"
    return re.sub(outside, r"\1", text)


def _shop() -> str:
    """Return the shop's README with links relative to the folder shop/ of the site."""
    text = (ROOT / "shop" / "README.md").read_text("utf-8")
    text = text.replace("](docs/", "](")
    return text.replace("](../README.md)", "](../index.md)")


def _specification(env_id: str, level: int = 1) -> str:
    """Return the docstring of an id's class under a heading, with the table that it lacks."""
    text = inspect.getdoc(_class_of(env_id)) or ""
    scenario = turning_env.Scenario.load(turning_env.IDS[env_id])
    names = layout(scenario)
    num_known = len(layout(turning_env.Scenario()))
    if level == 1:
        # All ids have the same info. The table says more than the docstring.
        table = "\n".join(_info_table())
        section = re.compile(r"^## Info\n.*?(?=^## )", re.MULTILINE | re.DOTALL)
        text = section.sub(table, text)
    elif len(names) > num_known:
        table = "\n".join(_further_entries(names, num_known))
        text = f"{text}\n\n{table}"
    # The docstring's headings are one level below that of the id.
    mark = "#" * level
    text = re.sub(r"^##(?= )", f"{mark}#", text, flags=re.MULTILINE)
    return f"{mark} {env_id}\n\n{text}\n"


def _class_of(env_id: str) -> Any:
    entry_point = gymnasium.spec(env_id).entry_point
    assert isinstance(entry_point, str)
    module, name = entry_point.split(":")
    return getattr(importlib.import_module(module), name)


def _info_table() -> Iterator[str]:
    yield "## Info\n"
    yield "| Name | Unit | Meaning |"
    yield "|---|---|---|"
    for quantity in INFO:
        yield f"| `{quantity.name}` | {quantity.unit} | {quantity.meaning} |"
    yield "\n"


def _further_entries(names: Sequence[str], num_known: int) -> Iterator[str]:
    """Yield the table of the entries that follow the first ones, which all ids have."""
    yield "| Index | Further entry of the observation | Meaning | Range |"
    yield "|---|---|---|---|"
    entries = {entry.name: entry for entry in OBSERVATION}
    for index, name in enumerate(names[num_known:], start=num_known):
        entry = entries[name]
        allowed = f"{entry.low:g} to {entry.high:g}"
        yield f"| {index} | {name} | {entry.meaning} | {allowed} |"


def _scenario() -> Iterator[str]:
    yield "\nThe tables below have all fields. A star marks an assumption.\n"
    schema = turning_env.Scenario.model_json_schema()
    sections = griffe.load("turning_env.scenario.sections")
    for key, value in schema["properties"].items():
        # A property without a reference is a single value, such as the name.
        if "$ref" in value:
            class_name = value["$ref"].rpartition("/")[2]
            section = schema["$defs"][class_name]
            description = section.get("description", "")
            defaults = value.get("default", {})
            yield f"## {key}\n\n{description}\n"
            yield from _fields_table(section, defaults, sections[class_name])
            yield ""
    yield from _presets_table()


def _fields_table(
    section: Mapping[str, Any], defaults: Mapping[str, Any], source: griffe.Class
) -> Iterator[str]:
    """Yield the table of a section's fields.

    Args:
        section: its JSON schema.
        defaults: values of a new scenario that differ from those of the section's class.
        source: its class as it is in the source, where fields may have docstrings.
    """
    yield "| Field | Default | Allowed | Meaning |"
    yield "|---|---|---|---|"
    for name, field in section["properties"].items():
        default = defaults.get(name, field.get("default"))
        meaning = field.get("description", "")
        docstring = source[name].docstring
        # A docstring describes a field that is no quantity.
        if not meaning and docstring:
            meaning = docstring.value
        # A row of a table is one line.
        meaning = html.escape(" ".join(meaning.split()), quote=False)
        cells = (
            f"`{name}`",
            _shown(default),
            _allowed(field),
            meaning.replace(" (assumption)", " *"),
        )
        yield f"| {' | '.join(cells)} |"


def _presets_table() -> Iterator[str]:
    yield "## Presets\n"
    yield "The files in `turning_env/scenario/presets/` have sources and assumptions.\n"
    yield "| Name | Description |"
    yield "|---|---|"
    package = Path(turning_env.__path__[0])
    folder = package / "scenario" / "presets"
    for preset in turning_env.presets():
        description = _first_sentence(folder / f"{preset}.toml")
        # Sources stand in brackets.
        description = re.sub(r" \([^()]*\)", "", description)
        shown = html.escape(description, quote=False)
        yield f"| `{preset}` | {shown} |"


def _first_sentence(path: Path) -> str:
    """Return the first sentence of the comment at the beginning of a preset's file."""
    comment = []
    for line in path.read_text("utf-8").splitlines():
        if not line.startswith("#"):
            break
        comment.append(line.removeprefix("#").strip())
    end_of_sentence = r"(?<=\.) (?=[A-Z\"\[*])"
    sentences = re.split(end_of_sentence, " ".join(comment), maxsplit=1)
    return sentences[0]


def _shown(default: Any) -> str:
    """Return the text of a default, of a table its values other than 0."""
    if isinstance(default, dict):
        shown = [f"{name} {value:g}" for name, value in default.items() if value]
        return ", ".join(shown)
    if isinstance(default, float):
        return f"`{default:g}`"
    return f"`{default}`"


def _allowed(field: Mapping[str, Any]) -> str:
    """Return the text of the allowed values of a field, empty if there are no limits."""
    if "enum" in field:
        values = [f"`{value}`" for value in field["enum"]]
        return ", ".join(values)
    if "minimum" in field and "maximum" in field:
        low = field["minimum"]
        high = field["maximum"]
        return f"{low:g} to {high:g}"
    return ""

"""Links of the shop's README and documentation lead to a file, and to a heading in it."""

import importlib.util
import re
from pathlib import Path
from typing import Any, NamedTuple

import pytest

SHOP = Path(__file__).parents[1]
PAGES = [SHOP / "README.md", *sorted((SHOP / "docs").glob("*.md"))]


class Link(NamedTuple):
    """A relative link."""

    path: str  # from the page's folder; empty for the page itself
    heading: str  # slug of the heading; empty for the top of the page


def links(page: Path) -> list[Link]:
    """Return the relative links of a page."""
    relative = []
    for target in re.findall(r"\]\((?!\w+:)([^)\s]+)\)", page.read_text("utf-8")):
        path, _, heading = target.partition("#")
        relative.append(Link(path, heading))
    return relative


def headings(page: Path) -> set[str]:
    """Return the slugs of a page's headings."""
    # A line with "#" in a block of code is a comment.
    text = re.sub(
        r"^```.*?^```$",
        "",
        page.read_text("utf-8"),
        flags=re.DOTALL | re.MULTILINE,
    )
    slugs = set()
    for title in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        words = re.sub(r"[^\w\s-]", "", title.lower())
        slugs.add(re.sub(r"\s+", "-", words.strip()))
    return slugs


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    targets = links(page)
    assert targets
    for link in targets:
        path = page.parent / link.path if link.path else page
        assert path.exists(), link
        if link.heading:
            assert link.heading in headings(path), link


def test_links_of_the_package_lead_into_the_repository() -> None:
    spec = importlib.util.spec_from_file_location("hatch_build", SHOP / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    metadata: dict[str, Any] = {"version": "1.2.3"}
    hook = module.Links(str(SHOP), {"repository": "https://example.org/lathe/"})
    hook.update(metadata)

    targets = re.findall(r"\]\(([^)#]+)[^)]*\)", metadata["readme"]["text"])
    assert len(targets) == len(links(SHOP / "README.md"))
    for target in targets:
        path = target.removeprefix("https://example.org/lathe/blob/v1.2.3/")
        assert (SHOP.parent / path).is_file(), target

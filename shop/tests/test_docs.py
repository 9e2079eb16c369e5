"""Relative links of the shop's README and documentation lead to a file, and to a heading in it."""

import re
from pathlib import Path
from typing import NamedTuple

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
    text = re.sub(r"^```.*?^```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
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

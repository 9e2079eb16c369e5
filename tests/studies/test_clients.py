"""The command that tries recipes of other libraries, and its table."""

import pytest

from studies.clients import CLIENTS, ROOT, with_row


def test_every_client_has_a_recipe_and_a_row() -> None:
    text = (ROOT / "docs" / "ecosystem.md").read_text("utf-8")
    for library, client in CLIENTS.items():
        assert (ROOT / "examples" / f"{client.recipe}.py").exists()
        assert "| new |" in with_row(text, library, "| new |")
    with pytest.raises(ValueError, match="one table row"):
        with_row(text, "nothing", "")

"""The command that tries recipes of other libraries: its table, and what it says of failures."""

import subprocess
from pathlib import Path
from typing import Any

import pytest

from studies import clients
from studies.clients import CLIENTS, ROOT, attempt, main, with_row


def test_every_client_has_a_recipe_and_a_row() -> None:
    text = (ROOT / "docs" / "ecosystem.md").read_text("utf-8")
    for library, client in CLIENTS.items():
        assert (ROOT / "examples" / f"{client.recipe}.py").exists()
        assert "| new |" in with_row(text, library, "| new |")
    with pytest.raises(ValueError, match="one table row"):
        with_row(text, "nothing", "")


@pytest.mark.parametrize(
    ("stage", "error", "said"),
    [
        ("install", subprocess.CalledProcessError(1, "uv"), "the installation ended with status 1"),
        ("examples.skrl_ppo", subprocess.TimeoutExpired("skrl", 900.0), "the recipe took more than 900 s"),
        ("nothing", ValueError(), None),
    ],
)
def test_failures_are_told_apart(
    stage: str, error: Exception, said: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(command: list[Any], **_: Any) -> subprocess.CompletedProcess[bytes]:
        if stage in command:
            raise error
        return subprocess.CompletedProcess(command, 0, b'["1.0", "1.4.0"]')

    monkeypatch.setattr(clients.subprocess, "run", run)
    version, _, fault = attempt(CLIENTS["skrl"], Path("wheel"), tmp_path)
    assert fault == said
    assert version == ("-" if stage == "install" else "1.0")
    assert (tmp_path / "examples" / "skrl_ppo.py").exists()


def test_rows_are_written_for_the_libraries_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "table.md"
    table.write_text("| skrl | old |\n| tianshou | old |\n", "utf-8")
    monkeypatch.setattr(clients, "built", lambda folder: folder / "wheel")
    monkeypatch.setattr(clients, "attempt", lambda *_: ("2.1", "1.4.0", "the recipe ended with status 1"))
    assert main(["skrl", "--write", str(table)]) == 1
    changed, kept = table.read_text("utf-8").splitlines()
    assert changed == capsys.readouterr().out.strip()
    assert changed.startswith("| skrl | 2.1 | 1.4.0 | fails: the recipe ended with status 1 | ")
    assert kept == "| tianshou | old |"
    assert main(["unknown"]) == 2

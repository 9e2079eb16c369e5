"""The targets of the Makefile, and their list."""

import re
import subprocess

from tests.walking import ROOT
from turning_env import ALL_IDS


def test_help_lists_every_target() -> None:
    text = (ROOT / "Makefile").read_text("utf-8")
    phony = re.search(r"^\.PHONY: (.*)$", text, re.MULTILINE)
    assert phony is not None
    run = subprocess.run(
        ["make", "--no-print-directory", "help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    listed = {line.split(" ", 1)[0] for line in run.stdout.splitlines()}
    assert listed == set(phony[1].split())


def test_results_are_played_on_every_id() -> None:
    run = subprocess.run(
        ["make", "--silent", "--eval=print: ; @echo $(ENVS)", "print"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert set(run.stdout.split()) == set(ALL_IDS), "ENVS of the Makefile must have every id"

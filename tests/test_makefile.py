"""The targets of the Makefile, and their list."""

import re
import subprocess

from tests.walking import ROOT


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

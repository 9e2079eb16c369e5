"""Messages for packages that are missing, or hidden by others."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from leaderboard.__main__ import main
from tests.extras import check_extra
from tests.test_constraints import PROJECT
from tests.walking import ROOT
from turning_env import extras

IMPORT = """
from turning_env.console import exits

@exits()
def use() -> int:
    from baselines.catalogue import RULES
    return len(RULES)

raise SystemExit(use())
"""


@pytest.mark.slow
def test_another_package_called_baselines_is_named(tmp_path: Path) -> None:
    other = tmp_path / "baselines"
    other.mkdir()
    (other / "__init__.py").touch()
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    run = subprocess.run(
        [sys.executable, "-c", IMPORT],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2, run.stderr
    assert f"error: {other} is another package called baselines" in run.stderr


@pytest.mark.parametrize(
    "extra", ["benchmark", "distributed", "publish", "render", "sb3", "onnx", "ecosystem"]
)
def test_a_missing_package_of_an_extra_is_explained(
    extra: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Other distributions may have added their tables.
    monkeypatch.setattr(extras, "TABLES", [extras.EXTRAS])
    check_extra(PROJECT, extra)


def test_help_on_the_commands_of_the_wheel_needs_no_package_of_a_clone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "leaderboard.commands", None)
    with pytest.raises(SystemExit) as ending:
        main(["--help"])
    assert ending.value.code == 0
    printed = capsys.readouterr().out
    assert "score" in printed
    assert "pip install -e '.[benchmark]'" in printed
    with pytest.raises(ModuleNotFoundError):
        main(["run"])

"""Messages for packages that are missing, or hidden by others."""

import os
import subprocess
import sys
from pathlib import Path

from tests.walking import ROOT

IMPORT = """
from turning_env.console import exits

@exits()
def use() -> int:
    from baselines.catalogue import RULES
    return len(RULES)

raise SystemExit(use())
"""


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

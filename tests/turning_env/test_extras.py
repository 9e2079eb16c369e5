"""Messages for packages that are missing, or hidden by others."""

import os
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import pytest

from tests.test_constraints import PROJECT, SHOP, distribution_of
from tests.walking import ROOT
from turning_env.extras import missing

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


@pytest.fixture(scope="module")
def modules() -> dict[str, list[str]]:
    """Import names of the installed distributions."""
    names: dict[str, list[str]] = {}
    for module, distributions in packages_distributions().items():
        for distribution in distributions:
            names.setdefault(distribution.lower().replace("_", "-"), []).append(module)
    return names


@pytest.mark.parametrize(
    ("project", "extra"),
    [
        *((PROJECT, extra) for extra in ("benchmark", "distributed", "publish")),
        *((PROJECT, extra) for extra in ("render", "sb3", "onnx", "ecosystem")),
        *((SHOP, extra) for extra in ("programs", "opcua", "xlsx", "onnx")),
    ],
)
def test_a_missing_package_of_an_extra_is_explained(
    project: dict[str, Any], extra: str, modules: dict[str, list[str]]
) -> None:
    extras = project["project"]["optional-dependencies"]
    for need in extras[extra]:
        # Some distributions bring private modules beside the one that is imported.
        messages = [
            missing(ModuleNotFoundError(name=module)) for module in modules[distribution_of(need)]
        ]
        texts = [text for text in messages if text is not None]
        assert texts, need
        # The message may name another extra or distribution that brings the package.
        needs = {name: extras[name] for name in extras if f"[{name}]" in texts[0]}
        if texts[0].endswith(" rough-turning-shop"):
            needs["rough-turning-shop"] = SHOP["project"]["dependencies"]
        bringing = {distribution_of(other) for some in needs.values() for other in some}
        assert distribution_of(need) in bringing, texts[0]

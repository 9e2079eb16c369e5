import shutil
from pathlib import Path

import pytest

import baselines
import turning_env
from baselines.code import code_digest


def test_the_code_is_that_of_the_environment_and_of_the_rules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert code_digest() == code_digest.__wrapped__()  # and is kept, before anything is changed
    digests = [code_digest.__wrapped__()]
    for package in (turning_env, baselines):
        copy = tmp_path / package.__name__
        shutil.copytree(package.__path__[0], copy)
        (copy / "__init__.py").write_text("# changed\n")
        monkeypatch.setattr(package, "__path__", [str(copy)])
        digests.append(code_digest.__wrapped__())
    assert len(set(digests)) == 3
    assert code_digest() == digests[0]

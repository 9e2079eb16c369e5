from pathlib import Path

import pytest

from train import ppo
from train.agents import run_folder as agent


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--seed", "-1"], "--seed is -1, but must be 0 to 999"),
        (["--steps", "0"], "--steps is 0"),
        (["--env", "Pendulum-v1"], "RoughTurning-v0"),
    ],
)
def test_wrong_arguments_are_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        ppo.main(arguments)
    assert message in capsys.readouterr().err


def test_an_unknown_scenario_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ppo.main(["--scenario", "nowhere", "--runs", str(tmp_path)]) == 2
    assert "presets: " in capsys.readouterr().err


def test_any_id_can_be_trained(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--env", "RoughTurning-Paper-v0", "--steps", "100", "--runs", str(tmp_path)]
    assert ppo.main(arguments) == 0
    path = Path(capsys.readouterr().out.strip())
    assert path == tmp_path / "RoughTurning-Paper-v0" / "paper" / "ppo-seed0" / "policy.zip"
    assert agent.load(path.parent).command == "python -m train.ppo " + " ".join(arguments)

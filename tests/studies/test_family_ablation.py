"""Corrections are left out of an agent's file as the variant says, and the table compares variants job by job."""

from pathlib import Path

import numpy as np
import onnx
import pytest

from studies import family_ablation
from studies.family_ablation import CHANGE, FEED, SPEED, VARIANTS, returns_of, table, without_corrections
from tests.train import onnx_agents
from turning_env import Family


def weights_of(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    found = {tensor.name: onnx.numpy_helper.to_array(tensor) for tensor in onnx.load_model_from_string(content).graph.initializer}
    return found["head.weight"], found["head.bias"]


@pytest.mark.slow
def test_only_the_named_corrections_are_left_out(tmp_path: Path) -> None:
    content = onnx_agents.write_of_family(tmp_path, Family.load("shop")).read_bytes()
    before, bias = weights_of(content)
    after, left = weights_of(without_corrections(content, (SPEED, CHANGE)))
    assert not after[[SPEED, CHANGE]].any()
    assert not left[[SPEED, CHANGE]].any()
    np.testing.assert_array_equal(after[FEED], before[FEED])
    assert left[FEED] == bias[FEED]
    assert without_corrections(content, VARIANTS["as_it_is"].without) == onnx.load_model_from_string(content).SerializeToString(
        deterministic=True
    )


def test_an_agent_of_another_kind_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "ppo-seed0.onnx"
    path.write_bytes(onnx_agents.content())
    assert family_ablation.main(["--agent", str(path)]) != 0
    assert "no agent of train.family_gradient" in capsys.readouterr().err


def test_leads_are_over_the_first_variant_job_by_job() -> None:
    lines = table({"as_it_is": np.array([1.0, 2.0, 3.0, 4.0]), "untrained": np.array([2.0, 3.0, 4.0, 3.0])})
    assert lines[2] == "| the agent | 2 |  |  |  |"
    title, value, lead, median, better = (cell.strip() for cell in lines[3].strip("|").split("|"))
    assert (title, value, median, better) == (VARIANTS["untrained"].title, "3", "1.0", "75")
    assert lead.startswith("0 (") or lead.startswith("1 (")


@pytest.mark.slow
def test_a_variant_plays_the_jobs_it_is_told_truly(tmp_path: Path) -> None:
    agent = onnx_agents.write_of_family(tmp_path, Family.load("shop"))
    told, true = (returns_of(name, agent, 1) for name in ("as_it_is", "truth"))
    assert told.shape == true.shape == (1,)
    assert told[0] != true[0]

"""Several processes and a Dask cluster come to the same files as one process, also when one of theirs is killed."""

import math
import pickle
from collections.abc import Callable
from pathlib import Path

import cloudpickle
import pytest

from leaderboard import policies as leaderboard_policies
from leaderboard import run
from leaderboard.__main__ import main
from leaderboard.result import ResultError, Task, result_folder
from tests.dask_cluster import dask_cluster
from tests.leaderboard.conftest import ENV_ID, Deadly, Steady, on, spec
from tests.train import onnx_agents
from turning_env import IDS, Scenario
from turning_env.scoring import workers


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture
def runs(tmp_path: Path) -> Callable[[str], list[run.TaskRun]]:
    """Two tasks of what is there to play, the second with a policy that kills its process once."""
    scenario = onnx_agents.SCENARIO
    task = Task(env_id=ENV_ID, scenario=scenario, seeds=[7, 8, 9, 10])
    other = task.model_copy(update={"scenario": scenario.model_copy(update={"name": "other"}), "seeds": [1, 2, 3]})
    agents = [onnx_agents.write(tmp_path)]
    mark = tmp_path / "killed"

    def make(folder: str) -> list[run.TaskRun]:
        deadly = spec("deadly", make=lambda num_envs: Deadly(num_envs, mark))
        playing = [
            (
                task,
                [
                    leaderboard_policies.one_named("fixed_handbook", on(scenario)),
                    *leaderboard_policies.agents(agents, on(scenario)),
                ],
            ),
            (other, [deadly, spec("quick", (0.0, 1.0)), spec("slow")]),
        ]
        return [run.TaskRun(each, who, result_folder(tmp_path / folder, ENV_ID, each.scenario.name)) for each, who in playing]

    return make


@pytest.fixture
def expected(tmp_path: Path, runs: Callable[[str], list[run.TaskRun]]) -> dict[str, bytes]:
    """What one process writes."""
    (tmp_path / "killed").touch()
    run.play_all(runs("serial"), fresh=False)
    (tmp_path / "killed").unlink()
    written = files(tmp_path / "serial")
    assert len(written) == 9
    return written


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS)
def test_every_policy_can_be_sent_to_a_worker(env_id: str) -> None:
    scenario = Scenario.load(IDS[env_id])
    policies = leaderboard_policies.named(None, on(scenario))
    arrived = pickle.loads(cloudpickle.dumps(policies))
    assert [each.identity for each in arrived] == [each.identity for each in policies]
    assert all(each.compute or each.make(1).act for each in arrived)


@pytest.mark.slow
def test_processes_write_the_same(tmp_path: Path, runs: Callable[[str], list[run.TaskRun]], expected: dict[str, bytes]) -> None:
    (tmp_path / "killed").touch()
    with workers.workers(2, None) as over:
        run.play_all(runs("processes"), fresh=False, over=over)
    assert files(tmp_path / "processes") == expected


@pytest.mark.slow
def test_a_cluster_writes_the_same_though_a_worker_is_killed(
    tmp_path: Path,
    runs: Callable[[str], list[run.TaskRun]],
    expected: dict[str, bytes],
) -> None:
    with dask_cluster(tmp_path, workers=3) as cluster:
        with workers.workers(1, cluster.address) as over:
            run.play_all(runs("cluster"), fresh=False, over=over)
        assert files(tmp_path / "cluster") == expected
        assert sorted(worker.poll() is None for worker in cluster.workers) == [False, True, True]
        # A policy that cannot play is an error of its own, and the cluster remains.
        useless = spec("useless", make=lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
        with workers.workers(1, cluster.address) as over, pytest.raises(ResultError, match="useless cannot play"):
            run.play_all(
                [run.TaskRun(runs("cluster")[1].task, [useless], result_folder(tmp_path / "useless", ENV_ID, "other"))],
                fresh=False,
                over=over,
            )
        # The commands.
        arguments = ["--scheduler", cluster.address, "--policies", "fixed_handbook", "my_ppo"]
        results, agents = str(tmp_path / "results"), tmp_path / "agents"
        path = onnx_agents.write(result_folder(agents, ENV_ID, "short"))
        scenario = tmp_path / "short.toml"
        onnx_agents.SCENARIO.save(scenario)
        played = ["--seeds", "2", "--scenario", str(scenario), "--agents", str(path)]
        assert main(["run", *arguments[:-1], "--results", results, *played]) == 0
        verified = ["--results", results, "--agents", str(agents), "--memory", str(tmp_path / "verified.json")]
        assert main(["verify", *arguments, *verified]) == 0

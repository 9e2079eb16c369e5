"""Several processes and a Dask cluster come to the same files as one process, the cluster also when a worker is killed."""

import math
import pickle
from collections.abc import Callable
from pathlib import Path

import cloudpickle
import pytest

from leaderboard import policies, run
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
    """Two tasks for a folder of results, the second with a policy that kills its process once."""
    scenario, agents, mark = onnx_agents.SCENARIO, [onnx_agents.write(tmp_path)], tmp_path / "killed"
    task = Task(env_id=ENV_ID, scenario=scenario, seeds=[7, 8, 9, 10])
    other = task.model_copy(update={"scenario": scenario.model_copy(update={"name": "other"}), "seeds": [1, 2, 3]})
    shipped = [policies.one_named("fixed_handbook", task), *policies.agents(agents, task)]
    own = [spec("deadly", make=lambda num_envs: Deadly(num_envs, mark)), spec("quick", (0.0, 1.0)), spec("slow")]

    def make(folder: str) -> list[run.TaskRun]:
        return [
            run.TaskRun(each, who, result_folder(tmp_path / folder, ENV_ID, each.scenario.name))
            for each, who in ((task, shipped), (other, own))
        ]

    return make


@pytest.fixture
def expected(tmp_path: Path, runs: Callable[[str], list[run.TaskRun]]) -> dict[str, bytes]:
    """Return the files that one process writes."""
    (tmp_path / "killed").touch()
    run.play_all(runs("serial"), fresh=False)
    (tmp_path / "killed").unlink()
    written = files(tmp_path / "serial")
    assert len(written) == 9
    return written


@pytest.mark.slow
@pytest.mark.parametrize("env_id", IDS)
def test_every_policy_can_be_sent_to_a_worker(env_id: str) -> None:
    sent = policies.named(None, on(Scenario.load(IDS[env_id])))
    arrived = pickle.loads(cloudpickle.dumps(sent))
    assert [each.identity for each in arrived] == [each.identity for each in sent]
    assert all(each.compute or each.make(1).act for each in arrived)


@pytest.mark.slow
def test_processes_write_the_same_and_so_does_a_cluster_though_a_worker_is_killed(
    tmp_path: Path, runs: Callable[[str], list[run.TaskRun]], expected: dict[str, bytes]
) -> None:
    (tmp_path / "killed").touch()
    with workers.workers(2, None) as over:
        run.play_all(runs("processes"), fresh=False, over=over)
    assert files(tmp_path / "processes") == expected
    (tmp_path / "killed").unlink()
    with dask_cluster(tmp_path, workers=3) as cluster:
        with workers.workers(1, cluster.address) as over:
            run.play_all(runs("cluster"), fresh=False, over=over)
        assert files(tmp_path / "cluster") == expected
        assert sorted(worker.poll() is None for worker in cluster.workers) == [False, True, True]
        # A policy that cannot play is an error of its own, and the cluster remains.
        useless = spec("useless", make=lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
        failing = run.TaskRun(runs("cluster")[1].task, [useless], result_folder(tmp_path / "useless", ENV_ID, "other"))
        with workers.workers(1, cluster.address) as over, pytest.raises(ResultError, match="useless cannot play"):
            run.play_all([failing], fresh=False, over=over)
        # The commands.
        arguments = ["--scheduler", cluster.address, "--policies", "fixed_handbook"]
        results, agents = str(tmp_path / "results"), tmp_path / "agents"
        path = onnx_agents.write(result_folder(agents, ENV_ID, "short"))
        onnx_agents.SCENARIO.save(tmp_path / "short.toml")
        played = ["--seeds", "2", "--scenario", str(tmp_path / "short.toml"), "--agents", str(path)]
        assert main(["run", *arguments, "--results", results, *played]) == 0
        verified = ["--results", results, "--agents", str(agents), "--memory", str(tmp_path / "verified.json")]
        assert main(["verify", *arguments, "my_ppo", *verified]) == 0

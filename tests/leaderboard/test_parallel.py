"""Several processes and a Dask cluster come to the same files as one process."""

import math
from pathlib import Path

import pytest
from distributed import LocalCluster

from leaderboard import policies, run
from leaderboard.result import ResultError, Task, result_folder
from tests.leaderboard.conftest import ENV_ID, Steady, spec
from tests.train import onnx_agents
from turning_env.scoring import workers


def contents(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@pytest.mark.slow
def test_processes_and_a_cluster_write_the_same_as_one_process(tmp_path: Path) -> None:
    task = Task(env_id=ENV_ID, scenario=onnx_agents.SCENARIO, seeds=[7, 8, 9, 10])
    rule = policies.one_named("fixed_handbook", task)
    (agent,) = policies.agents([onnx_agents.write(tmp_path)], task)
    chosen = [rule, agent, spec("quick", (0.0, 1.0))]

    def play(name: str, over: workers.Workers | None) -> dict[str, bytes]:
        results = tmp_path / name
        folder = result_folder(results, ENV_ID, task.scenario.name)
        run.play_all([run.TaskRun(task, chosen, folder)], fresh=False, over=over)
        return contents(results)

    expected = play("serial", None)
    # Three results, the trajectories and the manifest.
    assert len(expected) == 5
    with workers.workers(2, None) as processes:
        assert play("processes", processes) == expected

    local = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")
    with local, workers.workers(1, local.scheduler_address) as cluster:
        assert play("cluster", cluster) == expected
        # A policy that cannot play is an error of its own, and the cluster remains.
        useless = spec("useless", make=lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
        folder = result_folder(tmp_path / "useless", ENV_ID, "short")
        with pytest.raises(ResultError, match="useless cannot play"):
            run.play_all([run.TaskRun(task, [useless], folder)], fresh=False, over=cluster)

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


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.mark.slow
def test_processes_and_a_cluster_write_the_same_as_one_process(tmp_path: Path) -> None:
    task = Task(env_id=ENV_ID, scenario=onnx_agents.SCENARIO, seeds=[7, 8, 9, 10])
    agents = policies.agents([onnx_agents.write(tmp_path)], task)
    chosen = [policies.one_named("fixed_handbook", task), *agents, spec("quick", (0.0, 1.0))]

    def play(name: str, over: workers.Workers | None) -> dict[str, bytes]:
        folder = tmp_path / name
        run.play_all(
            [run.TaskRun(task, chosen, result_folder(folder, ENV_ID, task.scenario.name))],
            fresh=False,
            over=over,
        )
        return files(folder)

    expected = play("serial", None)
    assert len(expected) == 5
    with workers.workers(2, None) as over:
        assert play("processes", over) == expected
    local = LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0")
    with local, workers.workers(1, local.scheduler_address) as over:
        assert play("cluster", over) == expected
        # A policy that cannot play is an error of its own, and the cluster remains.
        useless = spec("useless", make=lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
        failing = run.TaskRun(task, [useless], result_folder(tmp_path / "useless", ENV_ID, "short"))
        with pytest.raises(ResultError, match="useless cannot play"):
            run.play_all([failing], fresh=False, over=over)

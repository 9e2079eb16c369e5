"""Several processes and a Dask cluster come to the same files as one process."""

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from baselines.policy_spec import PolicySpec
from leaderboard import policies, run, workers
from leaderboard.result import ResultError, Task, result_folder
from tests.leaderboard.agents import onnx_agents
from tests.leaderboard.conftest import ENV_ID, Steady, spec


def contents(folder: Path) -> dict[str, bytes]:
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


TASK = Task(env_id=ENV_ID, scenario=onnx_agents.SCENARIO, seeds=[7, 8, 9, 10])


def play(
    chosen: Sequence[PolicySpec], results: Path, over: workers.Workers | None
) -> dict[str, bytes]:
    """Play policies, here if ``over`` is None; return the files that are written."""
    folder = result_folder(results, ENV_ID, TASK.scenario.name)
    run.play_all([run.TaskRun(TASK, chosen, folder)], fresh=False, over=over)
    return contents(results)


@pytest.fixture(scope="module")
def chosen(tmp_path_factory: pytest.TempPathFactory) -> list[PolicySpec]:
    """A rule, an agent and a policy of a function."""
    rule = policies.one_named("fixed_handbook", TASK)
    file = onnx_agents.write(tmp_path_factory.mktemp("agents"))
    (agent,) = policies.agents([file], TASK)
    return [rule, agent, spec("quick", (0.0, 1.0))]


@pytest.fixture(scope="module")
def expected(
    chosen: list[PolicySpec], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, bytes]:
    """The files of a run in one process: three results, the trajectories and the manifest."""
    files = play(chosen, tmp_path_factory.mktemp("serial"), None)
    assert len(files) == 5
    return files


@pytest.fixture(scope="module")
def cluster() -> Iterator[workers.Workers]:
    """Workers on a cluster of one process."""
    # Its import takes a third of a second in each worker of the suite.
    from distributed import LocalCluster

    local = LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=":0")
    with local, workers.workers(1, local.scheduler_address) as over:
        yield over


@pytest.mark.slow
def test_processes_write_the_same_as_one_process(
    chosen: list[PolicySpec], expected: dict[str, bytes], tmp_path: Path
) -> None:
    with workers.workers(2, None) as processes:
        assert play(chosen, tmp_path / "processes", processes) == expected


@pytest.mark.slow
def test_a_cluster_writes_the_same_as_one_process(
    chosen: list[PolicySpec],
    expected: dict[str, bytes],
    cluster: workers.Workers,
    tmp_path: Path,
) -> None:
    assert play(chosen, tmp_path / "cluster", cluster) == expected


@pytest.mark.slow
def test_a_policy_that_cannot_play_is_an_error_of_its_own_and_the_cluster_remains(
    cluster: workers.Workers, tmp_path: Path
) -> None:
    useless = spec("useless", make=lambda num_envs: Steady(num_envs, (math.nan, 0.0)))
    with pytest.raises(ResultError, match="useless cannot play"):
        play([useless], tmp_path / "useless", cluster)
    quick = spec("quick", (0.0, 1.0))
    assert play([quick], tmp_path / "quick", cluster)

"""Several processes and a Dask cluster come to the same files as one process, also when one of theirs is killed."""

import os
import pickle
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import cloudpickle
import numpy as np
import pytest
from numpy.typing import NDArray

from leaderboard import run
from leaderboard.__main__ import main
from leaderboard.contestants import Contestant
from leaderboard.result import ResultError, Task, read_result, result_folder, write_part
from tests.dask_cluster import dask_cluster
from tests.leaderboard.conftest import ENV_ID, Steady, contestant, record_of
from tests.train import onnx_agents
from turning_env import IDS, Scenario
from turning_env.score import workers
from turning_env.score.policy import Actions, Observations


class Deadly(Steady):
    """Kills its process while it plays, the first time."""

    def __init__(self, num_envs: int, mark: Path) -> None:
        super().__init__(num_envs, (0.1, 0.1))
        self._mark = mark
        self._acts = 0

    def act(self, observations: Observations) -> Actions:
        """The same action in every lane."""
        self._acts += 1
        if self._acts == 3 and not self._mark.exists():
            self._mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observations)


class Useless(Steady):
    """Acts in no way that is allowed."""

    def act(self, observations: Observations) -> Actions:
        """Not finite."""
        useless: NDArray[np.float32] = np.full_like(super().act(observations), np.nan)
        return useless


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture
def rounds(tmp_path: Path) -> Callable[[str], list[run.Round]]:
    """Two tasks of what is there to play, the second with a policy that kills its process once."""
    scenario = onnx_agents.SCENARIO
    task = Task(env_id=ENV_ID, scenario=scenario, draws=[7, 8, 9, 10])
    other = task.model_copy(update={"scenario": scenario.model_copy(update={"name": "other"}), "draws": [1, 2, 3]})
    agents = [onnx_agents.write(tmp_path)]
    mark = tmp_path / "killed"

    def make(folder: str) -> list[run.Round]:
        deadly = Contestant(record_of("deadly"), lambda num_envs: Deadly(num_envs, mark))
        playing = [
            (task, [run.rule("fixed_handbook", scenario), *run.agents(agents, scenario)]),
            (other, [deadly, contestant("quick", (0.0, 1.0)), contestant("slow")]),
        ]
        return [run.Round(each, who, result_folder(tmp_path / folder, ENV_ID, each.scenario.name)) for each, who in playing]

    return make


@pytest.fixture
def expected(tmp_path: Path, rounds: Callable[[str], list[run.Round]]) -> dict[str, bytes]:
    """What one process writes."""
    (tmp_path / "killed").touch()
    run.play_all(rounds("serial"), fresh=False)
    (tmp_path / "killed").unlink()
    written = files(tmp_path / "serial")
    assert len(written) == 7
    return written


@pytest.mark.parametrize("env_id", IDS)
def test_every_policy_travels(env_id: str) -> None:
    scenario = Scenario.load(IDS[env_id])
    players = run.named(None, scenario)
    arrived = pickle.loads(cloudpickle.dumps(players))
    assert [player.policy for player in arrived] == [player.policy for player in players]
    assert all(player.make(1).act for player in arrived if isinstance(player, Contestant))


def test_processes_write_the_same(tmp_path: Path, rounds: Callable[[str], list[run.Round]], expected: dict[str, bytes]) -> None:
    (tmp_path / "killed").touch()
    with workers.workers(2, None) as over:
        run.play_all(rounds("processes"), fresh=False, over=over)
    assert files(tmp_path / "processes") == expected


def test_a_cluster_writes_the_same_though_a_worker_is_killed(
    tmp_path: Path,
    rounds: Callable[[str], list[run.Round]],
    expected: dict[str, bytes],
    capsys: pytest.CaptureFixture[str],
) -> None:
    with dask_cluster(tmp_path, workers=3) as cluster:
        with workers.workers(1, cluster.address) as over:
            run.play_all(rounds("cluster"), fresh=False, over=over)
        assert files(tmp_path / "cluster") == expected
        assert sorted(worker.poll() is None for worker in cluster.workers) == [False, True, True]
        # A policy that cannot play is an error of its own, and the cluster remains.
        useless = Contestant(record_of("useless"), lambda num_envs: Useless(num_envs, (0.0, 0.0)))
        with workers.workers(1, cluster.address) as over, pytest.raises(ResultError, match="useless cannot play"):
            run.play_all(
                [run.Round(rounds("cluster")[1].task, [useless], result_folder(tmp_path / "useless", ENV_ID, "other"))],
                fresh=False,
                over=over,
            )
        # The commands.
        arguments = ["--scheduler", cluster.address, "--policies", "fixed_handbook", "ppo"]
        rows, agents = str(tmp_path / "rows"), tmp_path / "agents"
        path = onnx_agents.write(result_folder(agents, ENV_ID, "short"))
        scenario = tmp_path / "short.toml"
        onnx_agents.SCENARIO.save(scenario)
        played = ["--draws", "2", "--scenario", str(scenario), "--agents", str(path)]
        assert main(["run", *arguments[:-1], "--results", rows, *played]) == 0
        assert main(["run", "--policies", "fixed_handbook", "--results", str(tmp_path / "again"), *played]) == 0
        assert files(tmp_path / "rows") == files(tmp_path / "again")
        verified = ["--rows", rows, "--agents", str(agents), "--memory", str(tmp_path / "verified.json")]
        assert main(["verify", *arguments, *verified]) == 0
        path = result_folder(tmp_path / "rows", ENV_ID, "short") / "fixed_handbook.json.xz"
        row = read_result(path)
        write_part(row.model_copy(update={"episodes": row.episodes | {"removed": [0.0, row.episodes["removed"][1]]}}), path)
        capsys.readouterr()
        assert main(["verify", *arguments, *verified]) == 1
        assert capsys.readouterr().out.startswith(f"{path}: removed differs on 1 of 2 draws, by up to ")


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("tcp://127.0.0.1:1", "no scheduler can be reached at tcp://127.0.0.1:1: "),
        ("127.0.0.1:8786", "the scheduler is '127.0.0.1:8786', but must be an address like tcp://host:8786"),
        ("tcp://host:port", "the scheduler is 'tcp://host:port', but must be"),
    ],
)
def test_a_scheduler_that_is_not_there_is_an_error(
    address: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", "--policies", "fixed_handbook", "--draws", "1", "--results", str(tmp_path)]
    assert main([*arguments, "--scheduler", address]) == 2
    assert capsys.readouterr().err.startswith(f"error: {message}")


def test_without_dask_a_scheduler_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    arguments = ["run", "--policies", "fixed_handbook", "--draws", "1", "--results", str(tmp_path)]
    assert main([*arguments, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "needs the extra 'distributed'" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main([*arguments, "--jobs", "2", "--scheduler", "tcp://127.0.0.1:1"])
    assert "not allowed with argument" in capsys.readouterr().err

"""Private draws: what a file of them may hold, what rows tell of them, and who is found out by them."""

import json
import secrets
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from leaderboard import verify
from leaderboard.__main__ import main
from leaderboard.board import read_board
from leaderboard.contestants import Contestant
from leaderboard.private_seeds import PrivateDraws
from leaderboard.result import ResultError, Task, digest_of, read_part, read_result, result_folder, write_part
from leaderboard.run import Round, play_all
from tests.leaderboard.conftest import ENV_ID, MakeResult, Steady, record_of
from turning_env import Scenario
from turning_env.score.play import play
from turning_env.score.policy import Actions, Observations
from turning_env.score.seeds import held_out_seeds

SEEDS = [2**64 - 1, 0, 12345678901234567890, 5]
TEXT = "# who scores knows these\n18446744073709551615 0\n\n12345678901234567890 # the third\n5\n"


@pytest.mark.parametrize("text", [TEXT, json.dumps(SEEDS), "\n" + json.dumps(SEEDS, indent=1)])
def test_a_file_is_text_or_json(text: str, tmp_path: Path) -> None:
    (tmp_path / "draws").write_text(text)
    assert PrivateDraws.read(tmp_path / "draws").seeds == tuple(SEEDS)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "holds 0 draws, but must hold 1 to 1000000"),
        (b"# none\n", "holds 0 draws"),
        (b"[]", "holds 0 draws"),
        (b"1 2 1", "holds the draw 1 twice"),
        (b"[3, 3]", "holds the draw 3 twice"),
        (b"007 7", "holds the draw 7 twice"),
        (b"-1", "'-1' is not a whole number of 0 to 18446744073709551615"),
        (b"18446744073709551616", "'18446744073709551616' is not a whole number"),
        (b"9" * 10_000, "'9999.*\\.\\.\\. is not a whole number"),
        (b"1.0", "'1.0' is not a whole number"),
        (b"[1.0]", "1.0 is not a whole number"),
        (b"[true]", "True is not a whole number"),
        (b"[[1]]", r"\[1\] is not a whole number"),
        (b"[-1]", "-1 is not a whole number"),
        (b'{"draws": [1]}', "JSON must be a list of seeds"),
        (b"[" * 100_000, "cannot be used"),
        (b"[1, 2", "cannot be used"),
        ("\uff11\uff12".encode(), "is not a whole number"),
        (b"\xff\xfe", "cannot be used"),
        (b" " * 32_000_001, "larger than 32000000 bytes"),
    ],
)
def test_other_files_are_refused_with_the_reason(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "draws").write_bytes(content)
    with pytest.raises(ResultError, match=message):
        PrivateDraws.read(tmp_path / "draws")


def test_rows_tell_the_digest_and_neither_seeds_nor_courses(task: Task, folder: Path) -> None:
    private = PrivateDraws(tuple(secrets.randbits(64) for _ in range(3)))
    secret = private.task_of(task)
    steady = Contestant(record_of("steady"), lambda num_envs: Steady(num_envs, (0.0, 0.1)))
    play_all([Round(secret, [steady], folder, private)], fresh=False)
    assert [path.name for path in folder.iterdir()] == ["steady.json.xz"]
    row = read_result(folder / "steady.json.xz")
    assert (row.task.draws, row.task.private, row.digests.draws) == ([0, 1, 2], digest_of(list(private.seeds)), secret.private)
    told = json.dumps(row.model_dump())
    assert not any(str(seed) in told for seed in private.seeds)
    expected = play(lambda num_envs: Steady(num_envs, (0.0, 0.1)), task.scenario, private.seeds)
    for name, values in expected.items():
        np.testing.assert_array_equal(row.episodes[name], values)
    # Other secrets are another task, also as many of them.
    others = PrivateDraws(private.seeds[::-1])
    play_all([Round(others.task_of(task), [Contestant(record_of("other"), steady.make)], folder, others)], fresh=False)
    assert [len(read_board(folder, digest).results) for digest in (row.digests.task, None)] == [1, 1]


def test_public_rows_are_as_they_were(make_result: MakeResult, tmp_path: Path) -> None:
    row = make_result("steady")
    assert "private" not in row.model_dump()["task"]
    path = result_folder(tmp_path, ENV_ID, row.task.scenario.name) / "steady.json.xz"
    write_part(row, path)
    assert read_part(type(row), path) == row


def test_who_names_other_places_or_changes_the_digest_is_found(task: Task, make_result: MakeResult) -> None:
    with pytest.raises(ValueError, match="must be named by their places"):
        Task.model_validate(task.model_dump() | {"private": "0" * 64})
    row = make_result("steady").model_dump(by_alias=True)
    row["task"] |= {"private": "0" * 64, "draws": list(range(4))}
    with pytest.raises(ValueError, match="digests do not match"):
        type(make_result("steady")).model_validate(row)


def test_commands(tmp_path: Path, scenario: Scenario, capsys: pytest.CaptureFixture[str]) -> None:
    scenario.save(tmp_path / "short.toml")
    draws, rows = tmp_path / "private_draws.txt", tmp_path / "rows"
    draws.write_text("7\n" + "\n".join(str(secrets.randbits(63) + 2**63) for _ in range(2)))
    words = ["run", "--scenario", str(tmp_path / "short.toml"), "--results", str(rows), "--policies", "fixed_handbook"]
    assert main([*words, "--draws", str(draws)]) == 0
    captured = capsys.readouterr()
    assert "3 draws" in captured.out
    assert "warning: 1 draws of" in captured.err
    page = (rows / "index.html").read_text("utf-8")
    assert "3 seeds, private: only who scores knows them" in page
    assert "--draws PRIVATE_DRAWS.txt" in page
    assert not any(seed in page for seed in draws.read_text().split()[1:])
    complaints = verify.verify(rows, tmp_path, verify.Selection(), tmp_path / "memory.json", False)
    assert len(complaints) == 1
    assert "was played on private draws" in complaints[0]
    assert main([*words, "--draws", str(draws), "--splits"]) == 2
    assert "splits are played on held-out draws" in capsys.readouterr().err
    draws.write_text("1 1")
    assert main([*words, "--draws", str(draws)]) == 2
    assert "holds the draw 1 twice" in capsys.readouterr().err


PROBED = 10
"""Intervals after which bars are known from one another."""
CHANGES = [np.array([speed, feed], np.float32) for speed in (0.0, 0.3) for feed in (-0.3, 0.0, 0.3, 0.6, 0.9)]
"""Of log speed and log feed, in four intervals."""


class ByHeart:
    """Looks up what is best on the bar that it has recognised by its first cuts; what it does not know it cuts at its worst."""

    def __init__(self, num_envs: int, known: dict[bytes, NDArray[np.float32]], unknown: NDArray[np.float32]) -> None:
        self._known, self._unknown, self._acts = known, unknown, 0
        self._steps = np.zeros((num_envs, 2), np.float32)
        self.seen: list[bytes] = []

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Episodes are of one length."""

    def act(self, observations: Observations) -> Actions:
        """Nothing at first, then the change that it knows."""
        self._acts += 1
        if self._acts == PROBED:
            self.seen = [row.tobytes() for row in observations]
            self._steps = np.stack([self._known.get(row, self._unknown) for row in self.seen]) / 4.0
        return self._steps if PROBED <= self._acts < PROBED + 4 else 0.0 * self._steps


def test_what_has_learned_the_public_draws_by_heart_is_found_out_by_private_ones(tmp_path: Path) -> None:
    scenario = Scenario.model_validate({"control": {"time_limit": 1.5}, "limits": {"power": 4.0, "thrust_force": 900.0}})
    public = held_out_seeds(12)
    private = PrivateDraws(tuple(np.random.default_rng(0).integers(2**63, 2**64, 12, np.uint64).tolist()))
    made: list[ByHeart] = []

    def always(change: NDArray[np.float32]) -> Contestant:
        def make(num_envs: int) -> ByHeart:
            made.append(ByHeart(num_envs, {}, change))
            return made[-1]

        return Contestant(record_of(f"honest {change}"), make)

    returns = np.array([play(always(change).make, scenario, public)["return"] for change in CHANGES])
    best, worst = CHANGES[returns.mean(1).argmax()], CHANGES[returns.mean(1).argmin()]
    known = dict(zip(made[0].seen, (CHANGES[place] for place in returns.argmax(0)), strict=True))
    assert len(known) == len(public)  # bars can be told apart
    cheat = Contestant(record_of("by heart"), lambda num_envs: ByHeart(num_envs, known, worst))
    contestants = [cheat, always(best)]
    task = Task(env_id=ENV_ID, scenario=scenario, draws=public)
    rounds = [
        Round(task, contestants, result_folder(tmp_path / "public", ENV_ID, scenario.name)),
        Round(private.task_of(task), contestants, result_folder(tmp_path / "private", ENV_ID, scenario.name), private),
    ]
    play_all(rounds, fresh=False)
    boards = [{standing.name: standing.mean_return.value for standing in read_board(each.folder).standings} for each in rounds]
    (honest,) = set(boards[0]) - {"by heart"}
    assert boards[0]["by heart"] > boards[0][honest]
    assert boards[1]["by heart"] < boards[1][honest] - 5.0
    losses = {name: boards[0][name] - boards[1][name] for name in boards[0]}
    assert losses["by heart"] > losses[honest] + 5.0

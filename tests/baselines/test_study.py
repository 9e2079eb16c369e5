from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from baselines.catalogue import RULES
from baselines.rule import Parameters, Range, Rule
from baselines.tune import study
from baselines.tune.study import Found, Played, Search, play_setting, run_all
from tests.turning_env.test_family_env import BRIEF
from turning_env import Family, Scenario
from turning_env.scoring.family import play_jobs
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds

SHORT = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.1}})
RULE = Rule(
    "made up",
    RULES["fixed_handbook"].build,
    lambda scenario: True,
    {"share": Range(0.0, 1.0), "gain": Range(0.01, 1.0, logarithmic=True), "known": 7.0},
)
ALLOWANCE = SHORT.limits.overload_allowance
Score = Callable[[Parameters], tuple[float, float]]


class Counted:
    """Scores settings by a formula instead of playing them; keeps the settings, and raises at a given one."""

    def __init__(self, score: Score) -> None:
        self.score = score
        self.settings: list[Parameters] = []
        self.raise_at: dict[int, BaseException] = {}

    def __call__(self, rule: Rule, scenario: Scenario, setting: Parameters, seeds: list[int]) -> Played:
        self.settings.append(setting)
        if error := self.raise_at.get(len(self.settings)):
            raise error
        mean_return, severe_limit = self.score(setting)
        return Played(mean_return, 0.8 * severe_limit, severe_limit, 100)


@pytest.fixture(autouse=True)
def journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The journal of all searches."""
    monkeypatch.chdir(tmp_path)
    return Path("journal.log")


@pytest.fixture
def scored(monkeypatch: pytest.MonkeyPatch) -> Callable[[Score], Counted]:
    def scored(score: Score) -> Counted:
        counted = Counted(score)
        monkeypatch.setattr(study, "play_setting", counted)
        return counted

    return scored


def hill(setting: Parameters) -> tuple[float, float]:
    """Highest at a share of 0.7, and feasible up to 0.6."""
    return -((setting["share"] - 0.7) ** 2), ALLOWANCE * setting["share"] / 0.6


def search(name: str, rule: Rule, scenario: Scenario, trials: int, seeds: int) -> Found:
    searching = Search(name, rule, scenario, trials, seeds, Path("journal.log"))
    run_all([searching])
    return searching.found()


def run(trials: int = 16, seeds: int = 4) -> Found:
    return search("made_up", RULE, SHORT, trials, seeds)


def test_the_middle_comes_first_and_all_settings_lie_in_range(scored: Callable[[Score], Counted]) -> None:
    counted = scored(hill)
    run()
    assert counted.settings[0] == {"share": 0.5, "gain": pytest.approx(0.1), "known": 7.0}
    assert len(counted.settings) == 16
    for setting in counted.settings:
        assert 0 <= setting["share"] <= 1
        assert 0.01 <= setting["gain"] <= 1
        assert setting["known"] == 7.0


def test_the_best_feasible_setting_wins(scored: Callable[[Score], Counted]) -> None:
    counted = scored(hill)
    found = run(trials=30, seeds=4)
    assert found.feasible
    assert found.parameters.keys() == {"share", "gain"}
    assert 0.55 < found.parameters["share"] <= 0.6
    assert found.mean_return == max(hill(setting)[0] for setting in counted.settings if setting["share"] <= 0.6)
    assert found.severe_share == pytest.approx(0.8 * hill(found.parameters)[1])
    assert found.episodes_played == 30 * 4
    assert found.steps_played == 30 * 100


def test_where_none_is_feasible_the_best_of_all_wins(scored: Callable[[Score], Counted]) -> None:
    counted = scored(lambda setting: (setting["share"], ALLOWANCE * (1.1 + setting["share"])))
    found = run()
    assert not found.feasible
    assert found.parameters["share"] == max(setting["share"] for setting in counted.settings)
    assert found.mean_return == found.parameters["share"]


@pytest.mark.parametrize("at", [1, 14])
def test_interrupted_it_goes_on_to_the_same_end(at: int, scored: Callable[[Score], Counted], journal: Path) -> None:
    whole = scored(hill)
    expected = run()
    journal.unlink()
    parts = scored(hill)
    parts.raise_at = {at: KeyboardInterrupt(), at + 1: KeyboardInterrupt()}
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            run()
    assert run() == expected
    assert parts.settings == whole.settings[:at] + [whole.settings[at - 1]] * 2 + whole.settings[at:]
    assert list(Path().iterdir()) == [journal]


def test_another_task_starts_anew(scored: Callable[[Score], Counted]) -> None:
    other = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.2}})
    counted = scored(hill)
    run(trials=5)
    for scenario, trials, seeds, version in ((SHORT, 6, 4, 1), (SHORT, 5, 3, 1), (SHORT, 5, 4, 2), (other, 5, 4, 1)):
        counted.settings.clear()
        search("made_up", replace(RULE, version=version), scenario, trials, seeds)
        assert len(counted.settings) == trials


@pytest.mark.parametrize("damage", ["garbled", "", '{"op_code": 3}\n', "[" * 100_000 + "\n"], ids=range(4))
def test_a_damaged_journal_is_started_anew(
    damage: str, scored: Callable[[Score], Counted], journal: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counted = scored(hill)
    expected = run(trials=12)
    text = journal.read_text()
    lines = text.splitlines(keepends=True)
    journal.write_text({"garbled": "".join([*lines[:9], "{garbled\n", *lines[9:]])}.get(damage, damage), "latin-1")
    assert run(trials=12) == expected
    assert len(counted.settings) == 24
    assert ("is damaged" in capsys.readouterr().err) == (damage != "")


def test_of_a_journal_that_ends_within_a_line_all_that_is_whole_is_kept(
    scored: Callable[[Score], Counted], journal: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    counted = scored(hill)
    expected = run(trials=12)
    content = journal.read_bytes()
    journal.write_bytes(content[: len(content) // 2].rstrip(b"\n")[:-1])
    assert run(trials=12) == expected
    assert len(counted.settings) < 12 + 9
    assert "ended within a line, which is cut off" in capsys.readouterr().err


def test_a_failure_names_the_rule_and_the_setting(scored: Callable[[Score], Counted]) -> None:
    counted = scored(hill)
    counted.raise_at = {3: ValueError("no such thing")}
    with pytest.raises(ValueError, match="no such thing") as caught:
        run()
    assert caught.value.__notes__ == [f"while tuning made_up with {counted.settings[2]}"]


def test_settings_are_really_played() -> None:
    rule, seeds = RULES["fixed_tuned"], tuning_seeds(3)
    scenario = Scenario.model_validate({"control": {"time_limit": 0.5}})
    setting = {"cutting_speed": 200.0, "feed": 0.6}
    episodes = play(lambda num_envs: rule.build(scenario, num_envs, setting), scenario, seeds)
    played = play_setting(rule, scenario, setting, seeds)
    assert played.mean_return == episodes["return"].mean()
    assert played.steps == episodes["steps"].sum()
    assert played.severe_share == episodes["severe_overload_time"].sum() / episodes["engaged_time"].sum()
    assert 0 < played.severe_share <= played.severe_limit


@pytest.mark.slow
def test_settings_are_played_on_training_jobs_of_a_family() -> None:
    rule, family = RULES["self_tuning"], Family.load(BRIEF)
    setting = rule.fixed | {name: study.middle(values) for name, values in rule.ranges.items()}
    seeds = list(range(2))  # of the first jobs, with which they are also played one by one
    alone = play_jobs(family, "train", seeds, lambda job: lambda num_envs: rule.build(job.scenario.nominal(), num_envs, setting))
    played = play_setting(rule, family, setting, seeds)
    assert played.mean_return == alone["return"].mean()
    assert played.steps == alone["steps"].sum()

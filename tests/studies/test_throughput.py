"""The throughput benchmark runs, and its exit status tells whether the criteria are met."""

import json

import pytest

from studies import throughput
from turning_env import IDS

TINY = ["--repeats", "2", "--num-envs", "3", "--seconds", "0.002"]


def test_it_prints_every_case_and_meets_criteria_that_are_easy(capsys, monkeypatch):
    monkeypatch.setattr(throughput, "MIN_SHARE", 0.0)
    assert throughput.main(TINY) == 0
    printed = capsys.readouterr().out
    for name in ("Pendulum-v1, single", "RoughTurning-v0, single", *(f"{env_id}, 3 environments" for env_id in IDS)):
        assert name in printed
    assert (printed.count("met   "), printed.count("FAILED")) == (2, 0)
    assert throughput.main([*TINY, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["cases"]) == 3 + len(IDS)  # Pendulum, one environment, and a batch of every id
    assert [verdict["met"] for verdict in told["verdicts"]] == [True, True]


@pytest.mark.parametrize("criterion", throughput.RECORDED)
def test_a_missed_criterion_is_an_exit_status(capsys, monkeypatch, criterion):
    monkeypatch.setattr(throughput, "RECORDED", {"single": 0.0, "batch": 0.0} | {criterion: 1e9})
    assert throughput.main(TINY) == 1
    assert capsys.readouterr().out.count("FAILED") == 1

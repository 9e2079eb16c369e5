"""The growth benchmark measures, prints and draws."""

import json

import pytest

from studies import growth


@pytest.mark.slow
def test_it_prints_and_draws(tmp_path, capsys):
    plot = tmp_path / "growth.svg"
    assert growth.main([str(plot), "--max-envs", "64", "--repeats", "1", "--seconds", "0.001"]) == 0
    assert plot.read_text("utf-8").startswith("<?xml")
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["environments", "1", "8", "64"]
    assert growth.main([str(tmp_path / "a.svg"), "--max-envs", "8", "--repeats", "1", "--seconds", "0.001", "--json"]) == 0
    assert [row["num_envs"] for row in json.loads(capsys.readouterr().out)] == [1, 8]


def test_one_of_many_environments_takes_about_a_kilobyte():
    assert growth.bytes_per_env(4096) < 1100

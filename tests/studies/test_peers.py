from collections.abc import Iterator
from pathlib import Path

import gymnasium
import pytest

from studies import peers
from studies.timing import Case, Timing


def test_ratios_are_taken_within_a_turn() -> None:
    cases = [Case(name, 1, 1, lambda: None) for name in (peers.REFERENCE, "other")]
    # The machine was half as fast in the second turn, and the other case waited for a core in the third.
    timings = [
        [Timing(100.0, 100.0), Timing(50.0, 100.0), Timing(100.0, 100.0)],
        [Timing(300.0, 300.0), Timing(150.0, 300.0), Timing(200.0, 300.0)],
    ]
    reference, other = peers.rows_of(cases, timings)
    assert (reference.ratio, reference.lowest, reference.highest) == (1.0, 1.0, 1.0)
    assert (other.rate, other.cpu_rate) == (200.0, 300.0)
    assert (other.ratio, other.lowest, other.highest) == (3.0, 2.0, 3.0)


@pytest.mark.slow
def test_peers_that_do_not_run_are_left_out_and_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def absent() -> Iterator[Case]:
        import no_such_module  # type: ignore[import-not-found]

        yield no_such_module

    def broken() -> Iterator[Case]:
        raise RuntimeError("old drivers")

    def changed() -> Iterator[Case]:
        yield Case("changed", 1, 1, broken().__next__)

    def in_a_folder() -> Iterator[Case]:
        yield Case("own copy", 1, 1, lambda: None)

    monkeypatch.setattr(peers, "NUM_ENVS", (1, 2, 4))
    others = {"absent": absent, "broken": broken, "changed": changed, "in_a_folder": in_a_folder}
    monkeypatch.setattr(peers, "PEERS", {"gymnasium": peers.gymnasium_cases, **others})
    assert peers.main(["--repeats", "1", "--seconds", "0.001", "--out", str(tmp_path)]) == 0
    page = (tmp_path / "peers.md").read_text("utf-8")
    assert page == capsys.readouterr().out
    assert "python -m studies.peers --repeats 1 --seconds 0.001" in page
    assert "left out: absent: No module named 'no_such_module'" in page
    assert "left out: broken does not run here: RuntimeError: old drivers" in page
    assert "left out: changed does not run here" in page
    assert f"Versions: gymnasium {gymnasium.__version__}, in_a_folder, rough-turning " in page
    for name, lanes in ((peers.REFERENCE, 1), ("Gymnasium CartPole, vector", 4), ("**RoughTurning-v0, vector**", 4)):
        assert f"| {name} | {lanes} | " in page
    assert (tmp_path / "peers.png").read_bytes().startswith(b"\x89PNG")

"""A fresh root has the tree of HEAD, restores all seeds, and leaves the old history in a bundle."""

import subprocess
from pathlib import Path

import pytest

from tools.fresh_root import main


def git(folder: Path, *arguments: str) -> str:
    finished = subprocess.run(
        ["git", *arguments], cwd=folder, check=True, capture_output=True, text=True
    )
    return finished.stdout


def commit(folder: Path, message: str) -> str:
    git(folder, "add", "--all")
    git(folder, "commit", "--quiet", "--message", message)
    return git(folder, "rev-parse", "HEAD").strip()


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a repository whose Makefile names the commit that holds an agent's second seed."""
    folder = tmp_path / "repository"
    (folder / "agents" / "task").mkdir(parents=True)
    for role in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{role}_NAME", "A maintainer")
        monkeypatch.setenv(f"GIT_{role}_EMAIL", "maintainer@example.org")
    git(folder, "init", "--quiet", "--initial-branch", "main")
    for seed in (0, 1):
        (folder / "agents" / "task" / f"ppo-seed{seed}.onnx").write_text(f"seed {seed}")
    all_seeds = commit(folder, "Add agents")
    (folder / "agents" / "task" / "ppo-seed1.onnx").unlink()
    (folder / "Makefile").write_text(f"SEEDS ?= 0-9\nALL_SEEDS ?= {all_seeds}\n")
    commit(folder, "Keep one seed")
    monkeypatch.chdir(folder)
    return folder


def test_a_fresh_root_restores_all_seeds_and_archives_the_history(repository: Path) -> None:
    head = git(repository, "rev-parse", "main").strip()
    archive = repository.parent / "history.bundle"
    assert main(["--archive", str(archive)]) == 0

    fresh, root = git(repository, "rev-list", "published").split()
    assert git(repository, "show", f"{root}:agents/task/ppo-seed1.onnx") == "seed 1"
    assert git(repository, "show", "published:Makefile") == f"SEEDS ?= 0-9\nALL_SEEDS ?= {root}\n"
    assert git(repository, "diff", "--name-only", "main", fresh).split() == ["Makefile"]

    # The old history can be cloned from the archive, and nothing of it was changed.
    assert git(repository, "rev-parse", "main").strip() == head
    assert git(repository, "status", "--short") == ""
    git(repository.parent, "clone", "--quiet", str(archive), "restored")
    assert git(repository.parent / "restored", "rev-parse", "origin/main").strip() == head


def test_a_fresh_root_replaces_no_branch_and_no_file(
    repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive = repository.parent / "history.bundle"
    archive.write_text("mine")
    assert main(["--archive", str(archive)]) != 0
    assert archive.read_text() == "mine"
    assert main(["--archive", str(archive) + "2", "--branch", "main"]) != 0
    assert "--branch" in capsys.readouterr().err


def test_a_fresh_root_needs_the_commit_of_all_seeds(
    repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (repository / "Makefile").write_text("SEEDS ?= 0-9\n")
    commit(repository, "Forget the seeds")
    archive = repository.parent / "history.bundle"
    assert main(["--archive", str(archive)]) != 0
    assert "ALL_SEEDS" in capsys.readouterr().err
    assert not archive.exists()

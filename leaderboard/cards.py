"""Model cards of the shipped agents: description, training, results and limits."""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from baselines.guided import HOLD
from leaderboard import columns, table
from leaderboard.information import CLASSES, RUN_TIME_INPUTS
from leaderboard.policies import SUMS
from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import ResultError, result_files, result_folder, write_whole
from leaderboard.shown import MAX_VALUES, fenced, few, markdown_text
from train.agents import agent_file
from train.agents.agent_file import ONNX_SUFFIX, AgentFile
from train.run import family_of
from train.training_information import TRAINING_INPUTS
from turning_env import FAMILY_ID, SPLITS
from turning_env.scoring.policy import PolicySpec


def write_all(results: Path, agents: Path) -> list[Path]:
    """Write the card of every agent, and ``SUMS``; return the cards' paths.

    ResultError if a file is in the wrong place or has no results.
    """
    folders = sorted({path.parent for path in agents.glob(f"*/*/*{ONNX_SUFFIX}")})
    if not folders:
        raise ResultError(f"{agents} holds no agents")
    written, sums = list[Path](), list[str]()
    for folder in folders:
        env_id, home = folder.parts[-2:]
        played_on = f"{home}-unseen_jobs" if env_id == FAMILY_ID else home
        board = read_leaderboard(result_folder(results, env_id, played_on))
        splits = [
            other
            for name in SPLITS
            if name != home and result_files(other := result_folder(results, env_id, name))
        ]
        across = table.across([board, *map(read_leaderboard, splits)])
        agents_played = (each.policy for each in board.results if each.policy.kind == "agent")
        played = {
            each.label: each
            for each in sorted(agents_played, key=lambda each: each.training_seed or 0)
        }
        for name, files in _agents(folder).items():
            for file in files:
                if (
                    file.metadata.label not in played
                    or played[file.metadata.label].sha256 != file.digest
                ):
                    raise ResultError(
                        f"{folder / file.metadata.label}{ONNX_SUFFIX} has no results in {results}: play it first"
                    )
            shown = board.names[files[0].metadata.label]
            trainings = [each for each in played.values() if board.names[each.label] == shown]
            path = folder / f"{name}.md"
            write_whole(path, render(files[0], trainings, board, across, folder))
            written.append(path)
            sums += [
                f"{each.sha256}  {env_id}/{home}/{each.label}{ONNX_SUFFIX}\n" for each in trainings
            ]
    write_whole(agents / SUMS, "".join(sums))
    return written


def render(
    file: AgentFile,
    trainings: Sequence[PolicySpec],
    board: Leaderboard,
    across: table.Across | None,
    folder: Path,
) -> str:
    """Return the card of an agent as Markdown.

    ``file``: of one training seed, in the agent's ``folder``; ``trainings``: policies of all seeds; ``across``: full costs on
    scenarios on which it was not trained, if any.
    """
    metadata = file.metadata
    name = board.names[metadata.label]
    standing = next(each for each in board.standings if each.name == name)
    shown = (
        *columns.RETURNS,
        *columns.COMPARISONS,
        *columns.CONSTRAINT,
        *columns.LIMITS,
        *columns.WORKSHOP,
    )
    elsewhere = (
        across.rows.get(name, {}) if across and across.tuned_for == metadata.scenario.name else {}
    )
    bounds = zip(metadata.observation_space.low, metadata.observation_space.high, strict=True)
    ranges = [
        (text, len(list(group)))
        for text, group in groupby(f"{low:g} to {high:g}" for low, high in bounds)
    ]
    loader = FileSystemLoader(Path(__file__).parent)
    templates = Environment(
        loader=loader, autoescape=False, undefined=StrictUndefined, trim_blocks=True
    )  # Markdown, not HTML
    templates.filters |= {"shown": markdown_text, "few": few, "fenced": fenced}
    card = templates.get_template("model_card.md.j2").render(
        standing=standing,
        seeds=len(board.task.seeds),
        columns=columns.applying(shown, [standing]),
        elsewhere={
            split: played for split, played in elsewhere.items() if split != metadata.scenario.name
        },
        trainings=trainings,
        metadata=metadata,
        memory_size=file.memory_size,
        steps=f"decisions, each of {HOLD} environment steps,"
        if metadata.parameters.get("guide")
        else "environment steps",
        ranges=", ".join(
            f"{count} times {text}" if count > 7 else ", ".join([text] * count)
            for text, count in ranges
        ),
        classes=CLASSES,
        verdicts=table.VERDICTS,
        max_values=MAX_VALUES,
        given=TRAINING_INPUTS,
        seen=RUN_TIME_INPUTS,
        example=folder / f"{metadata.label}{ONNX_SUFFIX}",
    )
    return card + "\n"


def _agents(folder: Path) -> dict[str, list[AgentFile]]:
    """Return the agents of a folder by name, each by training seed."""
    agents: dict[str, list[AgentFile]] = {}
    for path in sorted(folder.glob(f"*{ONNX_SUFFIX}")):
        try:
            file = agent_file.read(path)
        except (OSError, ValueError) as error:
            raise ResultError(str(error)) from error
        metadata = file.metadata
        family = family_of(metadata.env_id, metadata.parameters)
        place = (
            Path(metadata.env_id)
            / (family or metadata.scenario).name
            / f"{file.metadata.label}{ONNX_SUFFIX}"
        )
        if place.parts != path.parts[-3:]:
            raise ResultError(
                f"{path} holds {file.metadata.label} and should be at {place} in the folder of agents"
            )
        agents.setdefault(file.metadata.label.rpartition("-seed")[0], []).append(file)
    for files in agents.values():
        files.sort(key=lambda file: file.metadata.seed)
    return agents

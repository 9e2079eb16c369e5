"""Model cards of the shipped agents: description, training, results and limits.

The words of a card are in ``model_card.md.j2``.
"""

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from baselines.policy_spec import PolicySpec
from leaderboard import columns, table
from leaderboard.agents import agent_file
from leaderboard.agents.agent_file import ONNX_SUFFIX, AgentFile, Space, training_family
from leaderboard.inputs import CLASSES, RUN_TIME_INPUTS, TRAINING_INPUTS
from leaderboard.policies import SUMS
from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import ResultError, result_files, result_folder
from leaderboard.shown import MAX_VALUES, fenced, few, markdown_text
from turning_env import FAMILY_ID, SPLITS
from turning_env.files import write_file

COLUMNS = (
    *columns.RETURNS,
    *columns.COMPARISONS,
    *columns.CONSTRAINT,
    *columns.LIMITS,
    *columns.WORKSHOP,
)
"""The numbers of a standing that a card shows."""
MAX_REPEATED = 7  # entries of an observation in a row that are listed one by one


def write_all(results: Path, agents: Path) -> list[Path]:
    """Write the card of every agent, and ``SUMS``; return the cards' paths.

    Raise ResultError if a file is in the wrong place or has no results.
    """
    folders = sorted({path.parent for path in agents.glob(f"*/*/*{ONNX_SUFFIX}")})
    if not folders:
        raise ResultError(f"{agents} holds no agents")
    cards: list[Path] = []
    sums: list[str] = []
    for folder in folders:
        env_id, home = folder.parts[-2:]
        leaderboard = read_leaderboard(_results_of(results, env_id, home))
        across = table.across([leaderboard, *_splits(results, env_id, home)])
        played = _agents_on(leaderboard)
        for name, files in _agents_in(folder).items():
            for file in files:
                policy = played.get(file.metadata.label)
                if policy is None or policy.sha256 != file.digest:
                    raise ResultError(
                        f"{folder / file.metadata.label}{ONNX_SUFFIX} has no results in {results}: "
                        "play it first"
                    )
            standing = leaderboard.names[files[0].metadata.label]
            trainings = [
                policy for label, policy in played.items() if leaderboard.names[label] == standing
            ]
            card = folder / f"{name}.md"
            write_file(card, render(files[0], trainings, leaderboard, across=across, folder=folder))
            cards.append(card)
            for policy in trainings:
                file_name = f"{env_id}/{home}/{policy.label}{ONNX_SUFFIX}"
                sums.append(f"{policy.sha256}  {file_name}\n")
    write_file(agents / SUMS, "".join(sums))
    return cards


def _results_of(results: Path, env_id: str, home: str) -> Path:
    """Return the folder of the results of agents that were trained on a scenario or family."""
    played_on = f"{home}-unseen_jobs" if env_id == FAMILY_ID else home
    return result_folder(results, env_id, played_on)


def _splits(results: Path, env_id: str, home: str) -> list[Leaderboard]:
    """Return the leaderboards of an id's splits, as far as there are results."""
    folders = [result_folder(results, env_id, name) for name in SPLITS if name != home]
    return [read_leaderboard(folder) for folder in folders if result_files(folder)]


def _agents_on(leaderboard: Leaderboard) -> dict[str, PolicySpec]:
    """Return the agents on a leaderboard by label, in the order of their training seeds."""
    agents = [result.policy for result in leaderboard.results if result.policy.kind == "agent"]
    agents.sort(key=lambda policy: policy.training_seed or 0)
    return {policy.label: policy for policy in agents}


def render(
    file: AgentFile,
    trainings: Sequence[PolicySpec],
    leaderboard: Leaderboard,
    across: table.Across | None,
    folder: Path,
) -> str:
    """Return the card of an agent as Markdown.

    Args:
        file: the agent of one training seed.
        trainings: the policies of all training seeds.
        leaderboard: the one on which they have played.
        across: full costs on scenarios on which it was not trained, if any.
        folder: the folder of the file.
    """
    metadata = file.metadata
    name = leaderboard.names[metadata.label]
    (standing,) = (standing for standing in leaderboard.standings if standing.name == name)
    elsewhere = {}
    if across is not None and across.tuned_for == metadata.scenario.name:
        elsewhere = dict(across.rows.get(name, {}))
        elsewhere.pop(metadata.scenario.name, None)
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=False,  # Markdown, not HTML
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    templates.filters |= {"shown": markdown_text, "few": few, "fenced": fenced}
    card = templates.get_template("model_card.md.j2").render(
        standing=standing,
        seeds=len(leaderboard.task.seeds),
        columns=columns.applying(COLUMNS, [standing]),
        elsewhere=elsewhere,
        trainings=trainings,
        metadata=metadata,
        memory_size=file.memory_size,
        ranges=_ranges(metadata.observation_space),
        classes=CLASSES,
        verdicts=table.VERDICTS,
        max_values=MAX_VALUES,
        given=TRAINING_INPUTS,
        seen=RUN_TIME_INPUTS,
        example=folder / f"{metadata.label}{ONNX_SUFFIX}",
    )
    return card + "\n"


def _ranges(space: Space) -> str:
    """Return the ranges of an observation's entries; many equal ones in a row are counted."""
    bounds = zip(space.low, space.high, strict=True)
    ranges = []
    for text, group in groupby(f"{low:g} to {high:g}" for low, high in bounds):
        count = len(list(group))
        ranges += [f"{count} times {text}"] if count > MAX_REPEATED else [text] * count
    return ", ".join(ranges)


def _agents_in(folder: Path) -> dict[str, list[AgentFile]]:
    """Return the agents of a folder by name, each by training seed."""
    agents: dict[str, list[AgentFile]] = {}
    for path in sorted(folder.glob(f"*{ONNX_SUFFIX}")):
        try:
            file = agent_file.read(path)
        except (OSError, ValueError) as error:
            raise ResultError(str(error)) from error
        metadata = file.metadata
        home = training_family(metadata.env_id, metadata.parameters) or metadata.scenario
        place = Path(metadata.env_id) / home.name / f"{metadata.label}{ONNX_SUFFIX}"
        if place.parts != path.parts[-3:]:
            raise ResultError(
                f"{path} holds {metadata.label} and should be at {place} in the folder of agents"
            )
        name = metadata.label.rpartition("-seed")[0]
        agents.setdefault(name, []).append(file)
    for files in agents.values():
        files.sort(key=lambda file: file.metadata.seed)
    return agents

"""The command ``python -m leaderboard run``: play policies, print the ranking, write the page."""

import argparse
import re
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from baselines.policy_spec import PolicySpec
from leaderboard import policies, run, table
from leaderboard.agents.agent_file import NAME
from leaderboard.family import family_task
from leaderboard.ranking import Leaderboard, read_leaderboards
from leaderboard.report import PAGE, notify_left_out, print_one_table, write_page
from leaderboard.result import ResultError, Task, result_folder, shipped_seeds, start_results
from leaderboard.seeds import held_out_seeds
from leaderboard.shared_options import (
    SPLITS_ENV_ID,
    add_json,
    add_results,
    add_workers,
    chosen_scenario,
)
from leaderboard.workers import workers
from turning_env import ALL_IDS, FAMILY_ID, SPLITS, Family, Scenario
from turning_env.console import described, positive, print_json, whole_number
from turning_env.files import digest_of
from turning_env.scenario.arguments import environment_id

DEFAULT_SEEDS = 256  # number of seeds where no results come with the project


def add_to(commands: Any) -> None:
    """Add the command to the subparsers of a command line."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "run",
        help="play policies, print the ranking and write the page",
        **described(run_policies.__doc__),
    )
    parser.set_defaults(command=run_policies)
    add_results(parser)
    add_json(parser)
    add_workers(parser)
    add = parser.add_argument
    add(
        "--agents",
        nargs="*",
        type=Path,
        default=[],
        metavar="AGENT",
        help="ONNX files, which train.export makes of training runs",
    )
    add(
        "--env",
        type=environment_id,
        choices=ALL_IDS,
        default=SPLITS_ENV_ID,
        help=f"the environment's id (default: {SPLITS_ENV_ID})",
    )
    add("--scenario", metavar="PRESET_OR_TOML", help="scenario or family instead of the id's own")
    add(
        "--seeds",
        type=_seeds,
        metavar="SEEDS",
        help="number of held-out seeds, or jobs (default: those of the results that come with the "
        f"project, else {DEFAULT_SEEDS})",
    )
    add(
        "--private-key",
        type=_private_key,
        metavar="KEY",
        help="16 characters or more that determine other seeds, and other jobs of a family; give "
        "these --results of their own",
    )
    add(
        "--policies",
        nargs="*",
        metavar="NAME",
        help="rule-based controllers (default: all that are tuned for the scenario)",
    )
    add(
        "--policy",
        type=_like(
            r"[\w.]+:[\w.]+",
            "MODULE:OBJECT, such as my_module:MyPolicy; --agents takes ONNX files",
        ),
        metavar="MODULE:OBJECT",
        help="a policy of your own code, such as my_module:MyPolicy; played again each time",
    )
    add(
        "--name",
        type=_like(NAME, "a name of at most 128 letters, digits, _, . and -"),
        help="name of your own agents or policy (default: that of the file or object, after my_ if "
        "a policy of the project has it)",
    )
    add(
        "--keep-names",
        action="store_true",
        help="let agents take the names of those that come with the project",
    )
    add(
        "--agent-time",
        type=positive,
        metavar="SECONDS",
        help="processor time [s] that an agent's file may use for all seeds; a slower one is "
        "skipped (default: 600)",
    )
    add(
        "--splits",
        action="store_true",
        help=f"also play the splits: of {SPLITS_ENV_ID} {', '.join(SPLITS)}; of a family all "
        "held-out jobs",
    )
    add(
        "--split-seeds",
        type=_seeds,
        default="32",
        metavar="SEEDS",
        help="number of held-out seeds on each split (default: 32)",
    )
    add("--fresh", action="store_true", help="play again, even if results exist")
    add(
        "--replace",
        action="store_true",
        help="let a policy replace the result of another file, or of other code, with the same "
        "name (default: refuse it)",
    )
    add("--split", metavar="NAME", help="split of a family (default: unseen_jobs)")
    add(
        "--knows",
        choices=("nominal", "true_laws"),
        default="nominal",
        help="model from which controllers of a family are built: nominal models, or these with "
        "all true laws",
    )
    add(
        "--forgets",
        action="store_true",
        help="policies of a family forget everything at each change of the edge",
    )


def run_policies(options: argparse.Namespace) -> None:
    """Play policies on held-out seeds, print one table and write the page. Existing results stay.

    Results of agents are named after their files: team1.onnx, or team1-seed3.onnx for one of
    several training seeds. An agent that is refused or fails stops no other: the command lists the
    reasons and ends with status 2.

    An empty folder starts with the results that come with the project, if they are of the same
    scenario and seeds. On RoughTurning-Family-v1, each seed is a job; controllers are built from
    each job's nominal model.

    python -m leaderboard run --seeds 16 --policies fixed_tuned predictive --jobs 2
    python -m leaderboard run --policy my_module:MyPolicy
    python -m leaderboard run --agents my-agents/ppo.onnx --private-key KEY --results private
    python -m leaderboard run --env RoughTurning-Family-v1 --policies self_tuning --knows true_laws
    """
    if options.seeds is None:
        options.seeds = held_out_seeds(_default_seeds(options))
    tasks = _tasks(options)
    refused = policies.Refusals()
    runs = []
    # Load all policies first: errors are found before anything is played.
    for task in tasks:
        # Controllers play splits as they are tuned for the scenario itself.
        tuned_on = None if task is tasks[0] else tasks[0].scenario
        runs.append(_task_run(options, task, tuned_on, refused=refused))
    failed = list(refused.values())
    for reason in failed:
        # The others play for minutes, and whoever mistyped a path need not wait for them.
        print(f"left out: {reason}", file=sys.stderr, flush=True)
    with workers(options.jobs, options.scheduler) as over:
        for task_run in runs:
            start_results(task_run.folder, task_run.task)
        try:
            run.play_all(runs, options.fresh, over, replace=options.replace)
        except run.PoliciesFailedError as error:
            failed += error.reasons
    try:
        ranked_tasks = {task_run.folder: task_run.task for task_run in runs}
        leaderboards = read_leaderboards(options.results, ranked_tasks)
    except ResultError as error:
        # That there are no results follows from the failures, so these are the message.
        raise ResultError(_failures(failed or [error])) from None
    _report(leaderboards, runs, options)
    if failed:
        raise ResultError(_failures(failed))


def _default_seeds(options: argparse.Namespace) -> int:
    """Return the number of seeds on which a policy ranks among those that come with the project."""
    if options.env == FAMILY_ID:
        return DEFAULT_SEEDS
    return shipped_seeds(options.env, chosen_scenario(options).name) or DEFAULT_SEEDS


def _tasks(options: argparse.Namespace) -> list[Task]:
    """Return the tasks to play, on public seeds.

    Jobs of a family are those of the private key, if there is one.
    """
    if options.env == FAMILY_ID:
        return _family_tasks(options)
    if options.split or options.forgets or options.knows != "nominal":
        raise ResultError(
            f"--split, --knows and --forgets are of {FAMILY_ID}, not of {options.env}"
        )
    task = Task(env_id=options.env, scenario=chosen_scenario(options), seeds=options.seeds)
    if not options.splits:
        return [task]
    if options.env != SPLITS_ENV_ID:
        raise ResultError(
            f"there are no splits of {options.env}, only of {SPLITS_ENV_ID} and {FAMILY_ID}"
        )
    tasks = [task]
    for name in SPLITS:
        changes = {"scenario": Scenario.load(name), "seeds": options.split_seeds}
        tasks.append(task.model_copy(update=changes))
    return tasks


def _family_tasks(options: argparse.Namespace) -> list[Task]:
    """Return the tasks on a family to play: that on the given split, and those on all others."""
    family = Family.load(options.scenario or "shop")
    if options.private_key:
        # The key determines the jobs of all splits but the training jobs.
        values = family.model_dump(exclude_none=True) | {"held_out_key": options.private_key}
        family = Family.load(values)
    num_jobs = len(options.seeds)
    tasks = [family_task(family, options.split, num_jobs)]
    if options.splits:
        for split in family.splits:
            if split in ("train", "validation"):
                continue
            task = family_task(family, split, num_jobs)
            # The first task may be one of them.
            if task.digest != tasks[0].digest:
                tasks.append(task)
    return tasks


def _task_run(
    options: argparse.Namespace,
    task: Task,
    tuned_on: Scenario | None,
    refused: policies.Refusals,
) -> run.TaskRun:
    """Load the policies that play a task; add agents that cannot to ``refused``."""
    private = None
    if options.private_key:
        private = run.private_seeds(options.private_key, len(task.seeds))
        # The task names the seeds by their places and their digest.
        changes = {"seeds": list(range(len(private))), "private": digest_of(private)}
        task = task.model_copy(update=changes)
    agents = policies.agents(
        options.agents,
        task,
        name=options.name,
        keep=options.keep_names,
        seconds=options.agent_time,
        refused=refused,
        forgets=options.forgets,
    )
    code_policies = []
    if options.policy:
        policy = policies.policy_of_code(options.policy, task, options.name)
        if policy.label in {agent.label for agent in agents}:
            raise ResultError(
                f"{options.policy} and an agent's file are both called {policy.label}: "
                "rename the file"
            )
        code_policies.append(policy)
    controllers = policies.named(
        options.policies,
        task,
        tuned_on=tuned_on,
        skip=True,
        knows=options.knows,
        forgets=options.forgets,
    )
    chosen: list[PolicySpec] = [*controllers, *agents, *code_policies]
    if not chosen:
        advice = "name a policy that is tuned for the scenario, or give an agent"
        nothing = ResultError(f"nothing to play: {advice}")
        raise ResultError(_failures(list(refused.values()) or [nothing]))
    folder = result_folder(options.results, task.env_id, task.scenario.name)
    return run.TaskRun(task, chosen, folder=folder, private=private)


def _report(
    leaderboards: Sequence[Leaderboard],
    runs: Sequence[run.TaskRun],
    options: argparse.Namespace,
) -> None:
    """Print one table of what was played and write the page of all rankings.

    The last lines say where the agents stand, what prints the rest, and where the page is.
    """
    digests = {task_run.task.digest for task_run in runs}
    played = [leaderboard for leaderboard in leaderboards if leaderboard.task.digest in digests]
    if options.json:
        print_json(table.as_data(played))
    else:
        print_one_table(played)
    notify_left_out(played)
    path = options.results / PAGE
    write_page(leaderboards, path)
    notes = sys.stderr if options.json else sys.stdout
    labels = {policy.label for task_run in runs for policy in task_run.policies}
    for leaderboard in played:
        lines = table.agent_places(leaderboard, labels) + table.same_returns(leaderboard, labels)
        for line in lines:
            print(line, file=notes)
    rest = "all numbers" if len(played) == 1 else f"all {len(played)} rankings"
    print(f"{rest}: {_show_command(options.results, played)}", file=notes)
    print(f"wrote {path}", file=notes)


def _show_command(results: Path, leaderboards: Sequence[Leaderboard]) -> str:
    """Return the command that prints all numbers of leaderboards."""
    words = ["python", "-m", "leaderboard", "show", "--results", str(results)]
    if len(leaderboards) == 1:
        task = leaderboards[0].task
        words += ["--env", task.env_id, "--scenario", task.scenario.name]
    else:
        words.append("--all")
        env_ids = {leaderboard.task.env_id for leaderboard in leaderboards}
        if len(env_ids) == 1:
            words += ["--env", *env_ids]
    return shlex.join(words)


def _failures(reasons: Sequence[ResultError]) -> str:
    """Return the reason why a policy did not play, or a list of several."""
    if len(reasons) == 1:
        return str(reasons[0])
    lines = [f"- {reason}" for reason in reasons]
    return "\n".join([f"{len(reasons)} reasons:", *lines])


def _seeds(text: str) -> list[int]:
    """Return held-out seeds, as an argparse type: their number."""
    try:
        return held_out_seeds(whole_number(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _private_key(text: str) -> str:
    """Return a private key, as an argparse type: seeds are derived from its bytes in UTF-8."""
    if not text.isprintable():
        raise argparse.ArgumentTypeError("a private key must consist of printable characters")
    return text


def _like(pattern: str, meaning: str) -> Callable[[str], str]:
    """Return an argparse type: a text of a pattern."""

    def checked(text: str) -> str:
        if not re.fullmatch(pattern, text):
            raise argparse.ArgumentTypeError(f"{text!r} is not {meaning}")
        return text

    return checked

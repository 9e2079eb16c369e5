"""Rank policies on the same held-out seeds.

    python -m leaderboard run --seeds 16 --policies fixed_tuned predictive
    python -m leaderboard show --results leaderboard/results

``python -m leaderboard COMMAND --help`` explains a command, with an example.
"""

import argparse
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from leaderboard import pack, policies, run, table, verify
from leaderboard.family import family_task
from leaderboard.ranking import Leaderboard, read_leaderboard, read_leaderboards
from leaderboard.result import (
    MANIFEST_FILE,
    RESULTS,
    ResultError,
    Task,
    result_folder,
    start_results,
    write_whole,
)
from train.agents.agent_file import NAME
from turning_env import FAMILY_ID, IDS, SPLITS, Family, Scenario, ScenarioError
from turning_env.console import DONE, FAILED, described, exits, print_json, printable
from turning_env.files import digest_of
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.workers import WorkersError, workers

PAGE = "index.html"
SPLITS_ENV_ID = "RoughTurning-v0"  # the id that has splits


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int | None] = options.command
    goes_on = "interrupted: finished results are kept; run the same command again to go on"
    ended = exits(
        ResultError, ScenarioError, WorkersError, interrupted=goes_on, checks=command is _verify
    )
    return ended(lambda: command(options) or DONE)()


def _run(options: argparse.Namespace) -> None:
    """Play policies on held-out seeds, then print the ranking and write the page. Results that exist are kept.

    Results of agents are named after their files: team1.onnx, or team1-seed3.onnx for one of several training seeds. An agent
    that is refused or fails stops no other: the command lists the reasons and ends with status 2.

    An empty folder starts with the results that come with the project, if they are of the same scenario and seeds. Of
    RoughTurning-Family-v0, each seed is a job; controllers are built from each job's nominal model.

    python -m leaderboard run --seeds 16 --policies fixed_tuned predictive --jobs 2
    python -m leaderboard run --policy my_module:MyPolicy
    python -m leaderboard run --agents my-agents/ppo-seed1.onnx --private-key KEY --results private_results
    python -m leaderboard run --env RoughTurning-Family-v0 --policies self_tuning --knows true_laws --seeds 16
    """
    tasks = [
        _private(task, options.private_key) if options.private_key else (task, None)
        for task in _tasks(options)
    ]
    runs, refused = [], policies.Refusals()
    for (
        task,
        private,
    ) in tasks:  # load all policies first, so that errors are found before anything is played
        tuned_on = None if task is tasks[0][0] else tasks[0][0].scenario
        agents = policies.agents(
            options.agents,
            task,
            name=options.name,
            keep=options.keep_names,
            seconds=options.agent_time,
            refused=refused,
            forgets=options.forgets,
        )
        own = [policies.own_policy(options.policy, task, options.name)] if options.policy else []
        if {spec.label for spec in own} & {spec.label for spec in agents}:
            raise ResultError(
                f"{options.policy} and an agent's file are both called {own[0].label}: rename the file"
            )
        rules = policies.named(
            options.policies, task, tuned_on, True, options.knows, options.forgets
        )
        if not (chosen := [*rules, *agents, *own]):
            nothing = ResultError(
                "nothing to play: name a policy that is tuned for the scenario, or give an agent"
            )
            raise ResultError(_failures(list(refused.values()) or [nothing]))
        runs.append(
            run.TaskRun(
                task,
                chosen,
                result_folder(options.results, task.env_id, task.scenario.name),
                private,
            )
        )
    failed = list(refused.values())
    with workers(options.jobs, options.scheduler) as over:
        for each in runs:
            start_results(each.folder, each.task)
        try:
            run.play_all(runs, options.fresh, over, replace=options.replace)
        except run.PoliciesFailedError as error:
            failed += error.reasons
    try:
        leaderboards = read_leaderboards(options.results, {each.folder: each.task for each in runs})
    except ResultError as error:
        raise ResultError(_failures(failed or [error])) from None
    asked = {task.digest for task, _ in tasks}
    played = [each for each in leaderboards if each.task.digest in asked]
    _print(played, options.json)
    path = options.results / PAGE
    _write_page(leaderboards, path)
    notes = sys.stderr if options.json else sys.stdout
    print(f"wrote {path}", file=notes)
    labels = {spec.label for each in runs for spec in each.policies}
    for line in (line for each in played for line in table.agent_places(each, labels)):
        print(line, file=notes)
    if failed:
        raise ResultError(_failures(failed))


def _failures(reasons: Sequence[ResultError]) -> str:
    """Return the reason why a policy did not play, or a list of several."""
    if len(reasons) == 1:
        return str(reasons[0])
    return "\n".join([f"{len(reasons)} reasons:", *(f"- {reason}" for reason in reasons)])


def _tasks(options: argparse.Namespace) -> list[Task]:
    """Return the tasks to play, on public seeds; jobs of a family are those of the private key, if there is one."""
    if options.env == FAMILY_ID:
        family = Family.load(options.scenario or "shop")
        if options.private_key:
            family = Family.load(
                family.model_dump(exclude_none=True) | {"held_out_key": options.private_key}
            )
        first = family_task(family, options.split, len(options.seeds))
        held_out = (
            [split for split in family.splits if split not in ("train", "validation")]
            if options.splits
            else []
        )
        others = [family_task(family, split, len(options.seeds)) for split in held_out]
        return [first, *(each for each in others if each.digest != first.digest)]
    if options.split or options.forgets or options.knows != "nominal":
        raise ResultError(
            f"--split, --knows and --forgets are of {FAMILY_ID}, not of {options.env}"
        )
    if options.splits and options.env != SPLITS_ENV_ID:
        raise ResultError(
            f"there are no splits of {options.env}, only of {SPLITS_ENV_ID} and {FAMILY_ID}"
        )
    splits = [Scenario.load(name) for name in SPLITS] if options.splits else []
    task = Task(env_id=options.env, scenario=_scenario(options), seeds=options.seeds)
    return [
        task,
        *(
            task.model_copy(update={"scenario": each, "seeds": options.split_seeds})
            for each in splits
        ),
    ]


def _private(task: Task, key: str) -> tuple[Task, list[int]]:
    """Return a task on the seeds of a private key, which names their places and their digest, and the seeds."""
    seeds = run.private_seeds(key, len(task.seeds))
    return task.model_copy(
        update={"seeds": list(range(len(seeds))), "private": digest_of(seeds)}
    ), seeds


def _show(options: argparse.Namespace) -> None:
    """Print the ranking of one environment on one scenario: the first that there is, or the first of an id; or all rankings.

    python -m leaderboard show --results leaderboard/results
    python -m leaderboard show --results leaderboard/results --env RoughTurning-Family-v0 --all --json
    python -m leaderboard show --results leaderboard/results --markdown mean_return overload_share --policies predictive ppo
    """
    leaderboards = read_leaderboards(
        options.results,
        env_id=options.env,
        scenarios=options.scenario,
        max_count=None if options.all else 1,
    )
    if options.markdown is not None:
        print(table.selection(leaderboards, options.markdown, options.policies))
        return
    _print(leaderboards, options.json)
    if not options.all and len(list(options.results.glob(f"*/*/{MANIFEST_FILE}"))) > 1:
        print("--all prints the other leaderboards", file=sys.stderr)


def _pack(options: argparse.Namespace) -> None:
    """Move the results of each leaderboard into one file, and put the returns into the wheel, for ``turning_env.score``.

    python -m leaderboard pack --results results
    python -m leaderboard pack --without lagrangian_ppo
    """
    folders = sorted(path.parent for path in options.results.glob(f"*/*/{MANIFEST_FILE}"))
    if not folders:
        raise ResultError(f"{options.results} holds no results")
    for folder in folders:
        if pack.pack(folder, options.without):
            print(f"packed {folder}")
    if options.results.resolve() == RESULTS:
        for path in pack.write_shipped(RESULTS):
            print(f"wrote {path}")


def _page(options: argparse.Namespace) -> None:
    """Write all rankings as one HTML file.

    python -m leaderboard page --results leaderboard/results --out page.html
    """
    path = options.out or options.results / PAGE
    _write_page(read_leaderboards(options.results), path)
    print(f"wrote {path}")


def _figure(options: argparse.Namespace) -> None:
    """Draw the ranking for print.

    python -m leaderboard figure --results leaderboard/results --out docs/leaderboard.png
    """
    from leaderboard import figure  # needed only here: imports Matplotlib

    figure.write(
        read_leaderboard(result_folder(options.results, options.env, _scenario(options).name)),
        options.out,
    )
    print(f"wrote {options.out}")


def _verify(options: argparse.Namespace) -> int:
    """Play results again. The exit status is 1 if a number differs. ``--check`` plays nothing.

    python -m leaderboard verify --check
    python -m leaderboard verify --seeds 4 --jobs 2
    python -m leaderboard verify --env RoughTurning-Surface-v1 --jobs 2
    """
    selection = verify.Selection(options.env, options.scenario, options.policies)
    if options.check:
        complaints, passed = (
            verify.check(options.results, options.agents, selection),
            "every result is valid",
        )
    else:
        if options.fresh:
            options.memory.unlink(missing_ok=True)
        with workers(options.jobs, options.scheduler) as over:
            complaints = verify.verify(
                options.results, options.agents, selection, options.memory, options.seeds, over
            )
        passed = (
            "every result came back"
            if options.seeds is None
            else "the shortest episodes of every result came back"
        )
    print(
        *map(printable, complaints),
        f"{len(complaints)} complaints" if complaints else passed,
        sep="\n",
    )
    return FAILED if complaints else DONE


def _cards(options: argparse.Namespace) -> None:
    """Write the model card of every agent in the agents' folder.

    python -m leaderboard cards --results leaderboard/results --agents agents
    """
    from leaderboard import cards  # needed only here: imports Jinja2 and ONNX

    for path in cards.write_all(options.results, options.agents):
        print(f"wrote {path}")


def _scenario(options: argparse.Namespace) -> Scenario:
    return Scenario.load(options.scenario or IDS[options.env])


def _print(leaderboards: Sequence[Leaderboard], as_json: bool) -> None:
    if as_json:
        print_json(table.as_data(leaderboards))
    else:
        for each in leaderboards:
            print(table.render(each) + "\n")
        if (across := table.across(leaderboards)) is not None:
            print(table.render_across(across) + "\n")
    if left_out := [str(path) for each in leaderboards for path in each.left_out]:
        print(
            printable(
                f"left out, as scenario values, seeds or versions differ: {', '.join(left_out)}"
            ),
            file=sys.stderr,
        )


def _write_page(leaderboards: Sequence[Leaderboard], path: Path) -> None:
    from leaderboard import page  # needed only here: imports Jinja2

    write_whole(path, page.render(leaderboards))


def _seeds(text: str) -> list[int]:
    try:
        return held_out_seeds(int(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _like(pattern: str, meaning: str) -> Callable[[str], str]:
    """Return an argparse type: a text of a pattern."""

    def checked(text: str) -> str:
        if not re.fullmatch(pattern, text):
            raise argparse.ArgumentTypeError(f"{text!r} is not {meaning}")
        return text

    return checked


def positive(text: str) -> int:
    """Return a whole number above 0, as an argparse type."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    def shared(*names: str, **options: Any) -> argparse.ArgumentParser:
        parser = argparse.ArgumentParser(add_help=False)
        parser.add_argument(*names, **options)
        return parser

    parser = argparse.ArgumentParser(prog="python -m leaderboard", **described(__doc__))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(
        does: Callable[[argparse.Namespace], int | None],
        brief: str,
        *parents: argparse.ArgumentParser,
    ) -> Any:
        name = does.__name__.removeprefix("_")
        added = commands.add_parser(name, parents=parents, help=brief, **described(does.__doc__))
        added.set_defaults(command=does)
        return added.add_argument

    which = "folder of results (default: results; the project's own are in leaderboard/results)"
    results = shared("--results", type=Path, default=Path("results"), help=which)
    project = shared(
        "--results",
        type=Path,
        default=Path("leaderboard/results"),
        help="folder of results (default: %(default)s)",
    )
    agents_folder = shared(
        "--agents",
        type=Path,
        default=Path("agents"),
        help="folder of agents' ONNX files (default: agents)",
    )
    printed = shared(
        "--json", action="store_true", help="print JSON with all numbers and their units"
    )
    ids = [*IDS, FAMILY_ID]
    elsewhere = argparse.ArgumentParser(add_help=False)
    who = elsewhere.add_mutually_exclusive_group()
    who.add_argument(
        "--jobs", type=positive, default=1, metavar="N", help="number of processes (default: 1)"
    )
    who.add_argument(
        "--scheduler",
        metavar="URL",
        help="play on the workers of a Dask cluster, such as tcp://host:8786",
    )

    add = command(
        _run, "play policies, print the ranking and write the page", results, printed, elsewhere
    )
    add(
        "--agents",
        nargs="*",
        type=Path,
        default=[],
        metavar="AGENT",
        help="ONNX files, or run folders of your own",
    )
    add(
        "--env",
        choices=ids,
        default=SPLITS_ENV_ID,
        help=f"the environment's id (default: {SPLITS_ENV_ID})",
    )
    add("--scenario", metavar="PRESET_OR_TOML", help="scenario or family instead of the id's own")
    add(
        "--seeds",
        type=_seeds,
        default="256",
        metavar="SEEDS",
        help="number of held-out seeds, or jobs (default: 256)",
    )
    which = "16 characters or more that determine other seeds, and other jobs of a family; give these --results of their own"
    add("--private-key", metavar="KEY", help=which)
    add(
        "--policies",
        nargs="*",
        metavar="NAME",
        help="rule-based controllers (default: all that are tuned for the scenario)",
    )
    own_code = _like(
        r"[\w.]+:[\w.]+", "MODULE:OBJECT, such as my_module:MyPolicy; --agents takes ONNX files"
    )
    name = _like(NAME, "a name of at most 128 letters, digits, _, . and -")
    which = "a policy of your own code, such as my_module:MyPolicy; played again each time"
    add("--policy", type=own_code, metavar="MODULE:OBJECT", help=which)
    which = "name of your own agents or policy (default: that of the file or object, after my_ if a policy of the project has it)"
    add("--name", type=name, help=which)
    add(
        "--keep-names",
        action="store_true",
        help="let agents take the names of those that come with the project",
    )
    which = "processor time [s] that an agent's file may use for all seeds; a slower one is skipped (default: 600)"
    add("--agent-time", type=positive, metavar="SECONDS", help=which)
    which = f"also play the splits: of {SPLITS_ENV_ID} {', '.join(SPLITS)}; of a family all held-out jobs"
    add("--splits", action="store_true", help=which)
    which = "number of held-out seeds on each split (default: 32)"
    add("--split-seeds", type=_seeds, default="32", metavar="SEEDS", help=which)
    add("--fresh", action="store_true", help="play again, even if results exist")
    which = "let a policy take the place of another file's result, or other code's, of the same name (default: refuse it)"
    add("--replace", action="store_true", help=which)
    add("--split", metavar="NAME", help="split of a family (default: unseen_jobs)")
    which = "what controllers of a family are built from: nominal models, or these with the true wear law or all true laws"
    add(
        "--knows",
        choices=("nominal", "true_wear", "true_forms", "true_laws"),
        default="nominal",
        help=which,
    )
    add(
        "--forgets",
        action="store_true",
        help="policies of a family forget everything at each change of the edge",
    )

    add = command(_show, "print the ranking", results, printed)
    add(
        "--env",
        choices=ids,
        help=f"the environment's id (default: {SPLITS_ENV_ID}, if it has results)",
    )
    which = "names of scenarios (default: the id's own) or families, perhaps with a split, such as shop-unseen_jobs"
    add("--scenario", nargs="+", default=[], metavar="NAME", help=which)
    add(
        "--all",
        action="store_true",
        help="print all rankings, of all ids and scenarios unless one is named",
    )
    which = "print one Markdown table of these numbers, as --json calls them; without any, of full costs over splits"
    add("--markdown", nargs="*", choices=table.COLUMNS, metavar="NUMBER", help=which)
    add(
        "--policies",
        nargs="+",
        default=[],
        metavar="NAME",
        help="policies in that table (default: all)",
    )
    add = command(_page, "write all rankings as one HTML file", results)
    add("--out", type=Path, metavar="FILE", help="page to write (default: RESULTS/index.html)")

    add = command(_pack, "move the results of each leaderboard into one file", project)
    add(
        "--without",
        nargs="+",
        default=[],
        metavar="NAME",
        help="policies whose results are deleted",
    )
    add = command(
        _verify, "play results again; fail if any differs", project, agents_folder, elsewhere
    )
    add("--env", choices=ids, help="only results of this id")
    add("--scenario", metavar="NAME", help="only results on this scenario")
    add("--policies", nargs="+", metavar="NAME", help="only results of these policies")
    add(
        "--seeds",
        type=positive,
        metavar="N",
        help="play only the N shortest episodes of each result",
    )
    which = "play nothing: compare versions, scenario values, parameters and agents' files"
    add("--check", action="store_true", help=which)
    add(
        "--fresh",
        action="store_true",
        help="also play again what was verified before an interruption",
    )
    memory, which = (
        Path("results/verified.json"),
        "file of the results verified so far, so that the same command resumes",
    )
    add("--memory", type=Path, default=memory, metavar="FILE", help=f"{which} (default: {memory})")

    command(_cards, "write the model card of every agent", project, agents_folder)
    add = command(_figure, "draw the ranking for print", results)
    add("--env", choices=IDS, default=SPLITS_ENV_ID, help="the environment's id")
    add("--scenario", metavar="PRESET_OR_TOML", help="scenario instead of the id's own")
    picture = Path("docs/leaderboard.png")
    add("--out", type=Path, default=picture, help=f"picture to write (default: {picture})")
    return parser


if __name__ == "__main__":
    sys.exit(main())

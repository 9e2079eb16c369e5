"""Rank policies on common draws.

    python -m leaderboard run --seeds 16 --policies fixed_tuned predictive
    python -m leaderboard show --results leaderboard/results

Each command has a help of its own, with an example.
"""

import argparse
import contextlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from leaderboard import generalisation, machine_readable, table
from leaderboard.private_seeds import PUBLIC, PrivateSeeds
from leaderboard.ranking import Leaderboard, read_leaderboard, read_leaderboards
from leaderboard.result import ResultError, Task, result_folder
from turning_env import IDS, SPLITS, Scenario, ScenarioError
from turning_env.console import DONE, FAILED, described, exits, print_json
from turning_env.score.seeds import held_out_seeds
from turning_env.score.workers import WorkersError, workers

PAGE = "index.html"
SHIPPED = Path("leaderboard/results")
"""The results that come with the project."""
SPLITS_ENV_ID = "RoughTurning-v0"
"""Of which there are splits."""


_RUN = """Play policies on held-out seeds, then print the ranking and write the page. What has been played is not played again.

    python -m leaderboard run --seeds 16 --policies fixed_tuned predictive
    python -m leaderboard run --agents my-agents/ppo-seed1.onnx --jobs 2
    python -m leaderboard run --agents my-agents/ppo-seed1.onnx --seeds private_seeds.txt --results private_results
"""
_SHOW = """Print the ranking of every environment and scenario that the results' folder holds.

    python -m leaderboard show --results leaderboard/results
    python -m leaderboard show --results leaderboard/results --json
"""
_PAGE = """Write all rankings as one HTML file.

    python -m leaderboard page --results leaderboard/results --out page.html
"""
_VERIFY = """Play the project's own results again. The exit status is 1 if a number does not come back bit for bit.

    python -m leaderboard verify --seeds 4
    python -m leaderboard verify --env RoughTurning-Surface-v0 --jobs 2
"""
_CARDS = """Write the model card of every agent in the agents' folder.

    python -m leaderboard cards --results leaderboard/results --agents agents
"""
_FIGURE = """Draw the ranking for print.

    python -m leaderboard figure --results leaderboard/results --out docs/leaderboard.png
"""
_GALLERY = """Draw what a few policies do on the same bars.

    python -m leaderboard gallery --policies grid_search predictive --seeds 3 --out docs/gallery
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    command: Callable[[argparse.Namespace], int | None] = options.command
    goes_on = "interrupted: what is finished is kept, and the same command goes on from there"
    ended = exits(ResultError, ScenarioError, WorkersError, interrupted=goes_on, checks=command is _verify)
    return ended(lambda: command(options) or DONE)()


def _run(options: argparse.Namespace) -> None:
    from leaderboard import run  # needed only here: plays

    task, private = _task(options)
    tasks = [task, *(_splits(task, options.split_seeds) if options.splits else [])]
    runs = []
    for each in tasks:  # all of them first: what cannot be played is found before anything is
        policies = [
            *run.named(options.policies, each.scenario, None if each is task else task.scenario),
            *run.agents(options.agents, each.scenario),
        ]
        if not policies:
            raise ResultError("there is nothing to play: name a policy or give an agent")
        runs.append(run.TaskRun(each, policies, result_folder(options.results, each.env_id, each.scenario.name), private))
    played = {each.folder: each.task for each in runs}
    with workers(options.jobs, options.scheduler) as over:
        try:
            run.play_all(runs, options.fresh, over)
        except run.PoliciesFailed:
            ranked = []
            for folder, its_task in played.items():
                with contextlib.suppress(ResultError):  # where nobody could play there is nothing to show
                    ranked.append(read_leaderboard(folder, its_task))
            _print(ranked, options.json)
            raise
    _print([read_leaderboard(folder, its_task) for folder, its_task in played.items()], options.json)
    path = options.results / PAGE
    _write_page(read_leaderboards(options.results, played), path)
    print(f"wrote {path}", file=sys.stderr if options.json else sys.stdout)


def _task(options: argparse.Namespace) -> tuple[Task, PrivateSeeds | None]:
    """What is played, and the seeds of the draws if these are private."""
    given = options.seeds
    task = Task(env_id=options.env, scenario=_scenario(options), seeds=[] if isinstance(given, Path) else given)
    if not isinstance(given, Path):
        return task, None
    private = PrivateSeeds.read(given)
    if options.splits:
        raise ResultError("splits are played on held-out seeds: give --scenario and --seeds FILE for each of them")
    if private.public:
        print(f"warning: {private.public} seeds of {given} are below {PUBLIC}, and so no secret", file=sys.stderr)
    return private.task_of(task), private


def _splits(task: Task, seeds: list[int]) -> list[Task]:
    """The tasks on which policies made for the task's scenario meet, on these draws, what they were not made for."""
    if task.env_id != SPLITS_ENV_ID:
        raise ResultError(f"there are no splits of {task.env_id}, only of {SPLITS_ENV_ID}")
    return [task.model_copy(update={"scenario": Scenario.load(name), "seeds": seeds}) for name in SPLITS]


def _show(options: argparse.Namespace) -> None:
    _print(read_leaderboards(options.results), options.json)


def _page(options: argparse.Namespace) -> None:
    path = options.out or options.results / PAGE
    _write_page(read_leaderboards(options.results), path)
    print(f"wrote {path}")


def _figure(options: argparse.Namespace) -> None:
    from leaderboard import figure  # needed only here: imports Matplotlib

    figure.write(read_leaderboard(result_folder(options.results, options.env, _scenario(options).name)), options.out)
    print(f"wrote {options.out}")


def _gallery(options: argparse.Namespace) -> None:
    from leaderboard import behaviour, gallery, run  # needed only here: imports Matplotlib, plays

    scenario = _scenario(options)
    players = [*run.named(options.policies, scenario), *run.agents(options.agents, scenario)]
    courses = gallery.play(players, scenario, options.seeds)
    written = gallery.write(courses, options.out)
    if options.json:
        told = {"env_id": options.env, "scenario": scenario.name, "seeds": options.seeds, "policies": behaviour.as_json(courses)}
        print_json(told)
        return
    print(behaviour.render(courses))
    for path in written:
        print(f"wrote {path}")
    if left_out := [name for name in gallery.PICTURES if options.out / name not in written]:
        print(f"not drawn, as there is nothing of it to see: {', '.join(left_out)}")


def _verify(options: argparse.Namespace) -> int:
    from leaderboard import verify  # needed only here: plays

    selection = verify.Selection(options.env, options.scenario, options.policies)
    if options.check:
        complaints = verify.check(options.results, options.agents, selection)
        for complaint in complaints:
            print(complaint)
        print(f"{len(complaints)} complaints" if complaints else "every result is valid")
        return FAILED if complaints else DONE
    if options.fresh:
        options.memory.unlink(missing_ok=True)
    with workers(options.jobs, options.scheduler) as over:
        complaints = verify.verify(options.results, options.agents, selection, options.memory, options.seeds, over)
    for complaint in complaints:
        print(complaint)
    what = "every result" if options.seeds is None else "the start of every result"
    print(f"{len(complaints)} complaints" if complaints else f"{what} came back")
    return FAILED if complaints else DONE


def _cards(options: argparse.Namespace) -> None:
    from leaderboard import cards  # needed only here: imports Jinja2 and ONNX

    for path in cards.write_all(options.results, options.agents):
        print(f"wrote {path}")


def _scenario(options: argparse.Namespace) -> Scenario:
    return Scenario.load(options.scenario or IDS[options.env])


def _print(leaderboards: Sequence[Leaderboard], as_json: bool) -> None:
    if as_json:
        print_json(machine_readable.as_data(leaderboards))
    for each in leaderboards:
        if not as_json:
            print(table.render(each) + "\n")
        if each.left_out:
            names = ", ".join(str(path) for path in each.left_out)
            why = "they are of other scenario values, seeds or versions"
            print(f"left out, as {why}: {names}", file=sys.stderr)
    if not as_json and (across := generalisation.across(leaderboards)) is not None:
        print(generalisation.render(across) + "\n")


def _write_page(leaderboards: Sequence[Leaderboard], path: Path) -> None:
    from leaderboard import page  # needed only here: imports Jinja2

    page.write(leaderboards, path)


def _seeds(text: str) -> list[int]:
    try:
        return held_out_seeds(int(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _seeds_or_file(text: str) -> list[int] | Path:
    if text.lstrip("+-").isdecimal():
        return _seeds(text)
    if not Path(text).suffix and not Path(text).is_file():  # a file that is missing is an error of its own
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number of held-out seeds nor a file of private ones")
    return Path(text)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m leaderboard", **described(__doc__))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    results = argparse.ArgumentParser(add_help=False)
    results.add_argument(
        "--results",
        type=Path,
        default=Path("results"),
        help="folder of the results (default: results; leaderboard/results holds those that come with the project)",
    )
    printed = argparse.ArgumentParser(add_help=False)
    printed.add_argument("--json", action="store_true", help="print JSON, with all numbers and their units")
    environment = argparse.ArgumentParser(add_help=False)
    environment.add_argument("--env", choices=IDS, default="RoughTurning-v0", help="the environment's id")
    environment.add_argument("--scenario", metavar="PRESET_OR_TOML", help="scenario instead of the id's own preset")

    elsewhere = argparse.ArgumentParser(add_help=False)
    who = elsewhere.add_mutually_exclusive_group()
    who.add_argument("--jobs", type=_positive, default=1, metavar="N", help="processes that play at the same time (default: 1)")
    who.add_argument("--scheduler", metavar="URL", help="have the workers of a Dask cluster play, such as tcp://host:8786")

    run = commands.add_parser(
        "run", parents=[results, printed, environment, elsewhere], help="play policies, then show and page", **described(_RUN)
    )
    which = (
        "number of held-out seeds (default: 256), or a file of private ones, whose results should go to --results of their own"
    )
    run.add_argument("--seeds", type=_seeds_or_file, default="256", metavar="SEEDS", help=which)
    run.add_argument("--policies", nargs="*", metavar="NAME", help="rule-based controllers (default: all)")
    run.add_argument("--agents", nargs="*", type=Path, default=[], metavar="AGENT", help="ONNX files, or run folders of your own")
    run.add_argument("--splits", action="store_true", help=f"also play the splits: {', '.join(SPLITS)}")
    on_each = "number of held-out seeds of each split (default: 32)"
    run.add_argument("--split-seeds", type=_seeds, default="32", metavar="SEEDS", help=on_each)
    run.add_argument("--fresh", action="store_true", help="play again what has been played")
    run.set_defaults(command=_run)

    show = commands.add_parser("show", parents=[results, printed], help="print the ranking", **described(_SHOW))
    show.set_defaults(command=_show)

    page = commands.add_parser("page", parents=[results], help="write all rankings as one HTML file", **described(_PAGE))
    page.add_argument("--out", type=Path, metavar="FILE", help="where it is written (default: RESULTS/index.html)")
    page.set_defaults(command=_page)

    shipped = argparse.ArgumentParser(add_help=False)
    shipped.add_argument("--results", type=Path, default=SHIPPED, help="folder of the results (default: leaderboard/results)")
    shipped.add_argument("--agents", type=Path, default=Path("agents"), help="agents' ONNX files (default: agents)")

    verify = commands.add_parser(
        "verify",
        parents=[shipped, elsewhere],
        help="play the project's own results again; fail if any differs",
        **described(_VERIFY),
    )
    verify.add_argument("--env", choices=IDS, help="only of this id")
    verify.add_argument("--scenario", metavar="NAME", help="only on this scenario")
    verify.add_argument("--policies", nargs="+", metavar="NAME", help="only of these policies")
    quick = "a quick look: only the first seeds of each result"
    verify.add_argument("--seeds", type=_positive, metavar="N", help=quick)
    verify.add_argument("--check", action="store_true", help="play nothing: see that results are of today's versions and values")
    verify.add_argument("--fresh", action="store_true", help="play again also what came back before an interruption")
    memory = "where it is kept what came back, until all has (default: results/verified.json)"
    verify.add_argument("--memory", type=Path, default=Path("results/verified.json"), metavar="FILE", help=memory)
    verify.set_defaults(command=_verify)

    cards = commands.add_parser("cards", parents=[shipped], help="write the model card of every agent", **described(_CARDS))
    cards.set_defaults(command=_cards)

    figure = commands.add_parser(
        "figure", parents=[results, environment], help="draw the ranking for print", **described(_FIGURE)
    )
    figure.add_argument("--out", type=Path, default=Path("docs/leaderboard.png"), help="picture (default: docs/leaderboard.png)")
    figure.set_defaults(command=_figure)

    gallery = commands.add_parser(
        "gallery", parents=[environment], help="draw what a few policies do on the same bars", **described(_GALLERY)
    )
    gallery.add_argument("--seeds", type=_seeds, default="3", help="number of held-out seeds (default: 3)")
    gallery.add_argument("--policies", nargs="*", default=[], metavar="NAME", help="rule-based controllers")
    gallery.add_argument("--agents", nargs="*", type=Path, default=[], metavar="AGENT", help="ONNX files, or run folders")
    gallery.add_argument("--out", type=Path, default=Path("docs/gallery"), help="folder of pictures (default: docs/gallery)")
    gallery.add_argument("--json", action="store_true", help="print the numbers for machines")
    gallery.set_defaults(command=_gallery)
    return parser


if __name__ == "__main__":
    sys.exit(main())

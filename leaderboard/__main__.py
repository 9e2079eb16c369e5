"""Rank policies on common draws.

    python -m leaderboard run --draws 16 --policies fixed_tuned predictive
    python -m leaderboard show --results leaderboard/results

Each command has a help of its own, with an example.
"""

import argparse
import contextlib
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from leaderboard import generalisation, machine_readable, table
from leaderboard.board import Board, read_board, read_boards
from leaderboard.private_seeds import PUBLIC, PrivateDraws
from leaderboard.result import ResultError, Task, current_digests, result_folder
from turning_env import IDS, SPLITS, Scenario, ScenarioError
from turning_env.console import DONE, FAILED, described, exits, print_json
from turning_env.score.seeds import held_out_seeds
from turning_env.score.workers import WorkersError, workers

PAGE = "index.html"
SPLITS_ENV_ID = "RoughTurning-v0"
"""Of which there are splits."""


_RUN = """Play policies on held-out draws, then print the ranking and write the page. What has been played is not played again.

    python -m leaderboard run --draws 16 --policies fixed_tuned predictive
    python -m leaderboard run --agents my-agents/ppo-seed1.onnx --jobs 2
    python -m leaderboard run --agents my-agents/ppo-seed1.onnx --draws private_draws.txt --results private_results
"""
_SHOW = """Print the ranking of every environment and scenario that the results' folder holds.

    python -m leaderboard show --results leaderboard/results
    python -m leaderboard show --results leaderboard/results --json
"""
_PAGE = """Write all rankings as one HTML file.

    python -m leaderboard page --results leaderboard/results --out page.html
"""
_VERIFY = """Play the project's own results again. The exit status is 1 if a number does not come back bit for bit.

    python -m leaderboard verify --draws 4
    python -m leaderboard verify --env RoughTurning-Surface-v0 --jobs 2
"""
_CARDS = """Write the model card of every agent in the agents' folder.

    python -m leaderboard cards --rows leaderboard/results --agents agents
"""
_FIGURE = """Draw the ranking for print.

    python -m leaderboard figure --results leaderboard/results --out docs/leaderboard.png
"""
_GALLERY = """Draw what a few policies do on the same bars.

    python -m leaderboard gallery --policies grid_search predictive --draws 3 --out docs/gallery
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
    tasks = [task, *(_splits(task, options.split_draws) if options.splits else [])]
    rounds = []
    for each in tasks:  # all of them first: what cannot be played is found before anything is
        contestants = [
            *run.named(options.policies, each.scenario, None if each is task else task.scenario),
            *run.agents(options.agents, each.scenario),
        ]
        if not contestants:
            raise ResultError("there is nothing to play: name a policy or give an agent")
        rounds.append(run.Round(each, contestants, result_folder(options.results, each.env_id, each.scenario.name), private))
    digests = {each.folder: current_digests(each.task).task for each in rounds}
    with workers(options.jobs, options.scheduler) as over:
        try:
            run.play_all(rounds, options.fresh, over)
        except run.PlayersFailed:
            boards = []
            for folder, digest in digests.items():
                with contextlib.suppress(ResultError):  # where nobody could play there is nothing to show
                    boards.append(read_board(folder, digest))
            _print(boards, options.json)
            raise
    _print([read_board(folder, digest) for folder, digest in digests.items()], options.json)
    path = options.results / PAGE
    _write_page(read_boards(options.results, digests), path)
    print(f"wrote {path}", file=sys.stderr if options.json else sys.stdout)


def _task(options: argparse.Namespace) -> tuple[Task, PrivateDraws | None]:
    """What is played, and the seeds of the draws if these are private."""
    given = options.draws
    task = Task(env_id=options.env, scenario=_scenario(options), draws=[] if isinstance(given, Path) else given)
    if not isinstance(given, Path):
        return task, None
    private = PrivateDraws.read(given)
    if options.splits:
        raise ResultError("splits are played on held-out draws: give --scenario and --draws FILE for each of them")
    if private.public:
        print(f"warning: {private.public} draws of {given} are below {PUBLIC}, and so no secret", file=sys.stderr)
    return private.task_of(task), private


def _splits(task: Task, draws: list[int]) -> list[Task]:
    """The tasks on which policies made for the task's scenario meet, on these draws, what they were not made for."""
    if task.env_id != SPLITS_ENV_ID:
        raise ResultError(f"there are no splits of {task.env_id}, only of {SPLITS_ENV_ID}")
    return [task.model_copy(update={"scenario": Scenario.load(name), "draws": draws}) for name in SPLITS]


def _show(options: argparse.Namespace) -> None:
    _print(read_boards(options.results, {}), options.json)


def _page(options: argparse.Namespace) -> None:
    path = options.out or options.results / PAGE
    _write_page(read_boards(options.results, {}), path)
    print(f"wrote {path}")


def _figure(options: argparse.Namespace) -> None:
    from leaderboard import figure  # needed only here: imports Matplotlib

    figure.write(read_board(result_folder(options.results, options.env, _scenario(options).name)), options.out)
    print(f"wrote {options.out}")


def _gallery(options: argparse.Namespace) -> None:
    from leaderboard import behaviour, gallery, run  # needed only here: imports Matplotlib, plays

    scenario = _scenario(options)
    players = [*run.named(options.policies, scenario), *run.agents(options.agents, scenario)]
    courses = gallery.play(players, scenario, options.draws)
    written = gallery.write(courses, options.out)
    if options.json:
        told = {"env_id": options.env, "scenario": scenario.name, "draws": options.draws, "policies": behaviour.as_json(courses)}
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
    with workers(options.jobs, options.scheduler) as over:
        complaints = verify.verify(options.rows, options.agents, selection, options.memory, options.fresh, options.draws, over)
    for complaint in complaints:
        print(complaint)
    what = "every row" if options.draws is None else "the start of every row"
    print(f"{len(complaints)} complaints" if complaints else f"{what} came back bit for bit")
    return FAILED if complaints else DONE


def _cards(options: argparse.Namespace) -> None:
    from leaderboard import cards  # needed only here: imports Jinja2 and ONNX

    for path in cards.write_all(options.rows, options.agents):
        print(f"wrote {path}")


def _scenario(options: argparse.Namespace) -> Scenario:
    return Scenario.load(options.scenario or IDS[options.env])


def _print(boards: Sequence[Board], as_json: bool) -> None:
    if as_json:
        print_json(machine_readable.as_data(boards))
    for board in boards:
        if not as_json:
            print(table.render(board) + "\n")
        if board.left_out:
            names = ", ".join(str(path) for path in board.left_out)
            why = "they are of other scenario values, draws, versions or code"
            print(f"left out, as {why}: {names}", file=sys.stderr)
    if not as_json and (across := generalisation.across(boards)) is not None:
        print(generalisation.render(across) + "\n")


def _write_page(boards: Sequence[Board], path: Path) -> None:
    from leaderboard import page  # needed only here: imports Jinja2

    page.write(boards, path)


def _draws(text: str) -> list[int]:
    try:
        return held_out_seeds(int(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _draws_or_file(text: str) -> list[int] | Path:
    if text.lstrip("+-").isdecimal():
        return _draws(text)
    if not Path(text).suffix and not Path(text).is_file():  # a file that is missing is an error of its own
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number of held-out draws nor a file of private ones")
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
    which = "number of held-out draws (default: 256), or a file of private ones, whose rows should go to --results of their own"
    run.add_argument("--draws", type=_draws_or_file, default="256", metavar="DRAWS", help=which)
    run.add_argument("--policies", nargs="*", metavar="NAME", help="rule-based controllers (default: all)")
    run.add_argument("--agents", nargs="*", type=Path, default=[], metavar="AGENT", help="ONNX files, or run folders of your own")
    run.add_argument("--splits", action="store_true", help=f"also play the splits: {', '.join(SPLITS)}")
    on_each = "number of held-out draws of each split (default: 32)"
    run.add_argument("--split-draws", type=_draws, default="32", metavar="DRAWS", help=on_each)
    run.add_argument("--fresh", action="store_true", help="play again what has been played")
    run.set_defaults(command=_run)

    show = commands.add_parser("show", parents=[results, printed], help="print the ranking", **described(_SHOW))
    show.set_defaults(command=_show)

    page = commands.add_parser("page", parents=[results], help="write all rankings as one HTML file", **described(_PAGE))
    page.add_argument("--out", type=Path, metavar="FILE", help="where it is written (default: RESULTS/index.html)")
    page.set_defaults(command=_page)

    shipped = argparse.ArgumentParser(add_help=False)
    shipped.add_argument("--rows", type=Path, default=Path("leaderboard/results"), help="results (default: leaderboard/results)")
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
    quick = "a quick look: only the first draws of each row"
    verify.add_argument("--draws", type=_positive, metavar="N", help=quick)
    verify.add_argument("--fresh", action="store_true", help="play again what came back before with the same code")
    memory = "where it is kept what came back (default: results/verified.json)"
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
    gallery.add_argument("--draws", type=_draws, default="3", help="number of held-out draws (default: 3)")
    gallery.add_argument("--policies", nargs="*", default=[], metavar="NAME", help="rule-based controllers")
    gallery.add_argument("--agents", nargs="*", type=Path, default=[], metavar="AGENT", help="ONNX files, or run folders")
    gallery.add_argument("--out", type=Path, default=Path("docs/gallery"), help="folder of pictures (default: docs/gallery)")
    gallery.add_argument("--json", action="store_true", help="print the numbers for machines")
    gallery.set_defaults(command=_gallery)
    return parser


if __name__ == "__main__":
    sys.exit(main())

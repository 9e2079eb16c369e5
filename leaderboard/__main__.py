"""``python -m leaderboard run|show|page|figure|gallery|verify|cards``."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from baselines.workers import WorkersError, workers
from leaderboard import generalisation, table
from leaderboard.board import Board, read_board, read_boards
from leaderboard.results import ResultError, Task, current_digests, result_folder
from turning_env import IDS, SPLITS, Scenario, ScenarioError
from turning_env.draws import held_out_draws

PAGE = "index.html"
SPLITS_ENV_ID = "RoughTurning-v0"
"""Of which there are splits."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    options = _parser().parse_args(arguments)
    try:
        status: int | None = options.command(options)
    except (ResultError, ScenarioError, WorkersError) as error:
        print(f"leaderboard: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("leaderboard: interrupted; what is finished is kept, and the same command goes on from there", file=sys.stderr)
        return 130
    return status or 0


def _run(options: argparse.Namespace) -> None:
    from leaderboard import run  # needed only here: plays

    task = Task(env_id=options.env, scenario=_scenario(options), draws=options.draws)
    tasks = [task, *(_splits(task, options.split_draws) if options.splits else [])]
    rounds = []
    for each in tasks:  # all of them first: what cannot be played is found before anything is
        contestants = [
            *run.named(options.policies, each.scenario, None if each is task else task.scenario),
            *run.agents(options.agents, each.scenario),
        ]
        if not contestants:
            raise ResultError("there is nothing to play: name a policy or give an agent")
        rounds.append(run.Round(each, contestants, result_folder(options.results, each.env_id, each.scenario.name)))
    digests = {each.folder: current_digests(each.task).task for each in rounds}
    with workers(options.jobs, options.scheduler) as over:
        run.play_all(rounds, options.fresh, over)
    _print([read_board(folder, digest) for folder, digest in digests.items()])
    _write_page(read_boards(options.results, digests), options.results / PAGE)


def _splits(task: Task, draws: list[int]) -> list[Task]:
    """The tasks on which policies made for the task's scenario meet, on these draws, what they were not made for."""
    if task.env_id != SPLITS_ENV_ID:
        raise ResultError(f"there are no splits of {task.env_id}, only of {SPLITS_ENV_ID}")
    return [task.model_copy(update={"scenario": Scenario.load(name), "draws": draws}) for name in SPLITS]


def _show(options: argparse.Namespace) -> None:
    _print(read_boards(options.results, {}))


def _page(options: argparse.Namespace) -> None:
    _write_page(read_boards(options.results, {}), options.out or options.results / PAGE)


def _figure(options: argparse.Namespace) -> None:
    from leaderboard import figure  # needed only here: imports Matplotlib

    figure.write(read_board(result_folder(options.results, options.env, _scenario(options).name)), options.out)
    print(f"wrote {options.out}")


def _gallery(options: argparse.Namespace) -> None:
    from leaderboard import gallery, habits, run  # needed only here: imports Matplotlib, plays

    scenario = _scenario(options)
    players = [*run.named(options.policies, scenario), *run.agents(options.agents, scenario)]
    courses = gallery.play(players, scenario, options.draws)
    written = gallery.write(courses, options.out)
    if options.json:
        told = {"env_id": options.env, "scenario": scenario.name, "draws": options.draws, "policies": habits.as_json(courses)}
        print(json.dumps(told, indent=2))
        return
    print(habits.render(courses))
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
    return 1 if complaints else 0


def _cards(options: argparse.Namespace) -> None:
    from leaderboard import cards  # needed only here: imports Jinja2 and ONNX

    for path in cards.write_all(options.rows, options.agents):
        print(f"wrote {path}")


def _scenario(options: argparse.Namespace) -> Scenario:
    return Scenario.load(options.scenario or IDS[options.env])


def _print(boards: Sequence[Board]) -> None:
    for board in boards:
        print(table.render(board) + "\n")
        if board.left_out:
            names = ", ".join(str(path) for path in board.left_out)
            why = "they are of other scenario values, draws, versions or code"
            print(f"leaderboard: left out, as {why}: {names}", file=sys.stderr)
    if (across := generalisation.across(boards)) is not None:
        print(generalisation.render(across) + "\n")


def _write_page(boards: Sequence[Board], path: Path) -> None:
    from leaderboard import page  # needed only here: imports Jinja2

    page.write(boards, path)
    print(f"wrote {path}")


def _draws(text: str) -> list[int]:
    try:
        return held_out_draws(int(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number above 0")
    return int(text)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m leaderboard", description="Rank policies on common draws.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    results = argparse.ArgumentParser(add_help=False)
    results.add_argument(
        "--results",
        type=Path,
        default=Path("results"),
        help="folder of the results (default: results; leaderboard/rows holds those that come with the project)",
    )
    environment = argparse.ArgumentParser(add_help=False)
    environment.add_argument("--env", choices=IDS, default="RoughTurning-v0", help="the environment's id")
    environment.add_argument("--scenario", metavar="PRESET_OR_TOML", help="scenario instead of the id's own preset")

    elsewhere = argparse.ArgumentParser(add_help=False)
    who = elsewhere.add_mutually_exclusive_group()
    who.add_argument("--jobs", type=_positive, default=1, metavar="N", help="processes that play at the same time (default: 1)")
    who.add_argument("--scheduler", metavar="URL", help="have the workers of a Dask cluster play, such as tcp://host:8786")

    run = commands.add_parser("run", parents=[results, environment, elsewhere], help="play policies, then show and page")
    run.add_argument("--draws", type=_draws, default="256", help="number of held-out draws (default: 256)")
    run.add_argument("--policies", nargs="*", metavar="NAME", help="rule-based controllers (default: all)")
    run.add_argument("--agents", nargs="*", type=Path, default=[], metavar="AGENT", help="ONNX files, or run folders of your own")
    run.add_argument("--splits", action="store_true", help=f"also play the splits: {', '.join(SPLITS)}")
    on_each = "number of held-out draws of each split (default: 32)"
    run.add_argument("--split-draws", type=_draws, default="32", metavar="DRAWS", help=on_each)
    run.add_argument("--fresh", action="store_true", help="play again what has been played")
    run.set_defaults(command=_run)

    show = commands.add_parser("show", parents=[results], help="print the ranking")
    show.set_defaults(command=_show)

    example = "example: python -m leaderboard page --results leaderboard/rows --out leaderboard.html"
    page = commands.add_parser("page", parents=[results], help="write all rankings as one HTML file", epilog=example)
    page.add_argument("--out", type=Path, metavar="FILE", help="where it is written (default: RESULTS/index.html)")
    page.set_defaults(command=_page)

    shipped = argparse.ArgumentParser(add_help=False)
    shipped.add_argument("--rows", type=Path, default=Path("leaderboard/rows"), help="results (default: leaderboard/rows)")
    shipped.add_argument("--agents", type=Path, default=Path("agents"), help="agents' ONNX files (default: agents)")

    verify = commands.add_parser(
        "verify", parents=[shipped, elsewhere], help="play the project's own results again; fail if any differs"
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

    cards = commands.add_parser("cards", parents=[shipped], help="write the model card of every agent in the agents' folder")
    cards.set_defaults(command=_cards)

    figure = commands.add_parser("figure", parents=[results, environment], help="draw the ranking for print")
    figure.add_argument("--out", type=Path, default=Path("docs/leaderboard.png"), help="picture (default: docs/leaderboard.png)")
    figure.set_defaults(command=_figure)

    gallery = commands.add_parser("gallery", parents=[environment], help="draw what a few policies do on the same bars")
    gallery.add_argument("--draws", type=_draws, default="3", help="number of held-out draws (default: 3)")
    gallery.add_argument("--policies", nargs="*", default=[], metavar="NAME", help="rule-based controllers")
    gallery.add_argument("--agents", nargs="*", type=Path, default=[], metavar="AGENT", help="ONNX files, or run folders")
    gallery.add_argument("--out", type=Path, default=Path("docs/gallery"), help="folder of pictures (default: docs/gallery)")
    gallery.add_argument("--json", action="store_true", help="print the numbers for machines")
    gallery.set_defaults(command=_gallery)
    return parser


if __name__ == "__main__":
    sys.exit(main())

"""Rank policies on the same held-out seeds.

    python -m leaderboard run --seeds 16 --policies fixed_tuned predictive
    python -m leaderboard show --results leaderboard/results

``python -m leaderboard COMMAND --help`` explains a command, with an example.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from leaderboard import game, maintenance, run_command, score_command, table, verify
from leaderboard.ranking import read_leaderboards
from leaderboard.report import PAGE, notify_left_out, print_all, write_page
from leaderboard.result import ResultError
from leaderboard.shared_options import (
    SPLITS_ENV_ID,
    add_agents_folder,
    add_json,
    add_project_results,
    add_results,
    add_workers,
    result_folders,
)
from leaderboard.workers import WorkersError, workers
from turning_env import ALL_IDS, ScenarioError
from turning_env.console import (
    DONE,
    FAILED,
    Parser,
    UserError,
    described,
    exits,
    positive,
    print_json,
    printable,
)
from turning_env.scenario.arguments import environment_id

MEMORY = Path("results/verified.json")

Command = Callable[[argparse.Namespace], int | None]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    options = _parser().parse_args(arguments)
    command: Command = options.command

    @exits(
        ResultError,
        ScenarioError,
        WorkersError,
        interrupted="interrupted: finished results are kept; run the same command again to go on",
        checks=command is _verify,
    )
    def status() -> int:
        return command(options) or DONE

    return status()


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m leaderboard", **described(__doc__))
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add(command: Command, brief: str) -> argparse.ArgumentParser:
        name = command.__name__.removeprefix("_")
        added: argparse.ArgumentParser = commands.add_parser(
            name, help=brief, **described(command.__doc__)
        )
        added.set_defaults(command=command)
        return added

    run_command.add_to(commands)
    score_command.add_to(commands)
    _add_show_options(add(_show, "print the ranking"))
    _add_verify_options(add(_verify, "play results again; fail if any differs"))
    _add_page_options(add(_page, "write all rankings as one HTML file"))
    game.add_to(commands)
    maintenance.add_to(commands)
    return parser


def _show(options: argparse.Namespace) -> None:
    """Print the ranking of one environment on one scenario: the first that there is.

    With --env it is the first of that id, and with --all every ranking is printed.

    python -m leaderboard show --results leaderboard/results
    python -m leaderboard show --results leaderboard/results --all --json
    python -m leaderboard show --results leaderboard/results --markdown mean_return overload_share
    python -m leaderboard show --results leaderboard/results --aggregate
    """
    if options.aggregate:
        print(_aggregated(options))
        return
    if options.policies and options.markdown is None:
        raise UserError("--policies chooses rows of --markdown and --aggregate: add one of them")
    leaderboards = read_leaderboards(
        options.results,
        env_id=options.env,
        scenarios=options.scenario,
        max_count=None if options.all else 1,
    )
    if options.markdown is not None:
        print(table.selection(leaderboards, options.markdown, options.policies))
        return
    if options.json:
        print_json(table.as_data(leaderboards))
    else:
        print_all(leaderboards)
    notify_left_out(leaderboards)
    if not options.all and len(result_folders(options.results)) > 1:
        print("--all prints the other leaderboards", file=sys.stderr)


def _aggregated(options: argparse.Namespace) -> str:
    """Return the tables of scores over the tasks."""
    from leaderboard import aggregate  # needed only here

    tasks = aggregate.read(options.results)
    is_markdown = options.markdown is not None
    texts = []
    if options.aggregate in ("tasks", "both"):
        texts.append(_as_text(aggregate.by_task(tasks), is_markdown))
        remarks = " ".join(aggregate.not_feasible(tasks))
        if remarks:
            # Pages show a quotation in grey.
            texts.append(f"> {remarks}" if is_markdown else remarks)
    if options.aggregate in ("means", "both"):
        means = aggregate.over_tasks(tasks, options.policies)
        texts.append(_as_text(means, is_markdown))
    return "\n\n".join(texts)


def _as_text(rows: Sequence[Mapping[str, str]], is_markdown: bool) -> str:
    """Return rows of texts by heading as a table."""
    if is_markdown:
        return table.markdown(rows)
    return table.aligned([list(rows[0]), *[list(row.values()) for row in rows]])


def _add_show_options(parser: argparse.ArgumentParser) -> None:
    add_results(parser)
    add_json(parser)
    add = parser.add_argument
    add(
        "--env",
        type=environment_id,
        choices=ALL_IDS,
        help=f"the environment's id (default: {SPLITS_ENV_ID}, if it has results)",
    )
    add(
        "--scenario",
        nargs="+",
        default=[],
        metavar="NAME",
        help="names of scenarios (default: the id's own) or families, perhaps with a split, such "
        "as shop-unseen_jobs",
    )
    add(
        "--all",
        action="store_true",
        help="print all rankings, of all ids and scenarios unless one is named",
    )
    add(
        "--markdown",
        nargs="*",
        choices=table.COLUMNS,
        metavar="NUMBER",
        help="print one Markdown table of these numbers, as --json calls them; without any, of "
        "full costs over splits",
    )
    add(
        "--policies",
        nargs="+",
        default=[],
        metavar="NAME",
        help="policies in that table (default: all)",
    )
    add(
        "--aggregate",
        nargs="?",
        const="both",
        choices=("tasks", "means", "both"),
        help="print scores over the tasks: the best policies of each task, means over tasks, or "
        "both (default: both); 0 is the best fixed speed and feed, 100 the oracle of the state; "
        "--policies adds rows to the means",
    )


def _page(options: argparse.Namespace) -> None:
    """Write all rankings as one HTML file.

    python -m leaderboard page --results leaderboard/results --out page.html
    """
    path = options.out or options.results / PAGE
    write_page(read_leaderboards(options.results), path)
    print(f"wrote {path}")


def _add_page_options(parser: argparse.ArgumentParser) -> None:
    add_results(parser)
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="page to write (default: RESULTS/index.html)"
    )


def _verify(options: argparse.Namespace) -> int:
    """Play results again. The exit status is 1 if a number differs. ``--check`` plays nothing.

    ``--seeds`` draws some seeds of each result afresh, so that nobody knows beforehand which are
    played. ``--draw`` repeats a draw.

    python -m leaderboard verify --check
    python -m leaderboard verify --seeds 4 --jobs 2
    python -m leaderboard verify --env RoughTurning-Surface-v1 --jobs 2
    """
    selection = verify.Selection(options.env, options.scenario, policies=options.policies)
    if options.check:
        complaints = verify.check(options.results, options.agents, selection)
        passed = "every result is valid"
    else:
        draw = _draw(options)
        complaints = _replay(options, selection, draw)
        passed = "every result came back"
        if draw is not None:
            passed = "the drawn seeds of every result came back"
    for complaint in complaints:
        print(printable(complaint))
    print(f"{len(complaints)} complaints" if complaints else passed)
    return FAILED if complaints else DONE


def _draw(options: argparse.Namespace) -> verify.Draw | None:
    """Return the draw of the seeds to play, and print its key; None: all seeds."""
    if options.seeds is None:
        if options.draw is not None:
            raise UserError("--draw repeats a draw of --seeds N: add --seeds")
        return None
    if options.draw is not None:
        return verify.Draw(options.seeds, options.draw)
    draw = verify.Draw.fresh(options.seeds)
    print(f"--seeds {draw.seeds} --draw {draw.key} draws the same seeds again", file=sys.stderr)
    return draw


def _replay(
    options: argparse.Namespace, selection: verify.Selection, draw: verify.Draw | None
) -> list[str]:
    """Play results again and return the complaints."""
    if options.fresh:
        options.memory.unlink(missing_ok=True)
    with workers(options.jobs, options.scheduler) as over:
        return verify.verify(
            options.results,
            options.agents,
            selection=selection,
            memory=options.memory,
            draw=draw,
            over=over,
        )


def _add_verify_options(parser: argparse.ArgumentParser) -> None:
    add_project_results(parser)
    add_agents_folder(parser)
    add_workers(parser)
    add = parser.add_argument
    add("--env", type=environment_id, choices=ALL_IDS, help="only results of this id")
    add("--scenario", metavar="NAME", help="only results on this scenario")
    add("--policies", nargs="+", metavar="NAME", help="only results of these policies")
    add(
        "--seeds",
        type=positive,
        metavar="N",
        help="play only N seeds of each result, drawn afresh",
    )
    add(
        "--draw",
        type=positive,
        metavar="KEY",
        help="with --seeds: repeat the draw of this key, which it has printed",
    )
    add(
        "--check",
        action="store_true",
        help="play nothing: compare versions, scenario values, parameters and agents' files",
    )
    add(
        "--fresh",
        action="store_true",
        help="also play again what was verified before an interruption",
    )
    add(
        "--memory",
        type=Path,
        default=MEMORY,
        metavar="FILE",
        help="file of the results verified so far, so that the same command resumes (default: "
        "%(default)s)",
    )

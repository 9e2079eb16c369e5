"""Play controllers and agents on unseen jobs of a family, and compare them.

Every controller is built for each job from its nominal model, with the parameters tuned for ``--tuned-on``. "predictive, told
the truth" is built from the true scenario, whose predictions it also observes; "self_tuning, told the wear" is told the true
law of wear alone. An agent plays all jobs; files or run folders of one name with several training seeds are one policy. A
forgetful policy forgets everything at each change of the edge.

    python -m leaderboard.family --jobs 16 --episodes 4
    python -m leaderboard.family --split unseen_materials --policies rescaled_grid_search predictive
    python -m leaderboard.family --agent agents/family_gradient-seed0.onnx --jobs 256 --workers 16 --keep results

``--keep`` keeps results, which ``python -m leaderboard show --env RoughTurning-Family-v0`` prints again. Those that come with the
project are in leaderboard/results.

A job's score is 0 for the "held optimum" and 1 for the oracle "causal", which is told the true laws and the present depth,
hardness and wear. The table has its interquartile mean over jobs. The full cost is all costs (time, edges, overload, breakage)
over the worth of the metal, in %; above 100, the metal does not pay. It is not per volume, as volumes of different materials do
not add up. Leads are over the best controller that is told the nominal model, job by job; the share of the gap closed is of that
from it to the same controller told the truth. Intervals of 95 % are bootstrapped over jobs and training seeds. A policy is
feasible on a job if its share of cutting time in severe overload is within the scenario's allowance.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from leaderboard.family_play import ANCHOR, TOLD, TRUTH, Piece, jobs_at_once, played, spec_of
from leaderboard.family_result import FamilyResult, FamilyTask, kept
from leaderboard.family_table import Board
from leaderboard.result import result_folder, write_result
from leaderboard.standings import CAUSAL
from turning_env import FAMILY_ID
from turning_env.console import described, exits, print_json
from turning_env.scenario import Scenario, ScenarioError
from turning_env.scenario.family import Family
from turning_env.scoring.workers import spread, workers


@exits(ScenarioError, ValueError, interrupted="interrupted: with --keep, the same command goes on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Play and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m leaderboard.family", **described(__doc__))
    parser.add_argument("--family", default="shop", help="family, or its TOML file (default: %(default)s)")
    parser.add_argument("--split", nargs="+", default=["unseen_jobs"], help="splits (default: unseen_jobs)")
    parser.add_argument("--jobs", type=int, default=16, help="jobs of each split (default: %(default)s)")
    parser.add_argument("--episodes", type=int, default=4, help="episodes of each job (default: %(default)s)")
    parser.add_argument("--policies", nargs="+", default=["rescaled_grid_search", "predictive", f"predictive{TRUTH}", CAUSAL],
                        help="controllers and the oracle (default: rescaled_grid_search; predictive and causal)")  # fmt: skip
    parser.add_argument("--forgetful", action="store_true", help="also play them, and agents, forgetful")
    parser.add_argument("--agent", nargs="+", type=Path, default=[], metavar="AGENT", help="agents: ONNX files or run folders")
    parser.add_argument("--tuned-on", default="shift", help="scenario of their tuned parameters (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that play (default: %(default)s)")
    parser.add_argument(
        "--keep", type=Path, metavar="FOLDER", help="folder of results that keeps what has been played, to go on with"
    )
    parser.add_argument("--json", action="store_true", help="print every episode's return as JSON")
    options = parser.parse_args(arguments)
    if min(options.jobs, options.episodes, options.workers) < 1:
        parser.error("--jobs, --episodes and --workers must be at least 1")
    family, tuned_on = Family.load(options.family), Scenario.load(options.tuned_on)
    policies: list[tuple[str | Path, bool]] = [(each, False) for each in (ANCHOR, *options.policies, *options.agent)]
    if options.forgetful:
        rules_told = [name for name in options.policies if name != CAUSAL and not name.endswith(tuple(TOLD))]
        policies += [(each, True) for each in (*rules_told, *options.agent)]
    specs = {policy: spec_of(*policy, family, tuned_on) for policy in dict.fromkeys(policies)}
    labels = [spec.label for spec in specs.values()]
    if twice := sorted({label for label in labels if labels.count(label) > 1}):
        parser.error(f"two agents are called {', '.join(twice)}: export one by python -m train.export --name")
    tasks = {split: FamilyTask.of(family, split) for split in options.split}
    # Slow policies first, so that no worker is left with a long piece at the end.
    places = [(split, policy) for policy in reversed(specs) for split in tasks]
    ended = {
        (split, policy): dict(kept(options.keep, tasks[split], specs[policy]) if options.keep else {}) for split, policy in places
    }
    pieces = []
    for place in places:
        split, policy = place
        family.draw(split, 0)
        at_once = jobs_at_once(policy[0])
        for start in range(0, options.jobs, at_once):
            seeds = tasks[split].seeds_of(range(start, min(start + at_once, options.jobs)), options.episodes)
            if not ended[place].keys() >= set(seeds):
                pieces.append((place, Piece(family, split, seeds, *policy, tuned_on)))
    with workers(options.workers, None) as over:
        for place, rows in tqdm(spread(over, played, pieces), total=len(pieces), unit="piece", disable=None):
            split, policy = place
            ended[place].update(rows)
            if options.keep:
                result = FamilyResult.of_rows(tasks[split], specs[policy], ended[place])
                write_result(result, result_folder(options.keep, FAMILY_ID, result.task.scenario.name))
    boards = []
    for split, task in tasks.items():
        seeds = task.seeds_of(range(options.jobs), options.episodes)
        known = ((spec, ended[split, policy]) for policy, spec in specs.items())
        boards.append(Board.of([FamilyResult.of_rows(task, spec, {seed: rows[seed] for seed in seeds}) for spec, rows in known]))
    if options.json:
        print_json({each.task.split: {name: rows["return"] for name, rows in each.rows.items()} for each in boards})
    else:
        print(*(each.text() + "\n" for each in boards), sep="", end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())

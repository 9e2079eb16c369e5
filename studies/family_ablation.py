"""Measure what the network's corrections are worth to the agent for all lathes, and what knowing the true laws would be.

    python -m studies.family_ablation
    python -m studies.family_ablation --agent my-agents/family_gradient-seed0.onnx --jobs 64 --variants as_it_is untrained

Every variant plays the same training jobs: the agent as it is; without its corrections of the proposed speed, feed or edge
changes, or without any; and told the truth about some laws. Leads are over the agent as it is, paired by job. Held-out jobs are
not played, so the numbers may guide the design.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import onnx
from onnx import numpy_helper
from tqdm import tqdm

from leaderboard.family_play import Retold
from train.agents import agent_file
from turning_env import FAMILY_ID, Family
from turning_env.console import described, exits
from turning_env.scoring.family import play_family, truthful
from turning_env.scoring.onnx_session import OnnxPolicy, session_of
from turning_env.scoring.statistics import Bootstrap, Estimate, Floats
from turning_env.scoring.workers import spread, workers

AGENT = Path("agents") / FAMILY_ID / "shop" / "family_gradient-seed0.onnx"
SPEED, FEED, CHANGE = range(3)
"""Outputs of the network: corrections of speed, feed and the score of an edge change."""


class Variant(NamedTuple):
    """A variant of the agent, or of what it is told."""

    title: str
    without: tuple[int, ...] = ()
    """Corrections that are left out."""
    right: str | None = None
    """How the names of the fields begin of which it is told the truth; None: of no field."""


VARIANTS = {
    "as_it_is": Variant("the agent"),
    "speed": Variant("without correction of the speed", (SPEED,)),
    "feed": Variant("without correction of the feed", (FEED,)),
    "change": Variant("without correction of edge changes", (CHANGE,)),
    "untrained": Variant("without corrections: untrained", (SPEED, FEED, CHANGE)),
    "wear": Variant("told the law of wear", right="material.wear."),
    "force": Variant("told the law of thrust force", right="material.thrust_force."),
    "power": Variant("told the law of power", right="material.power."),
    "truth": Variant("told the truth", right=""),
}
"""Variants by name, in the table's order; the first is what others are compared with."""


def without_corrections(content: bytes, rows: Sequence[int]) -> bytes:
    """Return an agent's file whose network adds nothing to some of its proposals.

    Raises:
        ValueError: the network has no layer ``head`` with three outputs.
    """
    model = onnx.load_model_from_string(content)
    found = 0
    for tensor in model.graph.initializer:
        if tensor.name in ("head.weight", "head.bias"):
            values = numpy_helper.to_array(tensor).copy()
            if len(values) == 1 + CHANGE:
                values[list(rows)] = 0.0
                tensor.CopyFrom(numpy_helper.from_array(values, tensor.name))
                found += 1
    if found < 2:
        raise ValueError("its network has no layer 'head' with three outputs: it is no agent of train.family_gradient")
    return bytes(model.SerializeToString(deterministic=True))


def returns_of(name: str, agent: Path, jobs: int) -> Floats:
    """Return a variant's returns [s] on the first training jobs, shape (jobs,)."""
    variant, family, file = VARIANTS[name], Family.load("shop"), agent_file.read(agent)
    if variant.right is not None:
        family = truthful(family, variant.right)
    content = without_corrections(file.content, variant.without)
    told = file.metadata.parameters.get("context")

    def make(num_envs: int) -> Retold:
        return Retold(OnnxPolicy(session_of(content), file.memory_size, num_envs), family, told)

    numbers = [family.job(number) for number in range(jobs)]
    returns: Floats = play_family(family, numbers, make, 1)["return"][:, 0]
    return returns


def table(returns: dict[str, Floats]) -> list[str]:
    """Return the lines of a Markdown table; leads are over the first variant."""
    first = next(iter(returns.values()))
    bootstrap = Bootstrap(len(first))
    lines = ["| Variant | Return [s] | Lead [s] | Median lead [s] | Better [% of jobs] |", "|---|---|---|---|---|"]
    for name, values in returns.items():
        cells = [VARIANTS[name].title, f"{values.mean():.0f}", "", "", ""]
        if values is not first:
            leads = values - first
            lead = Estimate.of(leads.mean(), bootstrap.means(leads[np.newaxis], name))
            cells[2:] = [f"{lead.value:.0f} ({lead.low:.0f} to {lead.high:.0f})", f"{np.median(leads):.1f}"]
            cells.append(f"{100.0 * (leads > 0.0).mean():.0f}")
        lines.append(f"| {' | '.join(cells)} |")
    return lines


@exits(OSError, ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Play all variants and print the table; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.family_ablation", **described(__doc__))
    parser.add_argument("--agent", type=Path, default=AGENT, metavar="FILE", help="file of your own (default: %(default)s)")
    parser.add_argument("--jobs", type=int, default=256, help="training jobs that each variant plays (default: %(default)s)")
    parser.add_argument("--variants", nargs="+", choices=VARIANTS, default=list(VARIANTS), metavar="NAME",
                        help=f"variants, from {', '.join(VARIANTS)} (default: all)")  # fmt: skip
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that play (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    if not 1 <= parsed.jobs <= Family.load("shop").jobs or parsed.workers < 1:
        parser.error(f"--jobs must be 1 to {Family.load('shop').jobs}, and --workers at least 1")
    without_corrections(agent_file.read(parsed.agent).content, ())
    names, played = list(dict.fromkeys(parsed.variants)), {}
    work = partial(returns_of, agent=parsed.agent, jobs=parsed.jobs)
    with workers(parsed.workers, None) as over:
        pieces = tqdm(spread(over, work, zip(names, names, strict=True)), total=len(names), unit="variant", disable=None)
        for name, returns in pieces:
            played[name] = returns
    print(*table({name: played[name] for name in names}), sep="\n")
    return 0


if __name__ == "__main__":
    from studies import family_ablation  # under the name by which workers know it

    sys.exit(family_ablation.main())

"""Kills programs at random moments by SIGKILL, which none can catch, and sees what is there afterwards, each time."""

import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from random import Random

from benchmarks.soak.contents import contents, unreadable
from benchmarks.soak.victims import Victim

LOG = ".log"
"""What a victim says, in its folder."""
_MAX = 600.0
"""A victim that takes longer [s] hangs."""
_GRACE = 30.0
"""So long [s] may the processes of a killed program outlive it."""


@dataclass
class Toll:
    """What became of a victim."""

    name: str
    kills: int = 0
    finished: int = 0
    """Times that it was finished, though killed before."""
    torn: int = 0
    """Files that could not be read after a kill."""
    differing: int = 0
    """Times that what was finished was not what an undisturbed run makes."""
    orphans: int = 0
    """Kills after which a process of the victim went on."""
    seconds: float = 0.0
    """That an undisturbed run takes."""

    @property
    def survived(self) -> bool:
        """Whether nothing was broken or lost."""
        return self.torn == self.differing == self.orphans == 0 and self.finished > 0


def soak(victim: Victim, kills: int, folder: Path, random: Random) -> Toll:
    """Kill a victim so many times, each at a random moment of the time that it takes undisturbed, and start it again.

    Whenever it comes to its end though it has been killed, what it has made is compared with what it makes undisturbed, and it
    begins anew in another folder.

    Raises:
        RuntimeError: it fails by itself.
    """
    toll = Toll(victim.name)
    undisturbed = folder / "undisturbed"
    start = time.monotonic()
    _finish(_started(victim, undisturbed), undisturbed)
    toll.seconds = time.monotonic() - start
    expected = contents(undisturbed)
    while toll.kills < kills or toll.finished == 0:
        here = folder / f"killed{toll.finished}"
        toll.finished += _to_the_end(victim, here, toll, kills, random)
        if differing := sorted({name for name, _ in contents(here).items() ^ expected.items()}):
            toll.differing += 1
            print(f"{here} differs in {', '.join(differing)}", file=sys.stderr)
    return toll


def _to_the_end(victim: Victim, folder: Path, toll: Toll, kills: int, random: Random) -> int:
    killed_here = 0
    while True:
        process = _started(victim, folder)
        if toll.kills < kills:
            process.join(random.uniform(0.0, toll.seconds))
            if process.is_alive():
                toll.orphans += not _killed(process)
                toll.kills += 1
                killed_here += 1
                broken = unreadable(folder)
                toll.torn += len(broken)
                for why in broken:
                    print(why, file=sys.stderr)
                continue
        _finish(process, folder)
        return 1 if killed_here or toll.kills >= kills else 0


def _started(victim: Victim, folder: Path) -> BaseProcess:
    folder.mkdir(parents=True, exist_ok=True)
    # The server imports all that is needed once, and has neither threads nor anything else that a fork would break.
    context = get_context("forkserver")
    context.set_forkserver_preload(["benchmarks.soak.victims"])
    process = context.Process(target=_run, args=(victim, folder))
    process.start()
    return process


def _run(victim: Victim, folder: Path) -> None:
    os.setsid()  # it and its processes are a group
    with (folder / LOG).open("a", encoding="utf-8") as log:
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        sys.exit(victim.work(folder))


def _killed(process: BaseProcess) -> bool:
    """Kill a victim, but none of its processes; whether these then end by themselves, as they ought to."""
    assert process.pid is not None
    process.kill()
    process.join()
    deadline = time.monotonic() + _GRACE
    while time.monotonic() < deadline:
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    return False


def _finish(process: BaseProcess, folder: Path) -> None:
    process.join(_MAX)
    if process.exitcode != 0:
        process.kill()
        said = (folder / LOG).read_text("utf-8").strip().splitlines()[-5:]
        raise RuntimeError(f"it ended with status {process.exitcode}: " + "\n".join(said))

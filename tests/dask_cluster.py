"""A Dask cluster of processes of this machine, on a free port."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.walking import MAX, ROOT


class DaskCluster:
    """A scheduler and its workers; settings are environment variables of the scheduler."""

    def __init__(self, folder: Path, **settings: str) -> None:
        self.workers: list[subprocess.Popen[bytes]] = []
        described = folder / "scheduler.json"
        options = ("--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(described))
        self.scheduler = self._start("dask_scheduler", *options, **settings)
        start = time.monotonic()
        while not described.exists() or not described.read_bytes().endswith(b"}"):
            assert self.scheduler.poll() is None
            assert time.monotonic() - start < MAX
            time.sleep(0.05)
        self.address: str = json.loads(described.read_text())["address"]

    def add_worker(self) -> None:
        """Start a worker without waiting for it."""
        self.workers.append(self._start("dask_worker", self.address, "--nthreads", "1", "--no-nanny"))

    def _start(self, program: str, *arguments: str, **settings: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", f"distributed.cli.{program}", "--no-dashboard", *arguments]
        quiet = subprocess.DEVNULL
        return subprocess.Popen(command, cwd=ROOT, env=os.environ | settings, stdout=quiet, stderr=quiet)


@contextmanager
def dask_cluster(folder: Path, workers: int, **settings: str) -> Iterator[DaskCluster]:
    """Start a cluster with a number of workers, and end every process with the context."""
    cluster = DaskCluster(folder, **settings)
    try:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        for process in (*cluster.workers, cluster.scheduler):
            process.kill()
            process.wait(MAX)

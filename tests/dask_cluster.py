"""A Dask cluster of processes of this machine, on a free port."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]
MAX = 60.0
"""Longest time to start a process [s]."""


class DaskCluster:
    """A scheduler and its workers."""

    def __init__(self, folder: Path, **settings: str) -> None:
        self._folder = folder
        self.workers: list[subprocess.Popen[bytes]] = []
        described = folder / "scheduler.json"
        self.scheduler = self._start(
            "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(described), **settings
        )
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
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{program}", "--no-dashboard", *arguments],
            cwd=ROOT,
            env=os.environ | settings,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def close(self) -> None:
        """End every process."""
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait(MAX)


@contextmanager
def dask_cluster(folder: Path, workers: int, **settings: str) -> Iterator[DaskCluster]:
    """Start a cluster with a number of workers; settings are environment variables of the scheduler."""
    cluster = DaskCluster(folder, **settings)
    try:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        cluster.close()

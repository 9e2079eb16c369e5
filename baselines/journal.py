"""What a long search has found so far, kept on disk, so that it goes on where it was interrupted."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from turning_env.files import replace_file


class Journal:
    """Numbers by key, for one task; a file that holds another task's, or is damaged, is started anew.

    Args:
        path: the file, which ``finish`` removes.
        task: whatever JSON holds that the numbers depend on beside their keys.
    """

    def __init__(self, path: Path, task: Any) -> None:
        self._path, self._task = path, task
        self._found: dict[str, float] = {}
        try:
            kept = json.loads(path.read_text("utf-8"))
        except (FileNotFoundError, ValueError):
            kept = {}
        if isinstance(kept, dict) and kept.get("task") == task:
            self._found = kept["found"]

    def recall(self, key: Any, find: Callable[[], float]) -> float:
        """The number kept under ``key`` (whatever JSON holds), or else the one that ``find`` returns, which is kept."""
        name = json.dumps(key, sort_keys=True)
        if name not in self._found:
            self._found[name] = find()
            text = json.dumps({"task": self._task, "found": self._found})
            replace_file(self._path, lambda partial: partial.write_text(text, "utf-8"))
        return self._found[name]

    def finish(self) -> None:
        """Remove the file: the search is over."""
        self._path.unlink(missing_ok=True)

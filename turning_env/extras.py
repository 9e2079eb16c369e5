"""Extensions by other packages, and messages for optional packages that are not installed."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any

EXTRAS = {
    "'rough-turning[render]'": ("PIL", "pygame"),
    "'rough-turning[sb3]'": ("stable_baselines3",),
    "'rough-turning[onnx]'": ("onnxruntime",),
    "'rough-turning[ecosystem]'": ("h5py", "minari", "moviepy", "rl_zoo3", "torchrl"),
    "-e '.[benchmark]' in a clone": (
        "cmaes",
        "jinja2",
        "joblib",
        "matplotlib",
        "onnx",
        "onnxscript",
        "optuna",
        "sb3_contrib",
        "scipy",
        "tensorboard",
        "torch",
        "tqdm",
    ),
    "-e '.[distributed]' in a clone": ("dask", "distributed"),
    "-e '.[publish]' in a clone": ("huggingface_hub",),
}
"""Arguments of ``pip install``, and the import names of the packages that it brings.

Other distributions add theirs by entry points of the group ``turning_env.extras``.
"""


def provided(group: str) -> list[Any]:
    """Return the objects of installed packages for a group of entry points.

    Groups: ``commands`` and ``extras``. Raise ModuleNotFoundError if an optional
    package is missing.
    """
    objects = []
    for entry in entry_points(group=f"turning_env.{group}"):
        try:
            objects.append(entry.load())
        except ModuleNotFoundError as error:
            # The providing package itself may be gone, although its entry point is still there.
            if error.name != entry.module.partition(".")[0]:
                raise
    return objects


def missing(error: ModuleNotFoundError) -> str | None:
    """Return the message for a failed import of an optional package; None for other modules."""
    name = (error.name or "").partition(".")[0]
    if name == "baselines":
        return _foreign_baselines()
    # Tables of installed distributions come first: their users may have no clone.
    for table in [*provided("extras"), EXTRAS]:
        for source, packages in table.items():
            if name in packages:
                return f"{name} is not installed: pip install {source}"
    return None


def _foreign_baselines() -> str | None:
    """Return a message if another package is called ``baselines``; None if it is this project's.

    OpenAI's package for reinforcement learning, which is no longer maintained, has that name.
    """
    spec = find_spec("baselines")
    origin = Path(spec.origin) if spec and spec.origin else None
    if origin is None or origin.parent == Path(__file__).parents[1] / "baselines":
        return None
    return (
        f"{origin.parent} is another package called baselines, which hides that of rough-turning: "
        "uninstall it (pip uninstall baselines), then pip install --force-reinstall --no-deps "
        "rough-turning"
    )


@contextmanager
def needed(error_type: type[Exception] | None = None) -> Iterator[None]:
    """Wrap imports of optional packages: the error for a missing one says how to install it.

    ``error_type`` is the type of that error, by default ModuleNotFoundError.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        message = missing(error)
        if message is None:
            raise
        if error_type:
            raise error_type(message) from None
        raise ModuleNotFoundError(message, name=error.name) from None


def tell_plainly() -> None:
    """Let a missing optional package end ``python -m`` of the caller's modules with status 2.

    The error is one line.
    """

    def print_missing(
        kind: type[BaseException], error: BaseException, traceback: TracebackType | None
    ) -> None:
        message = missing(error) if isinstance(error, ModuleNotFoundError) else None
        if message:
            print(f"error: {message}", file=sys.stderr)
            sys.exit(2)
        sys.__excepthook__(kind, error, traceback)

    if sys.argv[:1] == ["-m"]:  # set while the interpreter looks for the module to run
        sys.excepthook = print_missing

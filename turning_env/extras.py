"""Extensions by other packages: objects that plug in here, and messages for optional packages that are not installed."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import entry_points
from types import TracebackType
from typing import Any

EXTRAS = {
    "workshop": ("matplotlib", "openpyxl", "scipy"),
    "programs": ("ezdxf", "shapely", "tqdm"),
    "render": ("PIL", "pygame"),
    "sb3": ("stable_baselines3",),
    "onnx": ("onnxruntime",),
    "opcua": ("asyncua",),
    "ecosystem": ("h5py", "minari", "moviepy", "rl_zoo3", "torchrl"),
    "benchmark": (
        *(
            "jinja2",
            "joblib",
            "onnx",
            "onnxscript",
            "optuna",
            "sb3_contrib",
            "sqlalchemy",
            "tensorboard",
            "torch",
            "tqdm",
        ),
    ),
    "distributed": ("dask", "distributed", "psutil"),
    "publish": ("huggingface_hub",),
}
"""Import names of the packages that each extra of pyproject.toml installs."""
_CLONE_ONLY = ("benchmark", "distributed", "publish")


def provided(what: str) -> list[Any]:
    """Return the objects of installed packages for a group of entry points: ``commands``, ``viewer``, ``warm_up`` or ``rules``.

    Rules are declared by every installation, but only a clone has them. ModuleNotFoundError if an optional package is missing.
    """
    found = []
    for entry in entry_points(group=f"turning_env.{what}"):
        try:
            found.append(entry.load())
        except ModuleNotFoundError as error:
            if error.name != entry.module.partition(".")[0]:
                raise
    return found


def missing(error: ModuleNotFoundError) -> str | None:
    """Return the message for a failed import of an optional package; None for other modules."""
    name = (error.name or "").partition(".")[0]
    for extra, packages in EXTRAS.items():
        if name in packages:
            source = (
                f"-e '.[{extra}]' in a clone"
                if extra in _CLONE_ONLY
                else f"'rough-turning[{extra}]'"
            )
            return f"{name} is not installed: pip install {source}"
    return None


@contextmanager
def needed(error_type: type[Exception] | None = None) -> Iterator[None]:
    """Wrap imports of optional packages, so that the error for a missing one says how to install it; ``error_type``: its type."""
    try:
        yield
    except ModuleNotFoundError as error:
        if (message := missing(error)) is None:
            raise
        raise (
            error_type(message) if error_type else ModuleNotFoundError(message, name=error.name)
        ) from None


def tell_plainly() -> None:
    """Let a missing optional package end ``python -m`` of the caller's modules with one line and status 2."""

    def print_missing(
        kind: type[BaseException], error: BaseException, traceback: TracebackType | None
    ) -> None:
        if isinstance(error, ModuleNotFoundError) and (message := missing(error)):
            print(f"error: {message}", file=sys.stderr)
            sys.exit(2)
        sys.__excepthook__(kind, error, traceback)

    if sys.argv[:1] == ["-m"]:  # set while the interpreter looks for the module to run
        sys.excepthook = print_missing

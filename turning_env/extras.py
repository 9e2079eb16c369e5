"""Messages for optional packages that are not installed."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType

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
"""Arguments of ``pip install``, and the import names of the packages that it brings."""
TABLES: list[Mapping[str, Sequence[str]]] = [EXTRAS]
"""Tables of this form, best first; another distribution inserts its own when it is imported."""


def missing(error: ModuleNotFoundError) -> str | None:
    """Return the message for a failed import of an optional package; None for other modules."""
    name = (error.name or "").partition(".")[0]
    if name == "baselines":
        return _foreign_baselines()
    for table in TABLES:
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

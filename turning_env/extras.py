"""What a program says when an optional package that it needs is not installed: its name and how to get it, and no traceback."""

import sys
from types import TracebackType

BENCHMARK = "pip install -e '.[benchmark]' in a clone"
HOW = {
    **dict.fromkeys(
        (
            *("joblib", "jinja2", "matplotlib", "onnx", "onnxruntime", "onnxscript", "optuna", "sb3_contrib", "scipy"),
            *("sqlalchemy", "stable_baselines3", "tensorboard", "torch", "tqdm"),
        ),
        BENCHMARK,
    ),
    **dict.fromkeys(("dask", "distributed", "psutil"), "pip install -e '.[distributed]' in a clone"),
    **dict.fromkeys(("PIL", "pygame"), 'pip install "rough-turning[render]"'),
    **dict.fromkeys(("h5py", "minari", "moviepy", "rl_zoo3", "torchrl"), 'pip install "rough-turning[ecosystem]"'),
}
"""How the optional packages, by the names under which they are imported, are installed."""


def missing(error: BaseException) -> str | None:
    """What to tell people of an import that failed; None if it is not of an optional package."""
    if not isinstance(error, ModuleNotFoundError):
        return None
    name = (error.name or "").partition(".")[0]
    return f"{name} is not installed: {HOW[name]}" if name in HOW else None


def tell_plainly() -> None:
    """Have an optional package that is missing end this program with one line and status 2, as bad input does.

    Called by packages whose modules are run by ``python -m``, before they import what may be missing; does nothing to a program
    that only imports them.
    """
    if sys.argv[:1] == ["-m"]:  # so it is while the interpreter looks for the module to run
        sys.excepthook = _told


def _told(kind: type[BaseException], error: BaseException, traceback: TracebackType | None) -> None:
    if (what := missing(error)) is None:
        sys.__excepthook__(kind, error, traceback)
        return
    print(f"error: {what}", file=sys.stderr)
    sys.exit(2)

"""Show how dense the code is, package by package, beside the goals.

    python tools/density.py
    python tools/density.py turning_env baselines/models

Docstrings and blank lines do not count as code. Readable code of the field (gymnax, Gymnasium, sbx,
PureJaxRL, mujoco_playground, rliable), counted in the same way, has 4.4 to 5.5 syntax nodes a line,
a median width of 28 to 31 characters, no packs, at most 1.4 wide assignments per 1,000 lines, and 3
to 10 comments per 100 lines. Only the standard library is needed.
"""

import ast
import io
import statistics
import subprocess
import sys
import tokenize
from dataclasses import dataclass, field
from pathlib import Path

LONG_FUNCTION = 50  # statements
WIDE_ASSIGNMENT = 3  # names bound at once
GOALS = "goals: 6.5 nodes per line, 0 packs, 6 wide assignments per 1,000 lines"


@dataclass
class Density:
    """Counts over some files."""

    lines: int = 0  # of code
    nodes: int = 0  # of syntax
    packs: int = 0  # calls and displays that unpack a literal, such as f(*(a, b))
    wide_assignments: int = 0
    comments: int = 0  # on a line of their own
    long_functions: int = 0
    nested_conditionals: int = 0  # a conditional expression in another one
    widths: list[int] = field(default_factory=list)  # of each line without its indent

    def row(self, folder: str) -> str:
        """Return a line of the table; see ``HEADER``."""
        lines = max(self.lines, 1)
        width = statistics.median(self.widths) if self.widths else 0
        return (
            f"{folder:28}{self.lines:>7}{self.nodes / lines:>12.1f}{width:>7.0f}{self.packs:>7}"
            f"{1000 * self.wide_assignments / lines:>7.1f}{100 * self.comments / lines:>10.1f}"
            f"{self.long_functions:>6}{self.nested_conditionals:>8}"
        )


HEADER = (
    f"{'folder':28}{'code':>7}{'nodes/line':>12}{'width':>7}{'packs':>7}{'wide=':>7}"
    f"{'comments':>10}{'long':>6}{'nested':>8}"
)


def count_file(text: str, density: Density) -> None:
    """Add the counts of one file's text."""
    tree = ast.parse(text)
    strings = docstrings(tree)
    docstring_lines: set[int] = set()
    for statement in strings:
        docstring_lines.update(range(statement.lineno, (statement.end_lineno or 0) + 1))
    comment_lines = own_line_comments(text)
    density.comments += len(comment_lines)
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and number not in docstring_lines and number not in comment_lines:
            density.lines += 1
            density.widths.append(len(line.strip()))
    ignored = {
        id(statement.value)
        for statement in ast.walk(tree)
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if id(node) not in ignored and not isinstance(node, ast.expr_context):
            count_node(node, density)


def count_node(node: ast.AST, density: Density) -> None:
    """Add one syntax node."""
    density.nodes += 1
    if isinstance(node, ast.Starred):
        density.packs += isinstance(node.value, ast.Tuple | ast.List)
    elif isinstance(node, ast.Assign):
        target = node.targets[0]
        if isinstance(target, ast.Tuple):
            density.wide_assignments += len(target.elts) >= WIDE_ASSIGNMENT
    elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        statements = sum(isinstance(part, ast.stmt) for part in ast.walk(node)) - 1
        density.long_functions += statements > LONG_FUNCTION
    elif isinstance(node, ast.IfExp):
        inner = [
            part for part in ast.walk(node) if isinstance(part, ast.IfExp) and part is not node
        ]
        density.nested_conditionals += bool(inner)


def docstrings(tree: ast.AST) -> list[ast.Expr]:
    """Return the statements that are only a string: docstrings, also those of attributes."""
    statements = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Expr):
            continue
        if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            statements.append(node)
    return statements


def own_line_comments(text: str) -> set[int]:
    """Return the numbers of lines that hold only a comment."""
    lines = text.splitlines()
    numbers = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        row = token.start[0]
        if token.type == tokenize.COMMENT and lines[row - 1].lstrip().startswith("#"):
            numbers.add(row)
    return numbers


def tracked_files() -> list[str]:
    """Return the Python files that git tracks in the current folder."""
    command = ["git", "ls-files", "*.py"]
    listed = subprocess.run(command, capture_output=True, text=True, check=True)
    return listed.stdout.split()


def main(folders: list[str]) -> None:
    """Print the table of folders or files; none: all folders at the top, and the whole."""
    files = [name for name in tracked_files() if Path(name).exists()]
    print(HEADER)
    whole = Density()
    for folder in folders or sorted({name.split("/")[0] for name in files if "/" in name}):
        density = Density()
        for name in files:
            if name == folder or name.startswith(folder.rstrip("/") + "/"):
                text = Path(name).read_text("utf-8")
                count_file(text, density)
                count_file(text, whole)
        print(density.row(folder))
    print(whole.row("all"))
    print(GOALS)


if __name__ == "__main__":
    main(sys.argv[1:])

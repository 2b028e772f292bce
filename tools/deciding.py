"""The numbers that decide, by room: every literal but 0, 1, 2 and 1/2, whatever its sign.

    python tools/deciding.py                     # how many, by room and file
    python tools/deciding.py --list legs fit     # each of them in files whose path holds a word

Each entry of a table counts as one. *Named*: in a constant of the module or a field of a record,
where it has a place for its unit and its reason; *inline*: typed inside a function. Nothing is left
out for being harmless: a guard against a division by nothing is a number too. `benchmarks/
sensitivity.py` moves the named ones.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ROOMS = (
    "timing/pulses", "reconstruct/model", "reconstruct/legs", "reconstruct/fit",
    "reconstruct/all_counts", "reconstruct/other_light", "reconstruct/trials",
    "reconstruct/verdict",
)  # fmt: skip
"""Where pulses, legs and paths are found, fitted and judged, from below."""

_FINDING_AND_FITTING = ("legs", "fit", "all_counts", "other_light", "trials")

_SELF_EXPLAINING = (0, 1, 2, 0.5)

Function = ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda


@dataclass(frozen=True)
class Number:
    """One literal.

    Attributes
    ----------
    file : str
        Below src/lightflight.
    line, column : int
        Where it stands.
    value : int or float
        Without its sign.
    owner : str
        The constant, field (`Record.field`) or function that it belongs to.
    named : bool
        Whether that is a constant or a field.
    """

    file: str
    line: int
    column: int
    value: float
    owner: str
    named: bool


def numbers_in(text: str, file: str) -> tuple[Number, ...]:
    """The numbers of a file's text, in the order in which they stand."""
    return tuple(one for one in literals_in(text, file) if one.value not in _SELF_EXPLAINING)


def literals_in(text: str, file: str) -> tuple[Number, ...]:
    """The same with 0, 1, 2 and 1/2: a named 1.0 may decide as well as any other."""
    found = [
        Number(file, node.lineno, node.col_offset, value, owner, named)
        for node, value, owner, named in _literals(ast.parse(text), "", False)
    ]
    return tuple(sorted(found, key=lambda one: (one.line, one.column)))


def _literals(
    node: ast.AST, owner: str, named: bool
) -> Iterator[tuple[ast.Constant, float, str, bool]]:
    """(literal, value, owner, named) of all numbers below a node."""
    if isinstance(node, ast.Constant):
        if isinstance(node.value, int | float) and not isinstance(node.value, bool):
            yield node, node.value, owner, named
        return
    inside = owner
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        inside = f"{owner}.{node.name}" if owner else node.name
        named = isinstance(node, ast.ClassDef)
    elif isinstance(node, ast.Lambda) and not owner:
        named = False
    elif isinstance(node, ast.Assign | ast.AnnAssign) and (named or not owner):
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        inside = f"{owner}.{ast.unparse(target)}" if owner else ast.unparse(target)
        named = True
    for child in ast.iter_child_nodes(node):
        yield from _literals(child, inside, named)


def numbers_of(
    tree: Path, room: str, those_in: Callable[[str, str], tuple[Number, ...]] = numbers_in
) -> tuple[Number, ...]:
    """The numbers of all files of a room in a checkout."""
    package = tree / "src" / "lightflight"
    return tuple(
        number
        for path in sorted((package / room).glob("*.py"))
        for number in those_in(path.read_text("utf-8"), path.relative_to(package).as_posix())
    )


def table_of(tree: Path) -> str:
    """Markdown: named, inline and all, by file and room."""
    rows = ["| room or file | named | inline | all |", "|---|---:|---:|---:|"]
    whole: list[Number] = []
    for room in ROOMS:
        own = numbers_of(tree, room)
        whole += own
        rows.append(_row(f"**{room}**", own))
        files = sorted({one.file for one in own})
        rows += [_row(file, [one for one in own if one.file == file]) for file in files]
    found_and_fitted = [one for one in whole if one.file.split("/")[1] in _FINDING_AND_FITTING]
    rows.append(
        _row(f"**finding and fitting ({', '.join(_FINDING_AND_FITTING)})**", found_and_fitted)
    )
    rows.append(_row("**all of these rooms**", whole))
    return "\n".join(rows)


def _row(name: str, numbers: list[Number] | tuple[Number, ...]) -> str:
    named = sum(one.named for one in numbers)
    return f"| {name} | {named} | {len(numbers) - named} | {len(numbers)} |"


def main() -> None:
    """Count, or list."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--list", nargs="*", metavar="WORD", help="each number; none: of all files")
    args = parser.parse_args()
    if args.list is None:
        print(table_of(ROOT))
        return
    for room in ROOMS:
        for one in numbers_of(ROOT, room):
            if not args.list or any(word in one.file for word in args.list):
                print(f"{one.file}:{one.line}: {one.value:g} in {one.owner or 'the module'}")


if __name__ == "__main__":
    main()

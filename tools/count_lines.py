"""The house in numbers: code lines per room, docstrings, comments, `Any`, imports, walks.

    python tools/count_lines.py                          # this checkout
    python tools/count_lines.py --against ../before      # another checkout beside it
    python tools/count_lines.py --no-walks --json        # a list of reports, nothing is run

What is counted, and how, is said in `house.py`; the walks in `walks.py`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from house import PACKAGE, House, Source, house_from_tree, median

_HERE = Path(__file__).parent

ROOM_COLUMNS: dict[str, Callable[[Source], int]] = {
    "code": lambda source: len(source.code_lines),
    "docstrings": lambda source: len(source.docstring_lines),
    "comments": lambda source: source.n_comments,
    "Any": lambda source: source.n_any,
    "constants": lambda source: len(source.constants),
    "numbers inline": lambda source: source.n_inline_numbers,
    "files": lambda _: 1,
}


def rooms_table(house: House) -> dict[str, dict[str, int]]:
    """What each room holds: the columns of `ROOM_COLUMNS`, and lines of JS, CSS and HTML."""
    table = {}
    for room, sources in house.rooms.items():
        table[room] = {name: sum(map(of, sources)) for name, of in ROOM_COLUMNS.items()}
        table[room]["web"] = house.web_lines.get(room, 0)
    return table


def totals(house: House) -> dict[str, float]:
    """The figures of the whole tree, by what they are called in the table."""
    sources = house.sources
    code = sum(len(source.code_lines) for source in sources)
    docstrings = sum(len(source.docstring_lines) for source in sources)
    fields = sum(len(source.field_lines) for source in sources)
    comments = sum(source.n_comments for source in sources)
    functions = [n for source in sources for n in source.functions.values()]
    widths = [len(source.lines[n - 1]) for source in sources for n in source.code_lines]
    figures = {
        "code lines": code,
        "lines of JS, CSS and HTML": sum(house.web_lines.values()),
        "files": len(sources),
        "files above 600 lines": sum(len(source.lines) > 600 for source in sources),
        "rooms that are folders": len(house.rooms) - 1,
        "docstring lines": docstrings,
        "docstrings, % of code lines": 100 * docstrings / code,
        "sentences under fields, lines": fields,
        "comment lines per 100 code lines": 100 * comments / code,
        "line, median characters": median(widths),
        "function, median code lines": median(functions),
        "function, 95 % at most, code lines": sorted(functions)[int(0.95 * len(functions))],
        "functions": len(functions),
        "whole type `Any`": sum(source.n_annotated_any for source in sources),
        "names `Any`": sum(source.n_any for source in sources),
        "arrows between rooms": len(house.arrows()),
        "arrows between rooms, annotations too": len(house.arrows(typing_too=True)),
        "arrows up": len(house.arrows_up()),
        "arrows up, annotations too": len(house.arrows_up(typing_too=True)),
        "pairs of rooms that import each other": len(house.mutual),
        "circles of files": len(house.circles),
        "files in circles": sum(map(len, house.circles)),
        "deferred internal imports": house.n_deferred,
    }
    return {name: round(value, 1) for name, value in figures.items()}


def largest(house: House, n: int = 8) -> dict[str, dict[str, int]]:
    """The largest files and the longest functions, by code lines."""
    files = {source.name: len(source.code_lines) for source in house.sources}
    functions = {name: k for source in house.sources for name, k in source.functions.items()}
    return {"largest files": _top(files, n), "longest functions": _top(functions, n)}


def _top(lines: dict[str, int], n: int) -> dict[str, int]:
    return dict(sorted(lines.items(), key=lambda item: -item[1])[:n])


def walks_of(tree: Path) -> dict[str, dict[str, Any]]:
    """The three walks through a checkout, in a Python of its own."""
    inside = tree / "src"
    path = inside if inside.is_dir() else tree.parent
    done = subprocess.run(
        [sys.executable, _HERE / "walks.py"],
        env=os.environ | {"PYTHONPATH": str(path), "NUMBA_NUM_THREADS": "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    walks: dict[str, dict[str, Any]] = json.loads(done.stdout)
    return walks


def report(tree: Path, *, walks: bool) -> dict[str, Any]:
    """All figures of a tree.

    Raises
    ------
    FileNotFoundError
        Where no code of the package is there.
    """
    house = house_from_tree(tree)
    return {
        "totals": totals(house),
        "rooms": rooms_table(house),
        "circles": house.circles,
        "arrows up": sorted(house.arrows_up(typing_too=True)),
        "rooms that import each other": sorted(house.mutual),
        **largest(house),
        "walks": walks_of(tree) if walks else {},
    }


# --- as text -----------------------------------------------------------------------------


def text_from_reports(reports: Sequence[dict[str, Any]]) -> str:
    """Markdown of one report, or of two side by side (before, after)."""
    heads = ["before", "after"] if len(reports) == 2 else ["now"]
    blocks = [_compared("", heads, [report["totals"] for report in reports])]
    rooms = sorted({room for report in reports for room in report["rooms"]})
    columns = [*ROOM_COLUMNS, "web"]
    held = [[r["rooms"].get(room, dict.fromkeys(columns, 0)) for r in reports] for room in rooms]
    cells = [[_changed([one[name] for one in of_room]) for name in columns] for of_room in held]
    rows = [[room, *row] for room, row in zip(rooms, cells, strict=True)]
    blocks.append(_table(["room", *columns], rows))
    for walk in reports[0]["walks"]:
        counts = [{k: v for k, v in r["walks"][walk].items() if k != "way"} for r in reports]
        blocks.append(_compared(walk, heads, counts))
    for head, report in zip(heads, reports, strict=True):
        blocks.append("\n".join(f"{head}: {line}" for line in _places(report)))
    return "\n\n".join(blocks)


def _places(report: dict[str, Any]) -> list[str]:
    """What the counts stand for, in lines."""
    lines = [f"circle: {' '.join(_short(name) for name in circle)}" for circle in report["circles"]]
    lines += [f"arrow up: {_short(a)} -> {_short(b)}" for a, b in report["arrows up"]]
    lines += [f"each other: {a} <-> {b}" for a, b in report["rooms that import each other"]]
    for kind in ("largest files", "longest functions"):
        lines.append(f"{kind}: {', '.join(f'{name} {n}' for name, n in report[kind].items())}")
    return lines


def _short(module: str) -> str:
    return module.removeprefix(f"{PACKAGE}.")


def _changed(values: Sequence[int]) -> str:
    return " → ".join(f"{value:,}" for value in (values if len(set(values)) > 1 else values[:1]))


def _compared(title: str, heads: Sequence[str], figures: Sequence[dict[str, float]]) -> str:
    rows = [[name, *(f"{one[name]:,}" for one in figures)] for name in figures[0]]
    return _table([title, *heads], rows)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown, its columns aligned for eyes too."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    aligned = [
        [row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]
        for row in (head, rule, *rows)
    ]
    return "\n".join(f"| {' | '.join(row)} |" for row in aligned)


def main() -> None:
    """Count, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tree", nargs="?", type=Path, default=_HERE.parent, help="a checkout")
    parser.add_argument("--against", type=Path, metavar="TREE", help="the checkout before")
    parser.add_argument("--no-walks", action="store_true", help="run nothing (a walk: a minute)")
    parser.add_argument("--json", action="store_true", help="for programs")
    args = parser.parse_args()
    trees = [args.tree] if args.against is None else [args.against, args.tree]
    reports = [report(tree.resolve(), walks=not args.no_walks) for tree in trees]
    print(json.dumps(reports, indent=1) if args.json else text_from_reports(reports))


if __name__ == "__main__":
    main()

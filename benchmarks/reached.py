"""Which scenes a number of the package can change: those in which something that reads it runs.

Read off the text: the functions that hold the number's name, and those that hold a name worked out
from it where the modules are read. A name is a name here, whatever it stands for, so that too much
is tried rather than too little. Compiled functions are not seen running and always count.
"""

from __future__ import annotations

import ast
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "lightflight"

Place = tuple[str, int]
"""File below the package and first line of a function."""

_SEEN_RUNNING = {"property", "cached_property", "classmethod", "staticmethod"}

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class _Reader:
    """A function or a method, or what a module says outside of them, and the names in it."""

    file: str
    first_line: int
    last_line: int
    names: frozenset[str]
    makes: frozenset[str]
    """What it is where it is no function: names that are worked out when the module is read."""
    hidden: bool
    """Compiled, wrapped, or called where the module is read: whether it runs is not seen."""


def running(call: Callable[[], Any]) -> tuple[Any, set[Place]]:
    """What a call returns, and the functions of the package that it runs."""
    seen: set[CodeType] = set()

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            seen.add(frame.f_code)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        result = call()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    inside = f"{PACKAGE}/"
    return result, {
        (code.co_filename.removeprefix(inside), code.co_firstlineno)
        for code in seen
        if code.co_filename.startswith(inside) and code.co_name != "<module>"
    }


def may_change(names: set[str], ran: set[Place]) -> bool:
    """Whether something that reads one of these names, or may, is among what ran."""
    by_file: dict[str, list[int]] = {}
    for file, line in ran:
        by_file.setdefault(file, []).append(line)
    return any(
        one.hidden or any(one.first_line <= k <= one.last_line for k in by_file.get(one.file, ()))
        for one in _readers_of(frozenset(names))
    )


@cache
def _readers_of(names: frozenset[str]) -> list[_Reader]:
    """Functions that read the names, or what is worked out from them."""
    wanted, readers = set(names), _readers()
    while True:
        found = [one for one in readers if one.names & wanted]
        further = {name for one in found for name in one.makes} - wanted
        if not further:
            return [one for one in found if not one.makes]
        wanted |= further


@cache
def _readers() -> list[_Reader]:
    return [
        reader
        for path in sorted(PACKAGE.rglob("*.py"))
        for reader in _readers_in(
            ast.parse(path.read_text("utf-8")).body, path.relative_to(PACKAGE).as_posix()
        )
    ]


def _readers_in(body: list[ast.stmt], file: str) -> list[_Reader]:
    readers = []
    for node in body:
        if isinstance(node, ast.ClassDef):
            readers += _readers_in(node.body, file)
            continue
        makes: frozenset[str] = frozenset()
        first, hidden = node.lineno, False
        if isinstance(node, Function):
            first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
            hidden = any(ast.unparse(one) not in _SEEN_RUNNING for one in node.decorator_list)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            # A copy has the same name; another name for it stands for it.
            makes = frozenset(one.asname for one in node.names if one.asname)
        else:
            makes = frozenset(_names_in(node, ast.Store))
            # A call where the module is read: nobody sees what it leads to.
            hidden = isinstance(node, ast.Expr) and not isinstance(node.value, ast.Constant)
        if isinstance(node, Function) or makes or hidden:
            names = frozenset(_names_in(node))
            readers.append(_Reader(file, first, node.end_lineno or first, names, makes, hidden))
    return readers


def _names_in(node: ast.AST, context: type | None = None) -> set[str]:
    """Names, attributes and keywords below a node."""
    found = set()
    for one in ast.walk(node):
        if isinstance(one, ast.Name) and (context is None or isinstance(one.ctx, context)):
            found.add(one.id)
        elif context is None and isinstance(one, ast.Attribute):
            found.add(one.attr)
        elif context is None and isinstance(one, ast.keyword) and one.arg:
            found.add(one.arg)
        elif context is None and isinstance(one, ast.alias):
            found.add(one.name)
    return found

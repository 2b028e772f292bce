"""What a source tree of the package is made of: lines, numbers, functions, imports.

A room is the first part of a module's name below the package: a folder, or (for the arrows between
rooms and their order) a module that stands beside the folders. Lines are counted by tokens:

- a *code line* holds a token other than a comment or a string that stands as a statement of its
  own (docstrings, and the sentence under a field);
- a *docstring line* is a line, not blank, of the docstring of a module, class or function; the
  sentences under fields and constants are counted beside;
- a *comment* is a line that holds nothing else.

Imports are read, not run. A name taken from a package's door counts as taken from the module the
door has it from, whether the door imports it at once or says so under TYPE_CHECKING and fetches it
later. That a module's packages are imported before it is no arrow, nor is an import by string.
"""

from __future__ import annotations

import ast
import io
import statistics
import tokenize
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

PACKAGE = "lightflight"
TOP = "(top level)"
"""The modules beside the folders, taken together."""

_NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENCODING, tokenize.ENDMARKER,
}  # fmt: skip
_WEB = (".js", ".css", ".html")
_SELF_EXPLAINING = (0, 1, 2, -1, 0.5)

Function = ast.FunctionDef | ast.AsyncFunctionDef
Arrow = tuple[str, str]


@dataclass(frozen=True)
class Import:
    """One module imported by another."""

    module: str
    """The importing one."""
    target: str
    statement: int
    """Line of the statement."""
    deferred: bool
    """Inside a function: it runs when that is called."""
    typing_only: bool
    """Under TYPE_CHECKING: it never runs."""


@dataclass(frozen=True)
class Source:
    """One file of Python."""

    name: str
    """Path below the package, e.g. view/style.py."""
    text: str

    @property
    def module(self) -> str:
        """Dotted name."""
        parts = [PACKAGE, *Path(self.name).with_suffix("").parts]
        return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

    @property
    def room(self) -> str:
        """The folder it stands in, or `TOP`."""
        first, *rest = Path(self.name).parts
        return first if rest else TOP

    @cached_property
    def tree(self) -> ast.Module:
        """Its syntax."""
        return ast.parse(self.text)

    @cached_property
    def lines(self) -> list[str]:
        """Its lines."""
        return self.text.splitlines()

    @cached_property
    def code_lines(self) -> frozenset[int]:
        """Numbers of its code lines."""
        tokens = tokenize.generate_tokens(io.StringIO(self.text).readline)
        held = {n for token in tokens if token.type not in _NO_CODE for n in _span(token)}
        return frozenset(held - {n for node in self._sentences() for n in _lines_of(node)})

    @cached_property
    def docstring_lines(self) -> frozenset[int]:
        """Numbers of the lines, not blank, of docstrings."""
        return self._written(_docstrings(self.tree))

    @cached_property
    def field_lines(self) -> frozenset[int]:
        """Numbers of the lines, not blank, of sentences that stand under a field or constant."""
        return self._written(self._sentences()) - self.docstring_lines

    @property
    def n_comments(self) -> int:
        """Lines that hold a comment and nothing else."""
        tokens = tokenize.generate_tokens(io.StringIO(self.text).readline)
        return sum(t.type == tokenize.COMMENT and t.line.lstrip().startswith("#") for t in tokens)

    @cached_property
    def functions(self) -> dict[str, int]:
        """Code lines of each function and method, `def` included, by place and name."""
        return {
            f"{self.name}:{node.lineno} {node.name}": len(self.code_lines & {*_lines_of(node)})
            for node in ast.walk(self.tree)
            if isinstance(node, Function)
        }

    @property
    def n_any(self) -> int:
        """Uses of the name `Any`."""
        return sum(isinstance(node, ast.Name) and node.id == "Any" for node in ast.walk(self.tree))

    @property
    def n_annotated_any(self) -> int:
        """Arguments, fields and results whose whole type is `Any`."""
        types = [
            node.returns if isinstance(node, Function) else node.annotation
            for node in ast.walk(self.tree)
            if isinstance(node, ast.arg | ast.AnnAssign | Function)
        ]
        return sum(isinstance(kind, ast.Name) and kind.id == "Any" for kind in types)

    @property
    def constants(self) -> list[str]:
        """Names in capitals that the module sets, with or without underscore."""
        return [
            target.id
            for node in self.tree.body
            if isinstance(node, ast.Assign | ast.AnnAssign)
            for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
            if isinstance(target, ast.Name) and target.id.isupper()
        ]

    @property
    def n_inline_numbers(self) -> int:
        """Numbers typed inside functions that do not explain themselves as 0, 1, 2 or 1/2 do."""
        numbers = {
            (node.lineno, node.col_offset): node.value
            for function in ast.walk(self.tree)
            if isinstance(function, Function)
            for node in ast.walk(function)
            if isinstance(node, ast.Constant) and type(node.value) in (int, float)
        }
        return sum(value not in _SELF_EXPLAINING for value in numbers.values())

    @cached_property
    def lent(self) -> dict[str, tuple[str, str]]:
        """Names that a door (`__init__.py`) hands on: (module, name) where it has them from."""
        if not self.name.endswith("__init__.py"):
            return {}
        return {
            alias.asname or alias.name: (node.module, alias.name)
            for node, _, _ in _import_statements(self.tree)
            if isinstance(node, ast.ImportFrom) and node.module is not None
            for alias in node.names
        }

    def _sentences(self) -> list[ast.AST]:
        """Strings that stand as a statement."""
        nodes = (node for node in ast.walk(self.tree) if isinstance(node, ast.Expr))
        return [node for node in nodes if _is_text(node)]

    def _written(self, nodes: Iterable[ast.AST]) -> frozenset[int]:
        numbers = {n for node in nodes for n in _lines_of(node)}
        return frozenset(n for n in numbers if self.lines[n - 1].strip())


def _span(token: tokenize.TokenInfo) -> range:
    return range(token.start[0], token.end[0] + 1)


def _lines_of(node: ast.AST) -> range:
    assert isinstance(node, ast.stmt)
    assert node.end_lineno is not None
    return range(node.lineno, node.end_lineno + 1)


def _is_text(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def _docstrings(tree: ast.Module) -> list[ast.stmt]:
    holders = (n for n in ast.walk(tree) if isinstance(n, ast.Module | ast.ClassDef | Function))
    return [node.body[0] for node in holders if node.body and _is_text(node.body[0])]


# --- a house -----------------------------------------------------------------------------


@dataclass(frozen=True)
class House:
    """The files of a tree, and the order in which its modules may import each other."""

    sources: tuple[Source, ...]
    web_lines: Mapping[str, int]
    """Lines of JavaScript, CSS and HTML by room."""
    contracts: tuple[Mapping[str, list[str]], ...] = ()
    """The layer contracts of import-linter: `containers` and `layers`, the highest first."""

    @cached_property
    def rooms(self) -> dict[str, list[Source]]:
        """Files by room."""
        rooms: dict[str, list[Source]] = {}
        for source in self.sources:
            rooms.setdefault(source.room, []).append(source)
        return rooms

    @cached_property
    def imports(self) -> list[Import]:
        """Every import of a module of the package by another."""
        modules = {source.module: source for source in self.sources}
        return [
            Import(source.module, target, node.lineno, deferred, typing_only)
            for source in self.sources
            for node, deferred, typing_only in _import_statements(source.tree)
            for target in sorted(set(_targets(node, modules)) - {source.module})
        ]

    def arrows(self, *, typing_too: bool = False) -> set[Arrow]:
        """(from, to) of rooms, where modules beside the folders are rooms of their own."""
        pairs = {
            (_below(one.module, PACKAGE), _below(one.target, PACKAGE))
            for one in self.imports
            if typing_too or not one.typing_only
        }
        return {(a, b) for a, b in pairs if a and b and a != b}

    def arrows_up(self, *, typing_too: bool = False) -> set[Arrow]:
        """(from, to) of what imports something above it, or beside it where that is forbidden."""
        return {
            (f"{container}.{a}", f"{container}.{b}")
            for contract in self.contracts
            for container in contract["containers"]
            for one in self.imports
            if typing_too or not one.typing_only
            if (a := _below(one.module, container)) and (b := _below(one.target, container))
            if a != b and _is_up(a, b, contract["layers"])
        }

    @property
    def mutual(self) -> set[Arrow]:
        """Pairs of rooms that import each other: no order holds between them."""
        arrows = self.arrows()
        return {(a, b) for a, b in arrows if a < b and (b, a) in arrows}

    @cached_property
    def circles(self) -> list[list[str]]:
        """Files that can each be reached from the others by imports that run, now or later."""
        graph: dict[str, set[str]] = {source.module: set() for source in self.sources}
        for one in self.imports:
            if not one.typing_only:
                graph[one.module].add(one.target)
        return circles_of(graph)

    @property
    def n_deferred(self) -> int:
        """Import statements inside functions that import a module of the package."""
        return len({(one.module, one.statement) for one in self.imports if one.deferred})


def house_from_tree(tree: Path) -> House:
    """The house at a checkout, or at a folder of the package's code.

    Raises
    ------
    FileNotFoundError
        Where no code of the package is there.
    """
    inside = tree / "src" / PACKAGE
    package = inside if inside.is_dir() else tree
    if not (package / "__init__.py").is_file():
        raise FileNotFoundError(f"{tree} is neither a checkout nor a package: no __init__.py in it")
    web: dict[str, int] = {}
    for path in (path for path in package.rglob("*") if path.suffix in _WEB):
        first, *rest = path.relative_to(package).parts
        room = first if rest else TOP
        web[room] = web.get(room, 0) + len(path.read_text(encoding="utf-8").splitlines())
    sources = tuple(
        Source(path.relative_to(package).as_posix(), path.read_text(encoding="utf-8"))
        for path in sorted(package.rglob("*.py"))
    )
    settings = next((p / "pyproject.toml" for p in (package, *package.parents[:2])
                     if (p / "pyproject.toml").is_file()), None)  # fmt: skip
    return House(sources, web, () if settings is None else layer_contracts(settings.read_text()))


def layer_contracts(pyproject: str) -> tuple[Mapping[str, list[str]], ...]:
    """The layer contracts in the text of a pyproject.toml."""
    settings = tomllib.loads(pyproject)["tool"].get("importlinter", {})
    return tuple(c for c in settings.get("contracts", []) if c["type"] == "layers")


def _import_statements(tree: ast.Module) -> Iterator[tuple[ast.stmt, bool, bool]]:
    """(statement, inside a function, under `if TYPE_CHECKING`) of every import."""
    to_do: list[tuple[ast.AST, bool, bool]] = [(tree, False, False)]
    while to_do:
        node, deferred, typing_only = to_do.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node, deferred, typing_only
        deferred = deferred or isinstance(node, Function | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            asked = isinstance(node, ast.If) and child in node.body and _asks_for_typing(node.test)
            to_do.append((child, deferred, typing_only or asked))


def _asks_for_typing(test: ast.expr) -> bool:
    return ast.unparse(test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING")


def _targets(node: ast.stmt, modules: Mapping[str, Source]) -> Iterator[str]:
    """Modules of the package that an import statement names."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names if alias.name in modules)
    elif isinstance(node, ast.ImportFrom) and node.module is not None and node.module in modules:
        yield from (_home(node.module, alias.name, modules) for alias in node.names)


def _home(module: str, name: str, modules: Mapping[str, Source]) -> str:
    """The module that `from module import name` has the name from."""
    if f"{module}.{name}" in modules:
        return f"{module}.{name}"
    lent = modules[module].lent.get(name)
    if lent is not None and lent[0] in modules and lent[0] != module:
        return _home(*lent, modules)
    return module


def _below(module: str, container: str) -> str:
    """The part of a module's name that follows a container's, "" where it is not inside."""
    inside = module.startswith(f"{container}.")
    return module.removeprefix(f"{container}.").partition(".")[0] if inside else ""


def _is_up(a: str, b: str, layers: list[str]) -> bool:
    order = {
        name.strip(" ()"): (level, "|" in line)
        for level, line in enumerate(layers)
        for name in line.replace("|", ":").split(":")
    }
    if a not in order or b not in order:
        return False
    (level_a, independent), (level_b, _) = order[a], order[b]
    return level_b < level_a or (level_a == level_b and independent)


def circles_of(graph: Mapping[str, Iterable[str]]) -> list[list[str]]:
    """Strongly connected components of two or more nodes (Tarjan 1972), the largest first."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in graph[node]:
            if other not in index:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == index[node]:
            start = stack.index(node)
            if len(stack) - start > 1:
                found.append(sorted(stack[start:]))
            del stack[start:]

    for node in graph:
        if node not in index:
            visit(node)
    return sorted(found, key=lambda circle: (-len(circle), circle))


def stops_and_turns(files: Iterable[str]) -> tuple[int, int, int]:
    """(stops, files, turns) of a way: a stop is another file than before, a turn one seen before.

    Each stop is either the first in its file or a turn.
    """
    way = ["", *files]
    stops = [b for a, b in pairwise(way) if a != b]
    return len(stops), len(set(stops)), len(stops) - len(set(stops))


def median(values: Iterable[int]) -> float:
    """Median, 0 of nothing."""
    ordered = list(values)
    return statistics.median(ordered) if ordered else 0.0

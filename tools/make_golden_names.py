"""Write the list of public names: what programs and scripts written for c76c0a6 rely on.

Run once, with the code of commit c76c0a6 and never again; `tests/contracts/test_golden_names.py`
holds every later version against the list.

    git worktree add ../before c76c0a6
    PYTHONPATH=../before/src python tools/make_golden_names.py ../before

Public is what `lightflight`, `lightflight.view` and the packages below list as theirs, what the
modules on docs/reference/api.md define, and whatever a page or an example imports.
"""

from __future__ import annotations

import ast
import importlib
import importlib.resources
import inspect
import json
import re
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any, get_origin

import click

FILE = Path(__file__).resolve().parents[1] / "tests" / "data" / "golden" / "public_names.json"
PACKAGES = ("lightflight", "lightflight.view", "lightflight.simulate", "lightflight.reconstruct")
RETURNED = (
    ("lightflight.batch.campaign", "Campaign"),
    ("lightflight.batch.run", "StoppedError"),
    ("lightflight.batch.table", "CampaignTable"),
    ("lightflight.batch.table", "Repeats"),
    ("lightflight.path_error", "PathError"),
    ("lightflight.timing.response", "Response"),
    ("lightflight.view.observation", "Observation"),
)
"""Classes that public functions give and raise, and that no page imports."""

_IMPORT = re.compile(r"^[ >.]*from (lightflight[\w.]*) import (\([^)]*\)|[^\n(#]+)", re.M)


# --- one name --------------------------------------------------------------------------------


def what_is(thing: Any) -> dict[str, Any]:
    """Kind, signature and members of one public thing."""
    if isinstance(thing, ModuleType) and not callable(thing):
        return {"kind": "module"}
    if inspect.isclass(thing):
        return {"kind": "class", "signature": signature_of(thing), "members": members_of(thing)}
    if callable(thing) and get_origin(thing) is None:
        return {"kind": "function", "signature": signature_of(thing)}
    return {"kind": "value", **({"value": in_json(thing)} if is_simple(thing) else {})}


def is_simple(value: Any) -> bool:
    """True for what JSON holds."""
    if isinstance(value, tuple):
        return all(map(is_simple, value))
    return isinstance(value, str | int | float | bool | None)


def in_json(value: Any) -> Any:
    """A simple value as JSON gives it back."""
    return [in_json(item) for item in value] if isinstance(value, tuple) else value


def signature_of(thing: Any) -> list[list[str]] | None:
    """Name, kind and default of each parameter; None for what Python's own classes take."""
    if inspect.isclass(thing) and not any(
        method in vars(base)
        for base in thing.__mro__
        if is_ours(base)
        for method in ("__init__", "__new__")
    ):
        return None
    return [
        [parameter.name, parameter.kind.name, default_of(parameter)]
        for parameter in inspect.signature(thing).parameters.values()
    ]


def default_of(parameter: inspect.Parameter) -> str:
    """Text of a default, whatever module its type lies in; empty: none."""
    if parameter.default is inspect.Parameter.empty:
        return ""
    return re.sub(r"lightflight[\w.]*\.| at 0x\w+", "", repr(parameter.default))


def is_ours(base: type) -> bool:
    """True for a class of this package."""
    return base.__module__.partition(".")[0] == "lightflight"


def members_of(thing: type) -> dict[str, Any]:
    """Public methods, properties, fields and values of a class, those of its bases included."""
    members: dict[str, Any] = {}
    for base in reversed([one for one in thing.__mro__ if is_ours(one)]):
        names = {**vars(base), **getattr(base, "__annotations__", {})}
        for name in names:
            if not name.startswith("_"):
                members[name] = member_of(thing, name)
    return members


def member_of(thing: type, name: str) -> dict[str, Any]:
    """What an attribute of a class is: a method with its signature, or something to read."""
    found = inspect.getattr_static(thing, name, None)
    if inspect.isfunction(found) or isinstance(found, classmethod | staticmethod):
        return {"kind": "method", "signature": signature_of(getattr(thing, name))}
    if found is None or name in getattr(thing, "__dataclass_fields__", {}):
        return {"kind": "attribute"}
    return {"kind": "attribute", **({"value": in_json(found)} if is_simple(found) else {})}


# --- which names -----------------------------------------------------------------------------


def names_defined_in(module: ModuleType) -> list[str]:
    """Public names that a module defines itself, not those it imports."""
    assert module.__file__
    found: list[str] = []
    for node in ast.parse(Path(module.__file__).read_text("utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.append(node.name)
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            walked = (part for target in targets for part in ast.walk(target))
            found += [part.id for part in walked if isinstance(part, ast.Name)]
    return [name for name in found if not name.startswith("_") and not is_alias(module, name)]


def is_alias(module: ModuleType, name: str) -> bool:
    """True for a short name of a type, such as `Floats`: for readers of the module alone."""
    return get_origin(getattr(module, name)) is not None


def documented_names(root: Path) -> set[tuple[str, str]]:
    """(module, name) of what docs/reference/api.md lists; a module stands for all it defines."""
    names, package = set(), "lightflight"
    for line in (root / "docs" / "reference" / "api.md").read_text("utf-8").splitlines():
        package = line.partition("currentmodule:: ")[2] or package
        if not re.fullmatch(r"   ~?[\w.]+", line):
            continue
        dotted = f"{package}.{line.strip().removeprefix('~')}"
        module = module_or_none(dotted)
        if module is not None:
            names |= {(dotted, name) for name in ("", *names_defined_in(module))}
        else:
            home, _, name = dotted.rpartition(".")
            names.add((home, name))
    return names


def module_or_none(dotted: str) -> ModuleType | None:
    """A module that is not at the same time a public function."""
    try:
        module = importlib.import_module(dotted)
    except ModuleNotFoundError:
        return None
    return None if callable(module) else module


def imported_names(root: Path) -> set[tuple[str, str]]:
    """(module, name) of every `from lightflight... import` on pages and in examples."""
    names = set()
    pages = [root / "README.md", *root.glob("docs/**/*.md"), *root.glob("examples/*.py")]
    for page in pages:
        for module, listed in _IMPORT.findall(page.read_text("utf-8")):
            words = re.findall(r"\w+(?: as \w+)?", listed.strip("()"))
            names |= {(module, word.partition(" as ")[0]) for word in words}
    return names


def public_names(root: Path) -> dict[str, dict[str, Any]]:
    """All public names by the module they are imported from; "" stands for the module."""
    pairs = documented_names(root) | imported_names(root) | {*RETURNED}
    for package in PACKAGES:
        pairs |= {(package, name) for name in importlib.import_module(package).__all__}
    found: dict[str, dict[str, Any]] = {}
    for module, name in sorted(pairs - {("lightflight", "__version__")}):
        home = importlib.import_module(module)
        found.setdefault(module, {})[name] = what_is(getattr(home, name) if name else home)
    return found


# --- the command line ------------------------------------------------------------------------


def what_a_command_takes(command: click.Command) -> dict[str, Any]:
    """Options and arguments of a command, and its subcommands."""
    subcommands = getattr(command, "commands", {})
    return {
        "parameters": {str(one.name): what_a_parameter_is(one) for one in command.params},
        "commands": {name: what_a_command_takes(one) for name, one in subcommands.items()},
    }


def what_a_parameter_is(parameter: click.Parameter) -> dict[str, Any]:
    """Spelling, number and choices of an option or argument, and its default where it has one."""
    default = parameter.default
    return {
        "kind": parameter.param_type_name,
        "spellings": sorted([*parameter.opts, *parameter.secondary_opts]),
        "nargs": parameter.nargs,
        "multiple": parameter.multiple,
        "required": parameter.required,
        "is_flag": bool(getattr(parameter, "is_flag", False)),
        "choices": list(getattr(parameter.type, "choices", ())),
        "default": default if isinstance(default, str | int | float) and default else None,
    }


def exit_codes() -> dict[str, str]:
    """Every exit code and its meaning, as `lightflight --help` tells them."""
    from click.testing import CliRunner

    from lightflight.cli import main

    text = CliRunner().invoke(main, ["--help"]).stdout.partition("Exit codes:\n")[2]
    return dict(re.findall(r"^\s+(\d+)  (.+)$", text, re.M))


def manifest_lines() -> list[str]:
    """What the manifest of the napari plug-in says, but for where its functions lie."""
    text = importlib.resources.files("lightflight.view").joinpath("napari.yaml").read_text("utf-8")
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith("python_name")]


def main() -> None:
    """Write the list; the one argument is the folder of that version."""
    from lightflight.cli import main as command_line

    root = Path(sys.argv[1])
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    content = {
        "names": public_names(root),
        "command_line": what_a_command_takes(command_line),
        "exit_codes": exit_codes(),
        "scripts": project["scripts"],
        "entry_points": project["entry-points"],
        "extras": sorted(project["optional-dependencies"]),
        "napari": manifest_lines(),
    }
    FILE.write_text(json_text(content, depth=3) + "\n", "utf-8")


def json_text(value: Any, *, depth: int, indent: str = "") -> str:
    """JSON with one item a line down to a depth, and everything deeper in that line."""
    if not depth or not isinstance(value, dict) or not value:
        return json.dumps(value, ensure_ascii=False)
    deeper = indent + " "
    lines = [
        f"{deeper}{json.dumps(name)}: {json_text(item, depth=depth - 1, indent=deeper)}"
        for name, item in value.items()
    ]
    return "{\n" + ",\n".join(lines) + f"\n{indent}}}"


if __name__ == "__main__":
    main()

"""Names, commands and entry points of c76c0a6 still work (tools/make_golden_names.py).

Each is taken from where it was: a name that moved may say so with a DeprecationWarning, and gives
what it gave. New parameters may come, by keyword and with a default; none may go or change.
"""

from __future__ import annotations

import importlib
import json
import re
import subprocess
import sys
import tomllib
import warnings
from importlib.resources import files
from typing import Any

import click
import pytest

import lightflight
from lightflight.cli import main
from tools.make_golden_names import FILE, exit_codes, what_a_parameter_is, what_is

GOLDEN = json.loads(FILE.read_text("utf-8"))
PROJECT = tomllib.loads((FILE.parents[3] / "pyproject.toml").read_text("utf-8"))["project"]

OTHER_OPTIONS = {"paper": "the study left the package: its command says where it went"}
"""Commands that may take other options than they did, and why."""

OTHER_DEFAULTS = {
    ("movie", "--slice-codes"): "one code as before, unless the film would be longer than 240"
}
"""Options whose default changed, and why."""

GONE = {
    "lightflight.timing.response Response: .from_counts is gone": (
        "a measured curve is given as it is to calibrate_timing and fit_pulses"
    ),
    "lightflight calibrate_timing: parameter ['flat_arrival_ps', 'KEYWORD_ONLY', '0.0'] became "
    "['flat_arrival_ps', 'KEYWORD_ONLY', 'None']": (
        "0.0 as before for a lab's flat; a simulated one says itself, as on the command line"
    ),
    "lightflight calibrate_timing: parameter ['flat_pulse', 'KEYWORD_ONLY', \"'gaussian'\"] became "
    "['flat_pulse', 'KEYWORD_ONLY', \"'auto'\"]": (
        "a Gaussian as before, unless the flat shows a tail that a Gaussian would misread"
    ),
    "lightflight.view write_recording_movie: parameter ['slice_codes', 'KEYWORD_ONLY', '1'] became "
    "['slice_codes', 'KEYWORD_ONLY', 'None']": (
        "one code as before, unless the film would be longer than 240 slices"
    ),
}
"""Parts that no page listed and that went, or that changed, and what does their work."""

ORDERED = ("POSITIONAL_ONLY", "POSITIONAL_OR_KEYWORD")


def taken_from(module: str, name: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        home = importlib.import_module(module)
        # A module that moved hides a function of its name, in whichever order these tests run.
        if home.__spec__ is None or home.__spec__.origin is None:
            vars(lightflight).pop(module.removeprefix("lightflight."), None)
        if not name:
            return home
        return getattr(home, name, None) or importlib.import_module(f"{module}.{name}")


# --- signatures --------------------------------------------------------------------------------


def changes(old: dict[str, Any], new: dict[str, Any]) -> list[str]:
    """Where a public thing is not what it was."""
    found = []
    if new["kind"] != old["kind"]:
        found.append(f"a {old['kind']} became a {new['kind']}")
    if "value" in old and new.get("value") != old["value"]:
        found.append(f"{old['value']!r} became {new.get('value')!r}")
    if old.get("signature") is not None:
        found += changed_parameters(old["signature"], new.get("signature") or [])
    members = new.get("members", {})
    for name, member in old.get("members", {}).items():
        lines = changes(member, members[name]) if name in members else ["is gone"]
        found += [f".{name} {line}" for line in lines]
    return found


def changed_parameters(old: list[list[str]], new: list[list[str]]) -> list[str]:
    """Old parameters that went, changed or lost their turn; new ones that must be given."""
    by_name = {parameter[0]: parameter for parameter in new}
    found = [
        f"parameter {parameter} became {by_name.get(parameter[0])}"
        for parameter in old
        if by_name.get(parameter[0]) != parameter
    ]
    known = {parameter[0] for parameter in old}
    found += [
        f"new parameter {parameter}"
        for parameter in new
        if parameter[0] not in known and (parameter[1] != "KEYWORD_ONLY" or not parameter[2])
    ]
    turns = [[name for name, kind, _ in one if kind in ORDERED] for one in (old, new)]
    if not found and turns[0] != turns[1]:
        found.append(f"parameters {turns[0]} came in the order {turns[1]}")
    return found


@pytest.mark.parametrize("module", GOLDEN["names"])
def test_public_names_are_where_they_were_and_take_what_they_took(module):
    found = []
    for name, old in GOLDEN["names"][module].items():
        found += [f"{name}: {line}" for line in changes(old, what_is(taken_from(module, name)))]
    assert not [line for line in found if f"{module} {line}" not in GONE]


@pytest.mark.parametrize("order", [1, -1])
def test_old_imports_work_in_a_fresh_interpreter(order):
    """In one order and the other: a submodule must not hide a function of its name."""
    lines = [
        f"from {module} import {name}" if name else f"import {module}"
        for module, names in GOLDEN["names"].items()
        for name in names
    ][::order]
    functions = [k for k, v in GOLDEN["names"]["lightflight"].items() if v["kind"] == "function"]
    lines += ["import lightflight as lf", *(f"assert callable(lf.{name})" for name in functions)]
    words = (sys.executable, "-W", "error", "-W", "ignore::DeprecationWarning")
    done = subprocess.run(
        [*words, "-c", "\n".join(lines)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def test_changes_are_seen():
    """The comparison itself."""
    a, b = ["a", "POSITIONAL_OR_KEYWORD", ""], ["b", "KEYWORD_ONLY", "1"]
    old = {"kind": "function", "signature": [a, b]}
    more = ["c", "KEYWORD_ONLY", "None"]
    assert not changes(old, {"kind": "function", "signature": [a, b, more]})
    for signature in (
        [a],
        [a, ["b", "KEYWORD_ONLY", "2"]],
        [a, ["b", "POSITIONAL_OR_KEYWORD", "1"]],
        [a, b, ["c", "KEYWORD_ONLY", ""]],
        [["c", "POSITIONAL_OR_KEYWORD", "1"], a, b],
    ):
        assert changes(old, {"kind": "function", "signature": signature})
    turned = [["d", "POSITIONAL_OR_KEYWORD", ""], a]
    assert changes({"kind": "function", "signature": turned[::-1]}, old | {"signature": turned})
    values = {"kind": "class", "signature": None, "members": {"x": {"kind": "attribute"}}}
    assert changes(values, {**values, "members": {}}) == [".x is gone"]
    assert changes({"kind": "value", "value": 1}, {"kind": "value", "value": 2})


# --- the command line --------------------------------------------------------------------------


def all_commands(command: dict[str, Any], path: tuple[str, ...] = ()) -> dict[tuple[str, ...], Any]:
    found = {path: command["parameters"]}
    for name, one in command["commands"].items():
        found |= all_commands(one, (*path, name))
    return found


COMMANDS = all_commands(GOLDEN["command_line"])


def command_at(path: tuple[str, ...]) -> click.Command:
    command: click.Command = main
    for name in path:
        assert isinstance(command, click.Group)
        found = command.get_command(click.Context(command), name)
        assert found is not None, f"there is no command {' '.join(path)}"
        command = found
    return command


@pytest.mark.parametrize("path", COMMANDS, ids=" ".join)
def test_a_command_takes_the_options_it_took(path):
    command = command_at(path)
    if path and path[0] in OTHER_OPTIONS:
        return
    parameters = [what_a_parameter_is(one) for one in command.params]
    arguments = [one for one in parameters if one["kind"] == "argument"]
    wanted = [one for one in COMMANDS[path].values() if one["kind"] == "argument"]
    assert [one["nargs"] for one in arguments] == [one["nargs"] for one in wanted]
    for old in COMMANDS[path].values():
        if old["kind"] != "argument":
            fitting = [one for one in parameters if {*old["spellings"]} <= {*one["spellings"]}]
            assert len(fitting) == 1, old["spellings"]
            check_option(old, fitting[0], other_default=is_told(path, old))


def is_told(path: tuple[str, ...], option: dict[str, Any]) -> bool:
    return any((*path, spelling) in OTHER_DEFAULTS for spelling in option["spellings"])


def check_option(old: dict[str, Any], new: dict[str, Any], *, other_default: bool) -> None:
    for key in ("nargs", "multiple", "is_flag", *(() if other_default else ("default",))):
        assert new[key] == old[key], (old["spellings"], key)
    assert not new["required"] or old["required"], old["spellings"]
    # Where anything was taken before, anything must be now.
    assert {*old["choices"]} <= {*new["choices"]}, old["spellings"]
    assert bool(old["choices"]) == bool(new["choices"]), old["spellings"]


def test_exit_codes_mean_what_they_meant():
    assert GOLDEN["exit_codes"].items() <= exit_codes().items()


# --- entry points ------------------------------------------------------------------------------


def test_scripts_and_plug_ins_are_those_of_before():
    assert GOLDEN["scripts"].keys() <= PROJECT["scripts"].keys()
    for target in PROJECT["scripts"].values():
        module, _, name = target.partition(":")
        assert callable(taken_from(module, name))
    for group, points in GOLDEN["entry_points"].items():
        assert points.keys() <= PROJECT["entry-points"][group].keys()
    assert {*GOLDEN["extras"]} <= {*PROJECT["optional-dependencies"]}


def test_the_napari_plug_in_offers_what_it_offered():
    package, _, manifest = PROJECT["entry-points"]["napari.manifest"]["lightflight"].partition(":")
    text = files(package).joinpath(manifest).read_text("utf-8")
    lines = [line.strip() for line in text.splitlines()]
    assert [line for line in GOLDEN["napari"] if line not in lines] == []
    targets = re.findall(r"python_name: (\S+)", text)
    assert targets
    for target in targets:
        module, _, name = target.partition(":")
        assert callable(taken_from(module, name))

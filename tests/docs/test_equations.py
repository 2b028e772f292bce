"""Every function that the page of the method names for an equation is there."""

import importlib
import re
from pathlib import Path

import pytest

METHOD = Path(__file__).parents[2] / "docs" / "explanation" / "method.md"
_TABLE = METHOD.read_text(encoding="utf-8").partition("## Which function holds which equation")[2]
NAMES = re.findall(r"`((?:flight|path|reconstruct)\.[\w.]+)`", _TABLE)


def test_the_table_names_the_three_parts():
    assert {name.partition(".")[0] for name in NAMES} == {"flight", "path", "reconstruct"}


@pytest.mark.parametrize("name", NAMES)
def test_an_equation_has_its_function(name):
    """`path.light_path.LightPath.position_at`: a module, then what it holds."""
    home, _, inner = f"lightflight.{name}".rpartition(".")
    while True:
        try:
            found = importlib.import_module(home)
            break
        except ModuleNotFoundError:
            home, _, outer = home.rpartition(".")
            inner = f"{outer}.{inner}"
    for part in inner.split("."):
        found = getattr(found, part)
    assert found.__doc__


def test_no_equation_of_flight_is_left_out():
    flight = importlib.import_module("lightflight.flight")
    functions = {
        name
        for name, what in vars(flight).items()
        if callable(what) and getattr(what, "__module__", "") == flight.__name__
        and not isinstance(what, type) and not name.startswith("_")
    }  # fmt: skip
    assert functions == {name.split(".")[1] for name in NAMES if name.startswith("flight.")}

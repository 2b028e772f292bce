"""Numbers that decide: how they are counted (`tools/deciding.py`) and moved (`sensitivity.py`)."""

import subprocess
import sys
from pathlib import Path

import pytest

from tools.deciding import ROOMS, numbers_in, numbers_of

ROOT = Path(__file__).parents[2]

ROOM = '''"""A number in a docstring, 7, is none."""
REACH_PX = 3.0
PAIR: tuple[float, float] = (0.5, -4.0)
HALF = lambda x: 0.25 * x
WORD = "8"
SURE = True


class Search:
    """Tolerances."""

    least: int = 4
    none: int = 0

    def wide(self, by=1.5):
        return {"low": 1e-3, "high": [2, 1, 9]}[by]


def tail(x):
    inner = -1 * x ** 3
    return inner + REACH_PX
'''


def test_every_literal_counts_that_does_not_explain_itself():
    found = [(one.value, one.owner, one.named) for one in numbers_in(ROOM, "file.py")]
    assert found == [
        (3.0, "REACH_PX", True), (4.0, "PAIR", True), (0.25, "HALF", True),
        (4, "Search.least", True), (1.5, "Search.wide", False), (1e-3, "Search.wide", False),
        (9, "Search.wide", False), (3, "tail", False),
    ]  # fmt: skip


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_are_there(room):
    assert len(numbers_of(ROOT, room)) > 10


ASK = """\
from benchmarks import sensitivity as s
assert s.moved(3, 1.3) == 4 and s.moved(2, 0.7) == 1 and s.moved(80, 0.7) == 56
assert abs(s.moved(0.9, 1.3) - (1 - 0.1 / 1.3)) < 1e-12 and s.moved(5.0, 0.7) == 3.5
every = {one.name: one for one in s.origins()}
origin = every["outliers"]
sys.meta_path.insert(0, s._Finder(origin, 1.3))
told = {one.owner: one.value for one in origin.numbers}
import importlib, pkgutil, pathlib, lightflight
home = pathlib.Path(lightflight.__file__).parent / "reconstruct"
copies = 0
for found in pkgutil.walk_packages([str(home)], "lightflight.reconstruct."):
    module = importlib.import_module(found.name)
    for name, value in told.items():
        if name in vars(module):
            assert abs(vars(module)[name] - 1.3 * value) < 1e-12, (found.name, name)
            copies += 1
print(copies, len(told))
"""


def test_a_number_is_moved_wherever_it_is_copied():
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{ASK}"],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    copies, numbers = map(int, done.stdout.split())
    assert copies > numbers > 1


REACHED = """\
from benchmarks import reached
from lightflight.reconstruct.model import strength
_, ran = reached.running(lambda: strength.knots_over(0.0, 9.0))
assert reached.may_change({"KNOT_SPACING_PX"}, ran)
assert not reached.may_change({"_KNOWN_LN"}, ran)
_, ran = reached.running(lambda: strength.span_of_knots([0.0] * 8))
assert ran and not reached.may_change({"KNOT_SPACING_PX"}, ran)
# What is worked out from a number where a module is read: `light.N_WIDE` from the halos' reaches.
from lightflight.reconstruct.model import light
_, ran = reached.running(lambda: light.Strengths(None, None).__class__)
assert not reached.may_change({"_NUDGE"}, ran)
readers = {one.file for one in reached._readers_of(frozenset({"WIDE_PX"}))}
assert {"reconstruct/model/spread.py", "reconstruct/model/light.py"} <= readers
"""


def test_scenes_are_run_again_where_what_runs_reads_the_number():
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{REACHED}"],
        capture_output=True, text=True, check=False, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr

"""The counter of the house (`tools/house.py`), on small sources whose counts are plain to see."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tools.house import (
    TOP,
    Source,
    circles_of,
    house_from_tree,
    layer_contracts,
    stops_and_turns,
)

REPOSITORY = Path(__file__).parents[2]

ROOM = '''"""One docstring line.

And another after a blank."""

from typing import Any

# A comment of its own.
LIMIT_PX = 3.0  # no comment line: code stands before it
"""A sentence under a constant."""
_TEXT = """first
second"""


def shortened(a: Any, *, b: list[Any] | None = None) -> Any:
    """Docstring."""
    if b:

        return (
            a * 1.5
        )
    return a + 1


class Box:
    """Docstring."""

    width: Any
    """A sentence under a field."""

    def area(self):
        return 2 * 7
'''


@pytest.fixture
def room():
    return Source("room/file.py", ROOM)


def test_a_code_line_holds_more_than_a_comment_or_a_sentence(room):
    held = [room.lines[number - 1].strip() for number in sorted(room.code_lines)]
    assert held == [
        "from typing import Any",
        "LIMIT_PX = 3.0  # no comment line: code stands before it",
        '_TEXT = """first',
        'second"""',
        "def shortened(a: Any, *, b: list[Any] | None = None) -> Any:",
        "if b:", "return (", "a * 1.5", ")", "return a + 1",
        "class Box:", "width: Any", "def area(self):", "return 2 * 7",
    ]  # fmt: skip


def test_docstrings_fields_and_comments_are_counted_apart(room):
    assert len(room.docstring_lines) == 4  # two of the module's three, one each of two more
    assert len(room.field_lines) == 2
    assert room.n_comments == 1


def test_a_function_is_as_long_as_its_code(room):
    assert room.functions == {"room/file.py:14 shortened": 6, "room/file.py:30 area": 2}


def test_any_is_counted_as_a_name_and_as_a_whole_type(room):
    assert room.n_any == 4
    assert room.n_annotated_any == 3


def test_numbers_that_explain_themselves_are_not_counted(room):
    assert room.constants == ["LIMIT_PX", "_TEXT"]
    assert room.n_inline_numbers == 2  # 1.5 and 7, not 1 and 2; 3.0 has a name


@pytest.fixture
def tree(tmp_path):
    """A checkout of five files: `low` imports up, `pair` goes in a circle, `high` has a door."""
    files = {
        "__init__.py": "",
        "low.py": "def f():\n    from lightflight.high import shown\n    return shown\n",
        "high/__init__.py": "from typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from lightflight.high.a import shown\n",
        "high/a.py": "from lightflight import low\nimport lightflight.high.b\nshown = low\n",
        "high/b.py": "from lightflight.low import f\n",
        "high/page.js": "one\n\nthree\n",
    }
    for name, text in files.items():
        path = tmp_path / "src" / "lightflight" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (tmp_path / "pyproject.toml").write_text(
        '[[tool.importlinter.contracts]]\ntype = "layers"\ncontainers = ["lightflight"]\n'
        'layers = ["(high)", "(low) : (other)"]\n'
    )
    return tmp_path


def test_a_room_is_a_folder(tree):
    house = house_from_tree(tree)
    assert {room: len(sources) for room, sources in house.rooms.items()} == {TOP: 2, "high": 3}
    assert house.web_lines == {"high": 3}


def test_a_name_from_a_door_comes_from_where_the_door_has_it(tree):
    house = house_from_tree(tree)
    assert {(one.module, one.target) for one in house.imports if one.deferred} == {
        ("lightflight.low", "lightflight.high.a")
    }
    assert house.n_deferred == 1


def test_arrows_up_and_circles_are_found(tree):
    house = house_from_tree(tree)
    assert house.arrows() == {("low", "high"), ("high", "low")}
    assert house.arrows_up() == {("lightflight.low", "lightflight.high")}
    assert house.mutual == {("high", "low")}
    # `high` waits for `high.a` in annotations only: its door is in no circle.
    assert house.circles == [["lightflight.high.a", "lightflight.high.b", "lightflight.low"]]


def test_rooms_on_one_level_may_meet_only_where_the_contract_has_a_colon(tree):
    settings = (tree / "pyproject.toml").read_text()
    both = tree / "src" / "lightflight" / "other.py"
    both.write_text("from lightflight import low\n")
    up = ("lightflight.other", "lightflight.low")
    assert up not in house_from_tree(tree).arrows_up()
    (tree / "pyproject.toml").write_text(settings.replace(" : ", " | "))
    assert up in house_from_tree(tree).arrows_up()


def test_contracts_of_other_kinds_are_no_order():
    text = '[[tool.importlinter.contracts]]\ntype = "forbidden"\n'
    assert layer_contracts(text) == ()


def test_circles_that_touch_are_one():
    assert circles_of({"a": "b", "b": "ac", "c": "b", "d": "a", "e": "e"}) == [["a", "b", "c"]]


def test_a_way_back_is_a_turn():
    assert stops_and_turns(["a", "a", "b", "a", "c", "b", "b"]) == (5, 3, 2)
    assert stops_and_turns([]) == (0, 0, 0)


def counted(*arguments):
    tool = [sys.executable, REPOSITORY / "tools" / "count_lines.py", "--no-walks", *arguments]
    return subprocess.run(tool, capture_output=True, text=True, check=True).stdout


def test_two_trees_stand_side_by_side(tree, tmp_path_factory):
    after = tmp_path_factory.mktemp("after")
    shutil.copytree(tree, after, dirs_exist_ok=True)
    (after / "src" / "lightflight" / "high" / "more.py").write_text('"""Why."""\nX = 1\n')
    before, now = json.loads(counted(after, "--against", tree, "--json"))
    assert (before["totals"]["code lines"], now["totals"]["code lines"]) == (10, 11)
    assert (before["rooms"]["high"]["code"], now["rooms"]["high"]["code"]) == (7, 8)
    table = " ".join(counted(after, "--against", tree).split())
    assert "| code lines | 10 | 11 |" in table
    assert "| (top level) | 3 | 0 | 0 | 0 | 0 | 0 | 2 | 0 |" in table
    assert "| high | 7 → 8 | 0 → 1 |" in table


def test_what_is_no_house_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="neither a checkout nor a package"):
        house_from_tree(tmp_path)

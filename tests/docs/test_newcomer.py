"""The newcomer's log: what it types, what it leaves, and that it notices what is not as printed."""

from __future__ import annotations

import io
import re
from pathlib import Path

import pytest

from tests.docs.pages import DOCS
from tools.newcomer import Log, commands_of, follow, missing_file, pages, type_command


@pytest.fixture
def log() -> Log:
    return Log(io.StringIO())


def test_no_command_of_a_page_stands_where_tests_do_not_look() -> None:
    """test_pages runs no indented commands: README alone has some, which the tool types."""
    for folder in ("tutorial", "how-to", "start", "explanation"):
        for page in (DOCS / folder).glob("*.md"):
            assert not re.findall(r"^    lightflight", page.read_text("utf-8"), re.M), page


def test_every_how_to_is_followed() -> None:
    assert {*(DOCS / "how-to").glob("*.md"), *(DOCS / "start").glob("*.md")} < set(pages())


def test_commands_are_told_from_what_they_print() -> None:
    text = "$ lightflight info a.h5 \\\n    --json\n...\npixels 3\n\n$ lightflight versions\n"
    assert list(commands_of(text)) == [
        ("lightflight info a.h5 --json", ["pixels 3"]),
        ("lightflight versions", []),
    ]


def test_a_command_that_prints_something_else_is_noticed(log: Log, tmp_path: Path) -> None:
    type_command("echo 3.02 pixels", ["3 pixels"], tmp_path, log)
    type_command("echo 3 pixels", ["3 codes"], tmp_path, log)
    type_command("echo 3 pixels", ["7 pixels"], tmp_path, log)
    type_command("false", [], tmp_path, log)
    type_command("make everything", [], tmp_path, log)
    assert log.counts == {"as printed": 1, "otherwise": 3, "not typed": 1}
    assert "not printed:\n      3 codes" in log.out.getvalue()  # type: ignore[attr-defined]


def test_files_of_the_readers_own_are_not_asked_for(tmp_path: Path) -> None:
    (tmp_path / "there.h5").touch()
    assert missing_file("lightflight info there.h5 -o new.h5", tmp_path) == ""
    assert missing_file("lightflight batch my.toml  # it's mine", tmp_path) == "my.toml"


def test_a_page_is_followed_in_its_order(log: Log, tmp_path: Path) -> None:
    follow(DOCS / "explanation" / "apparent-speed.md", tmp_path, log)
    assert log.counts == {"as printed": 1, "otherwise": 0, "not typed": 0}

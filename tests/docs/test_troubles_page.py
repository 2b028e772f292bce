"""The page of what can go wrong: every name, its picture, and the cures that the package prints."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import pytest

from lightflight.cli.paths import print_verdict
from lightflight.path.verdict import NOT_EXAMINED, FindingName
from lightflight.reconstruct.verdict.geometry_tests import REMEDIES
from tests.docs.pages import DOCS, ROOT
from tests.view.fakes import fake_path

PAGE = (DOCS / "what-can-go-wrong.md").read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^### `(\w+)`\n(.*?)(?=^##|\Z)", PAGE, re.MULTILINE | re.DOTALL))
NO_PICTURE = {"alternative", "not_examined"}
"""No mistake of a set-up."""
CURES = {
    name: re.findall(r"^- \*(.+)\*$", text.partition("**Cure.**")[2], re.MULTILINE)
    for name, text in SECTIONS.items()
}


def words_of(node: ast.expr) -> str | None:
    """A text in the code; what is filled in when it is printed is "…"."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(words_of(part) or "…" for part in node.values)
    return None


def names_in(node: ast.AST) -> set[str]:
    """Names of findings that a piece of code speaks of."""
    return {
        one.attr
        for one in ast.walk(node)
        if isinstance(one, ast.Attribute)
        and isinstance(one.value, ast.Name)
        and one.value.id == "FindingName"
    }


def printed() -> dict[str, set[str]]:
    """Texts that stand in a call, a function or a module beside the name of a finding."""
    found: dict[str, set[str]] = defaultdict(set)
    for file in (ROOT / "src").rglob("*.py"):
        source = file.read_text(encoding="utf-8")
        if "FindingName." not in source:
            continue
        tree = ast.parse(source)
        constants = [one for one in tree.body if isinstance(one, ast.Assign)]
        for piece in ast.walk(tree):
            if not isinstance(piece, ast.Call | ast.FunctionDef):
                continue
            texts = {words for one in ast.walk(piece) if (words := words_of(one))}  # type: ignore[arg-type]
            used = {one.id for one in ast.walk(piece) if isinstance(one, ast.Name)}
            for constant in constants:
                if {t.id for t in constant.targets if isinstance(t, ast.Name)} & used:
                    texts |= {words for words in [words_of(constant.value)] if words}
            for name in names_in(piece):
                found[str(FindingName[name])] |= texts
    return found


def test_every_name_has_its_section_and_every_section_a_name() -> None:
    assert set(SECTIONS) == set(map(str, FindingName))
    assert len(re.findall(r"^### ", PAGE, re.MULTILINE)) == len(SECTIONS)


def test_commands_point_at_the_page(capsys: pytest.CaptureFixture[str]) -> None:
    print_verdict(replace(fake_path(), verdict=NOT_EXAMINED))
    assert "what-can-go-wrong#not_examined, in the documentation" in capsys.readouterr().out


def test_every_section_tells_cause_look_and_cure() -> None:
    for name, text in SECTIONS.items():
        for word in ("Cause", "Looks like", "Cure"):
            assert f"**{word}.**" in text, (name, word)


def test_every_name_that_is_found_has_a_picture_and_what_was_said() -> None:
    for name, text in SECTIONS.items():
        if name in NO_PICTURE:
            continue
        assert f"(images/wrong-{name}.png)" in text, name
        said = re.search(f"<!-- {name}:begin -->\n(.+)<!-- {name}:end -->", text, re.DOTALL)
        assert said, f"{name}: run tools/update_troubles.py {name}"
        assert re.search(r"^(check|contradicted|trust)$", said[1], re.MULTILINE), name


def test_cures_are_the_sentences_that_the_package_prints() -> None:
    said = printed()
    for name, cures in CURES.items():
        assert cures, name
        for cure in cures:
            assert cure in said[name] | {REMEDIES.get(FindingName(name), "")}, (name, cure)


def test_no_cure_of_the_table_is_left_out() -> None:
    for name, remedy in REMEDIES.items():
        assert remedy in CURES[str(name)], name


def test_the_tool_draws_every_name_that_has_a_picture() -> None:
    tool = Path(ROOT / "tools" / "update_troubles.py").read_text(encoding="utf-8")
    drawn = set(re.findall(r'^    "(\w+)": Trouble\(', tool, re.MULTILINE))
    assert drawn == set(SECTIONS) - NO_PICTURE

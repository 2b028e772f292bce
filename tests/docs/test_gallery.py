"""The gallery: one question and one picture each, short, of public names; its notebook runs."""

from __future__ import annotations

import ast
import importlib
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.docs.pages import DOCS, ROOT

EXAMPLES = sorted((ROOT / "examples" / "gallery").glob("*.py"))
MOST_LINES = 40


def test_there_are_enough_and_each_has_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("sphinx_gallery", reason="the order of the gallery needs the docs extra")
    monkeypatch.syspath_prepend(str(DOCS / "_ext"))
    order = importlib.import_module("gallery").ORDER
    monkeypatch.delitem(sys.modules, "gallery")
    assert len(EXAMPLES) >= 10
    assert sorted(order) == [file.stem for file in EXAMPLES]


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_asks_one_question_and_answers_it_shortly(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    tree = ast.parse(text)
    doc = ast.get_docstring(tree) or ""
    title, rule, *_ = doc.splitlines()
    assert title.endswith("?")
    assert rule == "=" * len(title)
    assert "\n# **Answer:** " in text
    code = text.splitlines()[tree.body[0].end_lineno or 0 :]
    assert sum(bool(line.strip() and not line.startswith("#")) for line in code) <= MOST_LINES


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_an_example_uses_public_names_alone(file: Path) -> None:
    """Those of `lightflight`, of a room's `__all__`, and of modules on the page of the API."""
    listed = (DOCS / "reference" / "api.md").read_text(encoding="utf-8").split()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.ImportFrom) or not str(node.module).startswith("lightflight"):
            continue
        module, names = str(node.module), {alias.name for alias in node.names}
        if module.removeprefix("lightflight.") in listed:
            continue
        assert names <= {*importlib.import_module(module).__all__, "view"}, module


def test_the_notebook_of_the_first_path_runs(tmp_path: Path) -> None:
    notebook = pytest.importorskip(
        "sphinx_gallery.notebook", reason="the notebook is made by the docs extra"
    )
    shutil.copy(ROOT / "examples" / "gallery" / "first_path.py", tmp_path)
    notebook.python_to_jupyter_cli([str(tmp_path / "first_path.py")])
    cells = json.loads((tmp_path / "first_path.ipynb").read_text(encoding="utf-8"))["cells"]
    kinds = [cell["cell_type"] for cell in cells]
    assert kinds[0] == "markdown"
    assert kinds.count("code") >= 3
    names: dict[str, Any] = {"__name__": "__main__"}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    path = names["path"]
    assert str(path.verdict.level) == "trust"
    assert names["error"].position_rms_mm < 0.2

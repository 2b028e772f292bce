"""The scripts in examples/ run, at small size, and write what they say."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path

import pytest

from tests.docs.pages import DOCS, ROOT

EXAMPLES = {
    "first_path": (("-o", "."), "path.png", r"off the truth by 0\.\d+ mm"),
    "light_against_error": (
        ("--repeats", "1", "--levels", "2", "-o", "light.png"),
        "light.png",
        r"100000 photons: limit 0\.0\d+ mm, joint 0\.\d+ mm",
    ),
    "three_cameras": (("--pixels", "24", "-o", "cameras.png"), "cameras.png", "seems to last"),
    "own_format": (("-o", "own.h5"), "own.h5", "3 x 4 pixels"),
}
ELSEWHERE = {"fibre_recordings"}
"""Needs recordings that are not here: see test_pages and tests/real."""


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words, made, said = EXAMPLES[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"), run_name="__main__")
    assert re.search(said, capsys.readouterr().out)
    assert (tmp_path / made).stat().st_size > 500


def test_every_example_is_run_and_shown() -> None:
    there = {file.stem for file in (ROOT / "examples").glob("*.py")}
    assert there == set(EXAMPLES) | ELSEWHERE
    page = (DOCS / "reference" / "examples.md").read_text(encoding="utf-8")
    for name in there:
        assert f"examples/{name}.py" in page

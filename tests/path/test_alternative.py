"""Other answers that a path holds: their order, their words, and altered files."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import lightflight as lf
from lightflight.errors import FileFormatError, LimitError
from lightflight.files.store import load_record, save_record
from lightflight.path import Alternative
from tools.make_schema_files import known_path, known_path_with_an_alternative


def test_the_likeliest_comes_first():
    path = known_path()
    listed = [Alternative(path, log, str(log)) for log in (-3.0, 0.5, -0.25)]
    held = replace(path, alternatives=listed).alternatives
    assert [one.log_evidence for one in held] == [0.5, -0.25, -3.0]


@pytest.mark.parametrize(
    ("log_evidence", "words"),
    [
        (0.0, "as likely"), (-0.693, "2 times less likely"), (3.0, "20 times more likely"),
        (-4.6, "99 times less likely"), (900.0, "1e+304 times more likely"),
    ],
)  # fmt: skip
def test_odds_are_told_in_words(log_evidence, words):
    one = Alternative(known_path(), log_evidence, "one bent leg instead of two straight ones")
    assert str(one) == f"one bent leg instead of two straight ones ({words})"


def test_what_makes_no_sense_is_refused():
    path = known_path_with_an_alternative()
    with pytest.raises(ValueError, match="no alternatives of its own"):
        Alternative(path, 0.0, "itself")
    with pytest.raises(ValueError, match="must be finite"):
        Alternative(known_path(), float("nan"), "unknown")
    with pytest.raises(ValueError, match="must be Alternative records"):
        replace(path, alternatives=(known_path(),))
    with pytest.raises(LimitError, match="at most 20 alternatives, got 21"):
        replace(path, alternatives=path.alternatives * 21)


def altered(file: Any, change: Any) -> None:
    """Write the file anew with other attributes."""
    arrays, attributes = load_record(file, kind="path")
    change(attributes["alternatives"])
    save_record(file, kind="path", arrays=arrays, attributes=attributes, schema=4)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda told: told[0].update(says=7), "cannot say"),
        (lambda told: told[0].update(log_evidence=[]), "cannot say"),
        (lambda told: told[0].pop("path"), "lacks 'path'"),
        (lambda told: told.append(told[0]), "lacks"),
        (lambda told: told.extend([told[0]] * 40), "more than 20"),
        (lambda told: told.insert(0, "one"), "alternatives cannot be"),
    ],
)
def test_altered_files_are_refused_in_a_sentence(tmp_path, change, text):
    file = tmp_path / "path.h5"
    known_path_with_an_alternative().save(file)
    altered(file, change)
    with pytest.raises(FileFormatError, match=text):
        lf.LightPath.load(file)

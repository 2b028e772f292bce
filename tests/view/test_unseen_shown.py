"""A stretch that nobody saw is told as open wherever a path is shown."""

from __future__ import annotations

import json
import re
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli.paths import json_from_path, print_path
from lightflight.path.trace import trace_from_path
from lightflight.view.figures.demo import demo_figure
from lightflight.view.page.build import page_html
from lightflight.view.page.tables import heading
from tests.path.test_gaps import ROOF_MM, roof
from tests.path_fakes import make_path


@pytest.fixture(scope="module")
def path() -> Any:
    return roof(covariance=np.eye(16))


def words_on(figure: Any) -> set[str]:
    return {text.get_text() for ax in figure.axes for text in ax.texts}


def test_the_heading_counts_what_was_seen(path) -> None:
    assert heading(path) == "Two legs of light and one way that nobody saw"
    assert heading(make_path()).endswith("of light in space and time")


def test_the_page_calls_leg_and_mirrors_open(path) -> None:
    text = page_html(path)
    payload = json.loads(re.search(r'application/json">(.*?)</script>', text, re.S)[1])  # type: ignore[index]
    assert [leg["seen"] for leg in payload["path"]["legs"]] == [True, False, True]
    assert payload["path"]["legs"][1]["angle_deg"] is None
    cells = re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", text)
    assert "unseen" in cells
    assert [cell for cell in cells if "mirror 1, open" in cell or "mirror 2, open" in cell]


def test_the_figure_marks_mirrors_that_may_stand_elsewhere(path) -> None:
    figure = demo_figure(path)
    assert {"M1?", "M2?"} <= words_on(figure)
    dotted = [
        line
        for ax in figure.axes
        for line in ax.get_lines()
        if str(line.get_label()).startswith("one way of many")
    ]
    assert len(dotted) == 1
    assert not any("M1?" in words for words in words_on(demo_figure(make_path())))


def test_nothing_of_it_is_in_view(path) -> None:
    trace = trace_from_path(path)
    assert not trace.in_view[trace.leg == 1].any()
    assert trace.in_view[trace.leg == 0].any()


def test_tables_on_a_terminal_say_unseen_and_open(path, capsys) -> None:
    print_path(path)
    said = capsys.readouterr().out
    assert "unseen" in said
    assert "1  mirror, open" in said
    assert "After leg 1 the light was out of the picture" in said


def test_json_has_the_gap_and_no_angle(path) -> None:
    plain = json_from_path(path)
    assert [leg["seen"] for leg in plain["legs"]] == [True, False, True]
    (gap,) = plain["gaps"]
    assert gap["delay_ps"] == pytest.approx(path.gaps[0].delay_ps)
    assert gap["farthest_mm"] == pytest.approx(path.gaps[0].farthest_mm)
    assert json_from_path(make_path())["gaps"] == []


def test_cards_and_prints_say_it(path) -> None:
    assert "3 legs, 1 of them unseen" in str(path) or "three legs, 1 of them unseen" in str(path)
    card = path._repr_html_()
    assert "not seen: at least one leg" in card
    assert "out of view after leg 1" in card


def test_csv_has_no_place_for_it(path, tmp_path) -> None:
    from lightflight.view.export.tables import write_csv

    write_csv(path, tmp_path / "path.csv", samples=200)
    table = np.genfromtxt(tmp_path / "path.csv", delimiter=",", names=True)
    unseen = table["leg"] == 1
    assert np.isnan(table["x_mm"][unseen]).all()
    assert np.isfinite(table["x_mm"][~unseen]).all()


def test_a_command_tells_of_it(path, tmp_path) -> None:
    from lightflight.cli import main

    path.save(tmp_path / "path.h5")
    done = CliRunner().invoke(
        main, ["plot", str(tmp_path / "path.h5"), "-o", str(tmp_path / "p.png")]
    )
    assert done.exit_code == 0, done.output
    assert lf.LightPath.load(tmp_path / "path.h5").n_legs == len(ROOF_MM) - 1

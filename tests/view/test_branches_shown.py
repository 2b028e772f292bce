"""Both branches of a path that forks are shown, and no arm from the wrong vertex."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lightflight.cli.paths import json_from_path, print_path
from lightflight.path.error import path_error
from lightflight.path.tables import RESIDUAL_DTYPE
from lightflight.view.export.files import export_path
from lightflight.view.export.gltf import glb_bytes
from lightflight.view.export.vtk import _grid
from lightflight.view.figures.demo import demo_figure
from lightflight.view.figures.path import draw_path_3d
from lightflight.view.figures.timing import draw_residuals_along, draw_times
from lightflight.view.film.flight import MovieSettings, movie_frames
from lightflight.view.napari_layers import layers_from_path
from lightflight.view.page.build import page_html
from lightflight.view.page.tables import heading
from lightflight.view.viewpoint import Viewpoint
from tests.path.test_tree import FORKS, VERTICES, forked
from tests.path_fakes import make_path
from tests.view import browser as br


def own_residuals() -> np.ndarray:
    """A pulse on each leg, right to the picosecond."""
    table = np.zeros(5, RESIDUAL_DTYPE)
    table["leg"], table["used"], table["std_ps"] = np.arange(5), True, 1.0
    table["row"], table["col"] = 16, np.arange(5) + 10
    table["residual_ps"] = (0.5, -0.5, 0.25, -0.25, 0.5)
    return table


@pytest.fixture(scope="module")
def path() -> Any:
    truth = SimpleNamespace(
        vertices_mm=VERTICES + 0.1, vertex_times_ps=forked().vertex_times_ps, forks=FORKS
    )
    return forked(truth=truth, residuals=own_residuals())


def words_on(figure: Any) -> set[str]:
    return {text.get_text() for ax in figure.axes for text in ax.texts}


def jumps(line: Any, legs: np.ndarray) -> list[float]:
    """Lengths, on the page, of strokes of a line that lie on no leg; `legs` (k, 2, 2)."""
    points = np.column_stack(line.get_data()).astype(float)
    found = []
    for a, b in pairwise(points):
        if np.isfinite([a, b]).all() and not any(
            on_segment(a, *leg) and on_segment(b, *leg) for leg in legs
        ):
            found.append(float(np.linalg.norm(b - a)))
    return found


def on_segment(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> bool:
    step = end - start
    f = np.clip((point - start) @ step / (step @ step), 0.0, 1.0)
    return bool(np.linalg.norm(start + f * step - point) < 1.0)


def test_no_stroke_in_space_lies_off_the_legs(path: Any) -> None:
    view = Viewpoint()
    ax = draw_path_3d(path, view=view)
    legs = np.array([view.project(np.array([leg.start_mm, leg.end_mm])) for leg in path.legs])
    drawn = [line for line in ax.get_lines() if str(line.get_label()).startswith(("path", "truth"))]
    assert len(drawn) == 2
    for line in drawn:
        assert max(jumps(line, legs), default=0.0) < 2.0
    # The same test sees a line that joins the end of one arm to the start of the other.
    wrong = SimpleNamespace(get_data=lambda: view.project(VERTICES).T)
    assert max(jumps(wrong, legs)) > 20.0


def test_figures_name_splitter_and_both_exits(path: Any) -> None:
    figure = demo_figure(path)
    assert {"S2", "M1", "M4"} <= words_on(figure)
    texts = [text.get_text() for ax in figure.axes for text in ax.texts]
    assert texts.count("exit") == 2
    assert heading(path) == "Five legs of light on 2 branches in space and time"


def test_times_go_forward_on_every_stroke(path: Any) -> None:
    ax = draw_times(path)
    for line in ax.get_lines():
        if line.get_label() in ("event time $t$", "arrival time $t_a$", "truth"):
            x = np.asarray(line.get_xdata(), dtype=float)
            steps = np.diff(x)
            assert (steps[np.isfinite(steps)] >= -1e-6).all(), line.get_label()
            assert np.isnan(x).sum() == 1
    long = max(sum(leg.length_mm for leg in one.legs) for one in path.branches)
    assert draw_residuals_along(path).get_xlim()[1] == pytest.approx(long)


def test_a_film_flies_a_pulse_on_every_branch(path: Any) -> None:
    """At the same reading a pulse is on both arms: what either branch alone shows is there."""
    settings = MovieSettings(size_px=(640, 360), pace_ps_per_s=4000.0)
    both = list(movie_frames(path, settings=settings))
    assert len(both) > 3
    alone = list(movie_frames(path.branches[0], settings=settings))
    assert any((a != b).any() for a, b in zip(both, alone, strict=False))


def test_tables_say_where_each_leg_runs(path: Any, capsys: Any) -> None:
    print_path(path)
    said = capsys.readouterr().out
    assert "2  splitter" in said
    assert said.count("exit from view") == 2
    assert "4  2 to 4" in said
    assert "leg 4 begins at vertex 2" in said
    plain = json_from_path(path)
    assert plain["forks"] == FORKS
    assert [leg["parent"] for leg in plain["legs"]] == [None, 0, 1, 1, 3]
    assert plain["n_branches"] == 2
    assert "n_branches" not in json_from_path(make_path())


def test_print_and_card_say_it(path: Any) -> None:
    assert "on 2 branches" in str(path)
    assert "ps, from 2" in str(path)
    card = path._repr_html_()
    assert "leg 3 begins at vertex 2" in card or "leg 4 begins at vertex 2" in card


def test_tables_in_files(path: Any, tmp_path: Path) -> None:
    export_path(path, tmp_path / "v.csv", what="vertices")
    table = np.genfromtxt(tmp_path / "v.csv", delimiter=",", names=True)
    assert table["from_vertex"].tolist() == [-1, 0, 1, 2, 2, 4]
    export_path(make_path(), tmp_path / "c.csv", what="vertices")
    assert "from_vertex" not in (tmp_path / "c.csv").read_text()
    from scipy.io import loadmat

    export_path(path, tmp_path / "p.mat")
    assert loadmat(tmp_path / "p.mat")["lightflight"]["forks"][0, 0].tolist() == [[3, 2]]


def test_no_cell_for_paraview_joins_two_legs(path: Any) -> None:
    points, _, cells, data = _grid(path, 9)
    for (a, b), leg in zip(cells, data["leg"], strict=True):
        own = path.legs[leg]
        assert np.linalg.norm(points[b] - points[a]) < own.length_mm / 0.9


def test_gltf_flies_two_pulses(path: Any) -> None:
    blob = glb_bytes(path)
    size = struct.unpack("<I", blob[12:16])[0]
    document = json.loads(blob[20 : 20 + size])
    names = [node["name"] for node in document["nodes"]]
    assert [name for name in names if name.startswith("pulse")] == [
        "pulse of branch 1",
        "pulse of branch 2",
    ]
    assert len(document["animations"]) == 2


def test_napari_has_a_track_for_each_branch(path: Any) -> None:
    rows, _, _ = layers_from_path(path)[0]
    assert set(rows[:, 0]) == {0.0, 1.0}
    for number, branch in enumerate(path.branches):
        track = rows[rows[:, 0] == number]
        steps = np.linalg.norm(np.diff(track[:, 2:], axis=0), axis=1)
        assert steps.max() < 1.01 * max(steps[0], steps[1])
        assert len(track) > 3
        assert np.linalg.norm(track[-1, :1:-1] - branch.vertices_mm[-1]) < 2.0 * steps.max()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with br.started_browser() as browser:
        yield browser


def test_the_page_reads_one_branch_and_shows_both(chromium: Any, path: Any, tmp_path: Path) -> None:
    file = tmp_path / "page.html"
    text = page_html(path)
    file.write_text(text, encoding="utf-8")
    payload = json.loads(re.search(r'application/json">(.*?)</script>', text, re.S)[1])  # type: ignore[index]
    assert payload["path"]["ways"] == [[0, 1, 2], [0, 1, 3, 4]]
    assert "splitter 2" in text
    page = br.OpenPage(chromium, file)
    start = path.vertex_times_ps[0]
    when = float(path.vertex_times_ps[4] - start) + 50.0
    for number, other in ((0, 1), (1, 0)):
        page.run(f"lightflight.setWay({number}); lightflight.setTime({when})")
        now = page.run("lightflight.current()")
        # Single precision is the page's, a micrometre ours.
        expected = path.position_at([start + when], branch=number)[0]
        np.testing.assert_allclose(now["place"], expected, atol=1e-3)
        (another,) = now["others"]
        expected = path.position_at([start + when], branch=other)[0]
        np.testing.assert_allclose(another["place"], expected, atol=1e-3)
        assert now["leg"] == path.leg_at([start + when], branch=number)[0]
        ends = page.run("document.getElementById('time').max")
        last = path.vertex_times_ps[path.ends[1 + number]] - start
        assert float(ends) == pytest.approx(last, abs=0.01)
    assert not page.errors


def test_errors_on_the_page_are_those_of_the_tree(path: Any) -> None:
    text = page_html(path)
    payload = json.loads(re.search(r'application/json">(.*?)</script>', text, re.S)[1])  # type: ignore[index]
    error = path_error(path, path.truth, path.camera)
    assert payload["truth"]["position_rms_mm"] == pytest.approx(error.position_rms_mm)

"""The page in a real browser: it draws, moves the pulse where the file says, and stays silent."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lightflight import Histograms
from lightflight.camera.model import Camera
from lightflight.camera.refraction import window
from lightflight.flight import Source, arrival_time_from_event, event_times_from_vertices
from lightflight.materials import Material
from lightflight.path.light_path import LightPath
from lightflight.path.second_view import camera_towards, observe
from lightflight.path.tables import RESIDUAL_DTYPE
from lightflight.view.page import write_page
from lightflight.view.page.campaign import write_campaign
from lightflight.view.page.parts import whole_html
from tests.view import browser as br, fakes
from tests.view.axe import barriers
from tests.view.test_page import HOSTILE, hostile_path

C = 0.299792458


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with br.started_browser() as browser:
        yield browser


@pytest.fixture(scope="module")
def paper_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's scene with a recording of a few pixels and a flagged one."""
    path = fakes.fake_path()
    file = tmp_path_factory.mktemp("page") / "page.html"
    table = path.residuals
    pulses = fakes.fake_pulses(
        table["row"], table["col"], table["arrival_ps"], std_ps=75.0, photons=3000.0
    )
    arrivals = fakes.fake_arrivals(path)
    write_page(path, file, recording=recording_of(path), pulses=pulses, arrivals=arrivals)
    return file


def recording_of(path: LightPath) -> Histograms:
    """Histograms with a pulse of 3,000 photons for every row of the path's residuals."""
    rng = np.random.default_rng(9)
    counts = rng.poisson(0.2, size=(*path.camera.shape, 512)).astype(np.uint32)
    for row, col, when in zip(
        *(path.residuals[k] for k in ("row", "col", "arrival_ps")), strict=True
    ):
        codes = np.floor((when + rng.normal(0, 75.0, 3000)) / 50.0).astype(int) % 512
        np.add.at(counts, (row, col, codes), 1)
    return Histograms(counts, bin_width_ps=50.0, laser_period_ps=25_600.0)


@pytest.fixture(scope="module")
def opened(chromium: Any, paper_file: Path) -> Iterator[br.OpenPage]:
    """The paper's page, opened once: it takes seconds without a graphics card."""
    page = br.OpenPage(chromium, paper_file)
    yield page
    page.close()


@pytest.fixture
def page(opened: br.OpenPage) -> br.OpenPage:
    """The open page at event time 0, quiet so far."""
    opened.run("lightflight.setPlaying(false), lightflight.setClock('event')")
    opened.run("document.activeElement.blur()")
    opened.slide(0.0)
    assert opened.errors == []
    return opened


def arrival_since_vertex_0(path: LightPath, event_since: float) -> float:
    when = path.vertex_times_ps[0] + np.array([0.0, event_since])
    arrival = arrival_time_from_event(
        path.position_at(when), when, camera_center_mm=path.camera.center_mm
    )
    return float(arrival[1] - arrival[0])


def test_clocks_behind_a_window_are_those_of_the_bent_light(chromium: Any, tmp_path: Path) -> None:
    """The page reads the way back off the path's trace: to 0.05 ps of the package's own."""
    plain = fakes.fake_path(residuals=False)
    glass = Material(1.5195, 1.5489)
    pane = window((0.0, 0.0, 310.0), (0.2, 0.0, 1.0), thickness_mm=40.0, glass=glass)
    path = replace(plain, camera=replace(plain.camera, interfaces=pane))
    file = tmp_path / "page.html"
    write_page(path, file)
    page = br.OpenPage(chromium, file)
    try:
        for since in (0.0, 700.0, 1900.0, 3333.0):
            page.run("lightflight.setPlaying(false), lightflight.setClock('event')")
            page.slide(since)
            page.page.click("#clock-arrival")
            page.settle()
            when = path.vertex_times_ps[0] + np.array([0.0, since])
            arrival = when + path.camera.return_times_ps(
                path.position_at(when), return_group_index=path.medium.return_group_index
            )
            reading = page.run("lightflight.state.elapsed")
            assert reading == pytest.approx(arrival[1] - arrival[0], abs=0.05)
        assert page.errors == []
    finally:
        page.close()


def length_of(points: Any) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def test_the_slider_moves_the_pulse_to_where_position_at_says(page: br.OpenPage) -> None:
    path = fakes.fake_path()
    for since in (0.0, 333.3, 1500.0, 2600.5, float(np.ptp(path.vertex_times_ps))):
        page.slide(since)
        expected = path.position_at(path.vertex_times_ps[0] + since)[0]
        np.testing.assert_allclose(page.marks("pulse centre")[0], expected, atol=1e-9)
    page.shot("page_1280_light_event")


def test_both_clocks_agree_with_the_file(page: br.OpenPage) -> None:
    path = fakes.fake_path()
    for since in (150.0, 700.0, 1900.0, 3333.0):
        page.run("lightflight.setClock('event')")
        page.slide(since)
        page.page.click("#clock-arrival")
        page.settle()
        reading = page.run("lightflight.state.elapsed")
        assert reading == pytest.approx(arrival_since_vertex_0(path, since), abs=1e-6)
        # The pulse stays where it was: only the reading has changed.
        expected = path.position_at(path.vertex_times_ps[0] + since)[0]
        np.testing.assert_allclose(page.marks("pulse centre")[0], expected, atol=1e-6)
        assert "What the camera saw" in page.page.inner_text("#story")
    page.shot("page_1280_light_arrival")
    page.slide(1234.5)  # and back, from a reading of the arrival clock
    t = page.run("lightflight.current().t")
    assert arrival_since_vertex_0(path, t) == pytest.approx(1234.5, abs=1e-6)


def test_the_pulse_has_its_true_length_in_flight_and_its_apparent_one_for_the_camera(
    page: br.OpenPage,
) -> None:
    path = fakes.fake_path()
    page.slide(600.0)
    assert length_of(page.marks("pulse")) == pytest.approx(68.0 * C / 1.00027, rel=1e-3)
    page.page.click("#clock-arrival")
    page.settle()
    page.slide(1500.0)  # at once from a reading, so the body is that of this reading
    reading = page.run("lightflight.current().ta")
    ends = [page.run(f"lightflight.current().t + 0 * {reading}")]
    body = page.marks("pulse")
    tail, head = body[0], body[-1]
    times = path.vertex_times_ps[0] + np.linspace(0, np.ptp(path.vertex_times_ps), 20001)
    points = path.position_at(times)
    seen = arrival_time_from_event(points, times, camera_center_mm=path.camera.center_mm)
    seen = seen - seen[0]
    for end, when in ((tail, reading - 34.0), (head, reading + 34.0)):
        expected = [np.interp(when, seen, points[:, k]) for k in range(3)]
        np.testing.assert_allclose(end, expected, atol=0.01)
    assert np.isfinite(ends).all()


def test_the_readouts_are_the_pulses(page: br.OpenPage) -> None:
    path = fakes.fake_path()
    page.slide(1500.0)
    place = path.position_at(path.vertex_times_ps[0] + 1500.0)[0]
    shown = page.page.inner_text("#place").replace("\u2212", "-").split()
    assert shown[::4] == ["x", "y", "z"]
    std = path.vertex_std[:, :3]
    for k in range(3):
        value, said = float(shown[4 * k + 1]), float(shown[4 * k + 3])
        assert shown[4 * k + 2] == "±"
        assert value == pytest.approx(place[k], abs=0.01)
        # Between two corners the error is of their size.
        assert 0.2 * std[:, k].min() < said < 2.0 * std[:, k].max()
    assert page.page.inner_text("#elapsed-error").startswith("±")
    assert page.page.inner_text("#leg") == "2"
    assert page.page.inner_text("#speed").startswith("0.9997")


def test_the_cameras_picture_shows_the_light_of_the_moment(page: br.OpenPage) -> None:
    path = fakes.fake_path()
    page.page.click("#clock-arrival")
    page.slide(1000.0)
    light = np.array(page.run("Array.from(lightflight.lightAt('arrival', 1000.0))")).reshape(32, 32)
    table = path.residuals
    start = arrival_time_from_event(
        path.vertices_mm[0], path.vertex_times_ps[0], camera_center_mm=path.camera.center_mm
    )
    nearest = np.argmin(np.abs(table["arrival_ps"] - start - 1000.0))
    peak = np.unravel_index(np.argmax(light), light.shape)
    assert abs(peak[1] - table["col"][nearest]) <= 1
    dark = np.abs(table["arrival_ps"] - start - 1000.0) > 600
    assert light[table["row"][dark], table["col"][dark]].max() == 0
    # What is on the screen is that light: the brightest pixel is the most orange or blue one.
    data = np.array(
        page.run(
            "Array.from(document.getElementById('picture-light').getContext('2d')"
            ".getImageData(0, 0, 32, 32).data)"
        )
    ).reshape(32, 32, 4)
    darkest = np.unravel_index(np.argmin(data[..., 0]), (32, 32))
    assert light[darkest] == pytest.approx(light.max(), rel=0.05)


def test_pointing_at_a_pixel_shows_its_histogram_fit_and_flags(page: br.OpenPage) -> None:
    path = fakes.fake_path()
    hist = recording_of(path)
    row, col = int(path.residuals["row"][20]), int(path.residuals["col"][20])
    box = page.page.locator("#picture").bounding_box()
    page.page.mouse.move(
        box["x"] + (col + 0.5) * box["width"] / 32, box["y"] + (row + 0.5) * box["height"] / 32
    )
    page.until(
        f"document.getElementById('pixel-title').textContent === 'Pixel: row {row}, column {col}'"
    )
    page.until("(lightflight.plots['pixel-plot'] || { data: [] }).data.length === 3")
    bars, fit, _ = page.plot("pixel-plot")
    middles = (np.array(bars["x"]) + np.array(bars["right"])) / 2
    codes = np.floor(middles / 50.0).astype(int) % 512
    np.testing.assert_array_equal(bars["y"], hist.counts[row, col, codes])
    # The fit expects what was drawn: 3,000 photons, within Poisson noise (5 sigma).
    assert abs(sum(fit["y"][::2]) - sum(bars["y"])) < 5 * np.sqrt(sum(bars["y"]))
    facts = page.page.inner_text("#pixel-facts")
    assert "residual" in facts
    page.run("lightflight.state")
    screaming = np.argwhere(fakes.fake_arrivals(path).flags == 64)[0, 0]
    arrivals = fakes.fake_arrivals(path)
    page.page.focus("#picture")
    target = int(arrivals.row[screaming]), int(arrivals.col[screaming])
    for key, steps in (("Down", target[0] - row), ("Right", target[1] - col)):
        key = key if steps > 0 else {"Down": "Up", "Right": "Left"}[key]
        for _ in range(abs(steps)):
            page.page.keyboard.press(f"Arrow{key}")
    page.until(
        f"document.getElementById('pixel-title').textContent === "
        f"'Pixel: row {target[0]}, column {target[1]}'"
    )
    assert "screaming" in page.page.inner_text("#pixel-facts")


def test_the_keyboard_is_enough(page: br.OpenPage) -> None:
    page.slide(500.0)
    page.page.evaluate("document.activeElement.blur()")
    page.page.keyboard.press("c")
    assert page.run("lightflight.state.clock") == "arrival"
    assert page.page.get_attribute("#clock-arrival", "aria-checked") == "true"
    page.page.keyboard.press("c")
    page.page.keyboard.press("ArrowRight")
    assert page.run("lightflight.state.elapsed") == pytest.approx(510.0, abs=1e-6)
    page.page.keyboard.press("Shift+ArrowLeft")
    assert page.run("lightflight.state.elapsed") == pytest.approx(410.0, abs=1e-6)
    page.page.keyboard.press("2")
    start = fakes.fake_path().vertex_times_ps
    assert page.run("lightflight.state.elapsed") == pytest.approx(start[1] - start[0], abs=1e-6)
    page.page.keyboard.press("End")
    assert page.run("lightflight.state.elapsed") == pytest.approx(np.ptp(start), abs=1e-6)
    page.page.keyboard.press("Space")  # from the end it starts again
    page.until("lightflight.state.playing && lightflight.state.elapsed > 5")
    page.page.keyboard.press("Space")
    assert not page.run("lightflight.state.playing")
    page.page.keyboard.press("?")
    assert page.page.is_visible("#keys")
    page.page.keyboard.press("Escape")
    assert not page.page.is_visible("#keys")


def test_arrows_on_the_slider_move_it_once(page: br.OpenPage) -> None:
    page.slide(500.0)
    page.page.focus("#time")
    page.page.keyboard.press("ArrowRight")
    assert page.run("lightflight.state.elapsed") == pytest.approx(510.0, abs=1e-6)


def is_dark(page: br.OpenPage) -> bool:
    backdrop = page.run("getComputedStyle(document.body).backgroundColor")
    return sum(int(c) for c in backdrop[4:-1].split(",")) < 200


def test_it_follows_the_systems_theme_and_its_own_button(page: br.OpenPage) -> None:
    page.page.emulate_media(color_scheme="dark")
    page.slide(700.0)
    assert is_dark(page)
    page.shot("page_1280_dark")
    page.page.emulate_media(color_scheme="light")
    assert not is_dark(page)
    page.page.click("#theme-button")
    page.page.click("#theme-button")
    assert page.run("document.documentElement.dataset.theme") == "dark"
    assert is_dark(page)
    page.page.click("#theme-button")
    assert not is_dark(page)
    page.settle()


@pytest.fixture(scope="module")
def two_eyes(chromium: Any, tmp_path_factory: pytest.TempPathFactory) -> Iterator[br.OpenPage]:
    """The paper's page with a second camera beyond the first mirror."""
    file = tmp_path_factory.mktemp("eyes") / "page.html"
    path = fakes.fake_path()
    write_page(path, file, recording=recording_of(path), second_camera=second_camera(path))
    page = br.OpenPage(chromium, file)
    yield page
    page.close()


def second_camera(path: LightPath) -> Camera:
    return camera_towards(path, (900.0, 40.0, 30.0), shape=(24, 40))


def test_the_second_camera_sees_the_same_pulse_at_its_own_times(two_eyes: br.OpenPage) -> None:
    path, page = fakes.fake_path(), two_eyes
    camera = second_camera(path)
    page.run("lightflight.setClock('event')")
    page.slide(700.0)
    before = page.marks("pulse centre")
    page.page.click("#eyes button[data-eye='1']")
    page.run("lightflight.setClock('arrival')")
    page.settle()
    # The pulse itself has not moved.
    np.testing.assert_allclose(page.marks("pulse centre"), before, atol=1e-6)
    when = path.vertex_times_ps[0] + np.array([0.0, 700.0])
    arrival = arrival_time_from_event(
        path.position_at(when),
        when,
        camera_center_mm=camera.center_mm,
        return_group_index=path.medium.return_group_index,
    )
    reading = page.run("lightflight.state.elapsed")
    assert reading == pytest.approx(arrival[1] - arrival[0], abs=1e-6)
    light = np.array(page.run(f"[...lightflight.lightAt('arrival', {reading})]")).reshape(24, 40)
    expected = observe(path, camera).frames(arrival[1])[0]
    assert light.max() > 0.05
    # Per pixel and leg as one Gaussian, against steps of path: alike, not the same.
    assert np.corrcoef(light.ravel(), expected.ravel())[0, 1] > 0.98
    text = page.page.inner_text("#picture-title")
    assert text == "The second camera's picture"
    assert "computed" in page.page.inner_text("#pixel-plot")
    page.shot("page_1280_second_camera")
    page.page.keyboard.press("v")
    assert page.page.inner_text("#picture-title") == "The camera's picture"
    page.settle()
    assert page.run("lightflight.current().t") == pytest.approx(700.0, abs=1e-6)
    page.until("document.querySelector('#pixel-plot canvas') !== null")


def test_a_page_without_a_second_camera_offers_none(page: br.OpenPage) -> None:
    assert not page.page.is_visible("#eyes")
    page.page.keyboard.press("v")
    assert page.page.inner_text("#picture-title") == "The camera's picture"


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_fits_a_telephone(chromium: Any, paper_file: Path, theme: str) -> None:
    page = br.OpenPage(
        chromium, paper_file, viewport={"width": 390, "height": 844}, color_scheme=theme
    )
    page.until("Object.keys(lightflight.plots).length >= 4")
    assert page.run("document.documentElement.scrollWidth") <= 390
    assert page.run("document.querySelector('#space canvas').clientWidth") > 300
    assert is_dark(page) == (theme == "dark")
    # Nothing that can be pressed is smaller than a fingertip would like, and none is cut off.
    for button in page.page.query_selector_all("button:visible, select:visible"):
        box = button.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390.5
        assert box["height"] >= 24
    page.shot(f"page_390_{theme}")
    page.close()


def test_nothing_sticks_out_at_1280(page: br.OpenPage) -> None:
    page.until("Object.keys(lightflight.plots).length >= 4")
    assert page.run("document.documentElement.scrollWidth") <= 1280
    assert page.run("document.querySelector('#space canvas').clientWidth") > 600


def test_at_1280_by_800_the_path_fills_its_panel_and_play_is_in_sight(
    chromium: Any, paper_file: Path
) -> None:
    page = br.OpenPage(chromium, paper_file, viewport={"width": 1280, "height": 800})
    play, panel = (page.page.locator(name).bounding_box() for name in ("#play", "#space"))
    assert play["y"] + play["height"] < 400
    assert panel["y"] + panel["height"] <= 800
    legend = page.page.inner_text("#scene-legend")
    for word in ("path", "truth", "one standard deviation", "field of view", "mirror"):
        assert word in legend
    # Orange of the path: over three quarters of the panel's width.
    across = painted(page, "#space", np.array([0xC8, 0x44, 0x0A]) / 255).any(axis=0)
    where = np.flatnonzero(across)
    assert np.ptp(where) > 0.75 * panel["width"]
    page.shot("page_1280_800")
    page.close()


def test_no_card_is_empty_and_words_on_the_axes_stand_apart(page: br.OpenPage) -> None:
    page.until("Object.keys(lightflight.plots).length >= 4")
    assert not page.page.is_visible("#clock-card")  # no calibration was given
    for card in page.page.query_selector_all("main > .card:visible"):
        assert card.query_selector("canvas, li, dd") is not None
    for name in ("path", "scene", "camera"):
        page.page.click(f"[data-view={name}]")
        page.page.wait_for_timeout(100)
        boxes = np.array(page.run("lightflight.words()"))
        assert len(boxes) >= 6
        for k, one in enumerate(boxes):
            rest = boxes[k + 1 :]
            apart = (one[2] < rest[:, 0]) | (one[0] > rest[:, 2])
            apart |= (one[3] < rest[:, 1]) | (one[1] > rest[:, 3])
            assert apart.all()
    page.page.click("[data-view=path]")


def test_the_picture_has_axes_and_a_scale_of_photons(page: br.OpenPage) -> None:
    page.page.locator("#picture").scroll_into_view_if_needed()
    beside = page.run(
        """(() => {
          const axes = document.getElementById("picture-axes");
          const g = axes.getContext("2d");
          const [wide, tall] = [axes.width, axes.height];
          const strips = [[0, 0, 36, tall], [0, tall - 34, wide, 34], [wide - 60, 0, 60, tall]];
          const alphas = (strip) => g.getImageData(...strip).data.filter((v, i) => i % 4 === 3);
          return strips.map((strip) => alphas(strip).filter((v) => v > 0).length);
        })()"""
    )
    assert min(beside) > 100  # rows, columns, scale
    photons = np.array(page.run("[...lightflight.photons()]")).reshape(32, 32)
    table = fakes.fake_path().residuals
    expected = np.zeros((32, 32))
    np.add.at(expected, (table["row"], table["col"]), table["photons"])
    seen = expected > 0
    np.testing.assert_allclose(photons[seen], expected[seen], rtol=1e-6)


def test_a_point_of_the_path_is_read_with_its_errors(page: br.OpenPage) -> None:
    page.page.locator("#space").scroll_into_view_if_needed()
    box = page.page.locator("#space").bounding_box()
    x, y = page.run("lightflight.places()[20]")[:2]
    page.page.mouse.move(box["x"] + x, box["y"] + y + 2)
    tip = page.page.inner_text("#space-tip")
    assert tip.count("±") == 4
    assert "leg 1" in tip


def test_it_is_turned_by_hand_and_by_keys(page: br.OpenPage) -> None:
    page.page.focus("#space")
    before = page.run("lightflight.places()[0]")
    page.page.keyboard.press("ArrowLeft")
    page.page.keyboard.press("+")
    page.page.wait_for_timeout(100)
    turned = page.run("lightflight.places()[0]")
    assert np.hypot(turned[0] - before[0], turned[1] - before[1]) > 5
    assert page.run("lightflight.state.elapsed") == 0.0  # the time is another's key
    page.page.click("[data-view=path]")
    page.page.wait_for_timeout(100)
    assert page.run("lightflight.places()[0]") == pytest.approx(before, abs=1e-6)
    page.page.hover("#space")
    page.page.mouse.wheel(0, 40)  # the page's, as long as nobody clicked the panel
    page.page.wait_for_timeout(100)
    assert page.run("lightflight.places()[0]") == pytest.approx(before, abs=1e-6)
    page.page.hover("#space")
    page.page.mouse.down()
    page.page.mouse.up()
    page.page.mouse.wheel(0, 400)
    page.page.wait_for_timeout(100)
    assert page.run("lightflight.places()[0][2]") > 1.3 * before[2]
    page.page.click("[data-view=path]")


def test_a_plot_is_zoomed_and_read(page: br.OpenPage) -> None:
    page.until("'clocks-plot' in lightflight.plots")
    frame = page.page.locator("#clocks-plot .plot-frame")
    frame.scroll_into_view_if_needed()
    box = frame.bounding_box()
    before = page.run("lightflight.plots['clocks-plot'].at.x")
    page.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    assert "±" in page.page.inner_text("#clocks-plot .tip")
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 0.8 * box["width"], box["y"] + 0.2 * box["height"])
    page.page.mouse.up()
    zoomed = page.run("lightflight.plots['clocks-plot'].at.x")
    assert before[0] < zoomed[0] < zoomed[1] < before[1]
    frame.dblclick()
    assert page.run("lightflight.plots['clocks-plot'].at.x") == pytest.approx(before)


def painted(page: br.OpenPage, selector: str, wanted: Any) -> Any:
    """Which pixels of an element have about a colour."""
    from io import BytesIO

    from matplotlib.image import imread

    pixels = imread(BytesIO(page.page.locator(selector).screenshot()), format="png")[..., :3]
    return np.abs(pixels - wanted).max(axis=-1) < 0.15


def test_the_scene_is_really_painted(page: br.OpenPage) -> None:
    page.page.wait_for_timeout(500)
    near = painted(page, "#space", np.array([0xC8, 0x44, 0x0A]) / 255)
    assert near.sum() > 300  # the path and the pulse, in the event clock's colour


def test_a_page_of_a_campaign_runs_on_the_parts_beside_it(chromium: Any, tmp_path: Path) -> None:
    fakes.fake_path().save(tmp_path / "a.h5")
    write_campaign([tmp_path / "a.h5"], tmp_path / "index.html")
    shared = tmp_path / "index_pages" / "0001.html"
    whole = tmp_path / "whole" / "page.html"
    whole.parent.mkdir()
    whole.write_text(whole_html(shared), "utf-8")
    for file in (shared, whole):
        page = br.OpenPage(chromium, file)
        page.slide(700.0)
        expected = fakes.fake_path().position_at(fakes.fake_path().vertex_times_ps[0] + 700.0)
        np.testing.assert_allclose(page.marks("pulse centre"), expected, atol=1e-9)
        assert page.run("getComputedStyle(document.body).maxWidth") == "1440px"
        page.shot(f"page_campaign_{file.parent.name}")
        page.close()


@pytest.mark.parametrize(("width", "theme"), [(1280, "light"), (390, "dark")])
def test_the_page_has_no_serious_barrier(
    chromium: Any, paper_file: Path, width: int, theme: str
) -> None:
    size = {"width": width, "height": 800}
    # Colours that are still on their way are nobody's barrier.
    still = {"viewport": size, "color_scheme": theme, "reduced_motion": "reduce"}
    page = br.OpenPage(chromium, paper_file, **still)
    page.until("Object.keys(lightflight.plots).length >= 4")
    for clock in ("event", "arrival"):
        page.run("(clock) => lightflight.setClock(clock)", clock)
        assert barriers(page.page) == []
    page.run("document.getElementById('keys').showModal()")
    assert barriers(page.page) == []
    page.close()


def test_a_campaigns_index_has_no_serious_barrier(chromium: Any, tmp_path: Path) -> None:
    fakes.fake_path().save(tmp_path / "a.h5")
    (tmp_path / "bad.h5").write_bytes(b"nothing")
    write_campaign([tmp_path / "a.h5", tmp_path / "bad.h5"], tmp_path / "index.html")
    for theme in ("light", "dark"):
        context = chromium.new_context(offline=True, color_scheme=theme)
        page = context.new_page()
        page.goto((tmp_path / "index.html").as_uri())
        assert barriers(page) == []
        context.close()


def test_hostile_metadata_do_nothing(chromium: Any, tmp_path: Path) -> None:
    file = tmp_path / "hostile.html"
    write_page(hostile_path(), file, title=HOSTILE[3])
    page = br.OpenPage(chromium, file)
    page.page.wait_for_timeout(300)
    assert page.run("window.hacked === undefined")
    assert page.run("document.querySelectorAll('img, svg[onload]').length") == 0
    assert HOSTILE[1] in page.page.inner_text("body")
    assert page.run("document.title") == HOSTILE[3]
    page.close()


@pytest.mark.parametrize("case", ["nan", "bare", "no legs", "one pixel"])
def test_poor_paths_still_open(chromium: Any, tmp_path: Path, case: str) -> None:
    path: Any = fakes.fake_path()
    if case == "nan":
        path = replace(path, covariance=path.covariance * np.nan, residuals=path.residuals[:0])
    elif case == "bare":
        path = SimpleNamespace(
            vertices_mm=path.vertices_mm, vertex_times_ps=path.vertex_times_ps, truth=None
        )
    elif case == "no legs":
        path = SimpleNamespace(vertices_mm=np.zeros((0, 3)), vertex_times_ps=np.zeros(0))
    else:
        camera = Camera.facing_plane((1, 1), center_mm=(187.5, 37.5))
        table = path.residuals[:1].copy()
        table["row"], table["col"] = 0, 0
        path = replace(path, camera=camera, residuals=table)
    file = tmp_path / "poor.html"
    write_page(path, file)
    page = br.OpenPage(chromium, file)
    told = {"nan": "no finite errors", "bare": "No camera", "no legs": "no legs"}
    page.until(f"document.body.innerText.includes('{told.get(case, 'residual')}')")
    page.close()


def large_path() -> tuple[LightPath, Any]:
    """50 legs before a 256 x 256 camera, 100,000 arrivals."""
    rng = np.random.default_rng(3)
    camera = Camera.facing_plane((256, 256), center_mm=(187.5, 37.5))
    x = np.where(np.arange(51) % 2, 320.0, 55.0)
    vertices = np.stack((x, np.linspace(-70, 140, 51), rng.uniform(-40, 40, 51)), axis=1)
    times = event_times_from_vertices(vertices, emission_time_ps=2000.0)
    n = 100_000
    leg = rng.integers(0, 50, n)
    f = rng.uniform(0, 1, n)
    points = vertices[leg] + f[:, None] * (vertices[leg + 1] - vertices[leg])
    when = times[leg] + f * (times[leg + 1] - times[leg])
    row, col = camera.pixels_from_points(points)
    table = np.zeros(n, RESIDUAL_DTYPE)
    table["row"] = np.clip(np.rint(row), 0, 255)
    table["col"] = np.clip(np.rint(col), 0, 255)
    table["leg"], table["event_time_ps"] = leg, when
    table["arrival_ps"] = arrival_time_from_event(points, when, camera_center_mm=camera.center_mm)
    table["std_ps"] = rng.uniform(1, 9, n)
    table["residual_ps"] = rng.normal(size=n) * table["std_ps"]
    table["photons"] = rng.uniform(50, 4e4, n)
    table["used"] = True
    m = len(times)
    path = replace(
        fakes.fake_path(residuals=False),
        vertices_mm=vertices,
        vertex_times_ps=times,
        covariance=np.diag(np.tile([0.1, 0.1, 0.4, 0.8], m) ** 2),
        camera=camera,
        source=Source(vertices[0]),
        residuals=table,
        truth=None,
    )
    arrivals = SimpleNamespace(
        row=table["row"],
        col=table["col"],
        arrival_ps=table["arrival_ps"],
        std_ps=np.full(n, 72.0),
        photons=table["photons"],
        flags=table["flags"],
        shape=camera.shape,
        laser_period_ps=None,
    )
    return path, arrivals


def mark_ms(page: Any, mark: str) -> float:
    """When an open page set a performance mark, from the start of its navigation."""
    took: float = page.evaluate(f"performance.getEntriesByName('{mark}')[0].startTime")
    return took


@pytest.mark.slow
def test_a_large_scene_is_drawn_soon_and_stays_small(chromium: Any, tmp_path: Path) -> None:
    path, arrivals = large_path()
    rng = np.random.default_rng(5)
    counts = rng.poisson(1.0, size=(256, 256, 64)).astype(np.uint16)
    hist = Histograms(counts, bin_width_ps=200.0, laser_period_ps=12_800.0)
    pulses = SimpleNamespace(
        row=arrivals.row,
        col=arrivals.col,
        delay_ps=np.mod(arrivals.arrival_ps, 12_800.0),
        std_ps=arrivals.std_ps,
        photons=arrivals.photons,
        background_per_ps=np.full(len(arrivals.row), 0.005),
    )
    file = tmp_path / "large.html"
    write_page(path, file, recording=hist, pulses=pulses, arrivals=arrivals)
    assert file.stat().st_size < 20_000_000
    opened = br.OpenPage(chromium, file)
    took = mark_ms(opened.page, "lightflight-first-draw")
    # A second on a quiet computer without a graphics card; tests run beside others.
    assert took < 5_000.0, f"first drawn after {took:.0f} ms"
    opened.slide(20_000.0)
    opened.shot("page_1280_large")
    opened.close()

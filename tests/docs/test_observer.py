"""The observer studio: its formulas are the package's, and it does what its page says."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lightflight import flight
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS
from tests.docs.pages import DOCS
from tests.view import browser as br

STUDIO = DOCS / "_static" / "observer"
CASES = 1000
RELATIVE = 1e-9
CALL = "([name, cases]) => cases.map((words) => observerFormulas[name](...words))"


@pytest.fixture(scope="module")
def opened(chromium: Any, built_pages: Path) -> Iterator[br.OpenPage]:
    page = br.OpenPage(chromium, built_pages / "observer.html")
    yield page
    page.close()


@pytest.fixture
def studio(opened: br.OpenPage) -> br.OpenPage:
    """The page as it is first seen."""
    opened.page.click("text=Across")
    assert opened.errors == []
    return opened


def told(studio: br.OpenPage, name: str, *columns: Any) -> np.ndarray:
    """What a formula of the page gives, case by case."""
    arrays = [np.asarray(column, dtype=float) for column in columns]
    cases = [[one[k].tolist() for one in arrays] for k in range(CASES)]
    answers = studio.run(CALL, [name, cases])
    return np.array([list(a.values()) if isinstance(a, dict) else a for a in answers])


def indices(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """n_p and n_r <= n_p; equal in half of the cases."""
    out = rng.uniform(1.0, 2.0, CASES)
    back = np.where(rng.random(CASES) < 0.5, out, rng.uniform(1.0, out))
    return out, back


def test_the_speed_of_light_is_the_packages(studio: br.OpenPage) -> None:
    assert studio.run("LIGHT_MM_PER_PS") == SPEED_OF_LIGHT_MM_PER_PS


def test_the_half_angle_law_is_the_packages(studio: br.OpenPage, rng: np.random.Generator) -> None:
    psi = rng.uniform(-1.5, 1.5, CASES)
    time, distance = rng.uniform(-5000, 5000, CASES), rng.uniform(20, 2000, CASES)
    out, back = indices(rng)
    own = [
        flight.arrival_time_from_viewing_angle(
            psi[k], foot_time_ps=0.0, foot_distance_mm=distance[k],
            medium=flight.Medium(out[k], back[k]),
        )
        for k in range(CASES)
    ]  # fmt: skip
    # Against zero foot time: a sum that cancels has no relative error.
    page = told(studio, "arrivalFromViewingAngle", psi, np.zeros(CASES), distance, out, back)
    np.testing.assert_allclose(page, own, rtol=RELATIVE)
    late = told(studio, "arrivalFromViewingAngle", psi, time, distance, out, back)
    np.testing.assert_allclose(late, time + np.array(own), rtol=RELATIVE, atol=1e-9)
    again = told(studio, "viewingAngleFromArrival", late, time, distance, out, back)
    np.testing.assert_allclose(again, psi, rtol=RELATIVE, atol=1e-9)


def test_apparent_speeds_are_the_packages(studio: br.OpenPage, rng: np.random.Generator) -> None:
    along, towards = (rng.uniform(-np.pi, np.pi, CASES) for _ in range(2))
    d, u = (np.stack((np.cos(a), np.sin(a)), axis=1) for a in (along, towards))
    out, back = indices(rng)
    psi = -np.arcsin(np.clip(np.sum(d * u, axis=1), -1, 1))
    own = np.array(
        [
            flight.apparent_speed_from_direction(d[k], u[k], medium=flight.Medium(out[k], back[k]))
            for k in range(CASES)
        ]
    )
    # Straight at the camera it grows without bound, and so does what rounding does to it.
    tame = own < 1e3 * SPEED_OF_LIGHT_MM_PER_PS
    assert tame.sum() > 0.98 * CASES
    by_direction = told(studio, "apparentSpeed", d, u, out, back)
    np.testing.assert_allclose(by_direction[tame], own[tame], rtol=RELATIVE)
    by_angle = told(studio, "apparentSpeedAtAngle", psi, out, back)
    np.testing.assert_allclose(by_angle[tame], own[tame], rtol=RELATIVE)


def test_the_border_between_outrunning_and_lagging_is_where_the_package_has_c(
    studio: br.OpenPage, rng: np.random.Generator
) -> None:
    out, back = indices(rng)
    crossing = told(studio, "crossingAngle", out, back).astype(float)
    never = (out - 1.0) / back > 1.0
    assert np.array_equal(np.isnan(crossing), never)
    for k in np.flatnonzero(~never):
        d, u = (1.0, 0.0), (-np.sin(crossing[k]), np.cos(crossing[k]))
        speed = flight.apparent_speed_from_direction(d, u, medium=flight.Medium(out[k], back[k]))
        assert speed == pytest.approx(SPEED_OF_LIGHT_MM_PER_PS, rel=RELATIVE)


def test_geometry_and_times_are_the_packages(studio: br.OpenPage, rng: np.random.Generator) -> None:
    """A place on a line, seen from a camera: by its angle, and by the way its light takes."""
    alpha = rng.uniform(-1.2, 1.2, CASES)
    camera = rng.uniform((-500, -500), (500, 500), (CASES, 2))
    along = rng.uniform(-400, 400, CASES)
    out, back = indices(rng)
    d = told(studio, "direction", alpha)
    elevation = flight.elevation_from_direction(np.insert(d, 1, 0.0, axis=1), (0.0, 0.0, 1.0))
    np.testing.assert_allclose(elevation, alpha, rtol=RELATIVE, atol=1e-12)
    points = along[:, np.newaxis] * d
    time = told(studio, "eventTime", along, out)
    np.testing.assert_allclose(time, out * along / SPEED_OF_LIGHT_MM_PER_PS, rtol=RELATIVE)
    np.testing.assert_allclose(told(studio, "alongAtEvent", time, out), along, rtol=RELATIVE)
    own = [
        flight.arrival_time_from_event(
            np.insert(points[k], 1, 0.0), 0.0, camera_center_mm=np.insert(camera[k], 1, 0.0),
            return_group_index=back[k],
        )
        for k in range(CASES)
    ]  # fmt: skip
    direct = told(studio, "arrivalFromEvent", points, np.zeros(CASES), camera, back)
    np.testing.assert_allclose(direct, own, rtol=RELATIVE)
    towards = told(studio, "towards", points, camera)
    separation = camera - points
    unit = separation / np.linalg.norm(separation, axis=1, keepdims=True)
    np.testing.assert_allclose(towards, unit, rtol=RELATIVE, atol=1e-12)
    # The law of the angle says the same as the way that the light takes.
    foot = np.sum(camera * d, axis=1)
    distance = np.linalg.norm(camera - foot[:, np.newaxis] * d, axis=1)
    feet = told(studio, "foot", camera, alpha)
    np.testing.assert_allclose(feet, np.stack((foot, distance), axis=1), rtol=1e-9, atol=1e-9)
    psi = studio.run(
        "(cases) => cases.map(([along, camera, alpha]) => "
        "observerFormulas.viewingAngle(along, observerFormulas.foot(camera, alpha)))",
        [[along[k], camera[k].tolist(), alpha[k]] for k in range(CASES)],
    )
    seen = told(
        studio, "arrivalFromViewingAngle", psi, out * foot / SPEED_OF_LIGHT_MM_PER_PS,
        distance, out, back,
    )  # fmt: skip
    np.testing.assert_allclose(seen, np.array(own) + time, rtol=RELATIVE, atol=1e-7)


def test_every_formula_is_compared(studio: br.OpenPage) -> None:
    compared = {
        "direction", "towards", "foot", "viewingAngle", "along", "eventTime", "alongAtEvent",
        "arrivalFromEvent", "arrivalFromViewingAngle", "viewingAngleFromArrival",
        "apparentSpeed", "apparentSpeedAtAngle", "crossingAngle",
    }  # fmt: skip
    assert set(studio.run("Object.keys(observerFormulas)")) == compared
    assert "Math.sqrt" not in (STUDIO / "studio.js").read_text(encoding="utf-8")
    there_and_back = studio.run(
        "(() => { const foot = { at: 30, distance: 70 };"
        " return observerFormulas.along(observerFormulas.viewingAngle(123, foot), foot); })()"
    )
    assert there_and_back == pytest.approx(123, rel=RELATIVE)


def test_the_camera_moves_by_keys_fields_and_hand(studio: br.OpenPage) -> None:
    page = studio.page
    page.focus("#studio-camera")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowUp")
    assert studio.run("observerStudio.state.camera") == [10, 310]
    assert page.input_value("#studio-x") == "10"
    page.fill("#studio-x", "-100")
    assert studio.run("observerStudio.state.camera") == [-100, 310]
    box = page.locator("#studio-camera rect").bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] + 60, box["y"] + 40)
    page.mouse.up()
    assert studio.run("observerStudio.state.camera[0]") > -100
    assert studio.run("observerStudio.state.camera[1]") < 310


def test_a_camera_on_the_path_is_put_beside_it(studio: br.OpenPage) -> None:
    studio.page.fill("#studio-z", "0")
    assert studio.run("observerStudio.scene().foot.distance") == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("press", "says"),
    [("Towards the camera", "outruns light"), ("Away from it", "lags")],
)
def test_it_says_whether_light_is_outrun(studio: br.OpenPage, press: str, says: str) -> None:
    studio.page.click(f"text={press}")
    assert says in studio.page.inner_text("#studio-said")


def test_a_slower_way_moves_the_border(studio: br.OpenPage) -> None:
    studio.page.click("text=In a glass fibre")
    assert studio.run("observerStudio.scene().crossing") == pytest.approx(np.arcsin(-0.47))
    assert studio.page.is_visible("#studio-two-indices")
    assert not studio.page.is_visible("#studio-one-index")


def test_it_plays_and_stops(studio: br.OpenPage) -> None:
    studio.page.click("#studio-play")
    before = studio.run("observerStudio.state.share")
    studio.until(f"observerStudio.state.share > {before + 0.02}")
    studio.page.click("#studio-play")
    at = studio.run("observerStudio.state.share")
    studio.page.wait_for_timeout(100)
    assert studio.run("observerStudio.state.share") == at


def test_who_asked_for_less_motion_sees_steps(chromium: Any, built_pages: Path) -> None:
    page = br.OpenPage(chromium, built_pages / "observer.html", reduced_motion="reduce")
    page.page.click("#studio-play")
    before = page.run("observerStudio.state.share")
    page.page.wait_for_timeout(300)
    assert page.run("observerStudio.state.share") == before
    page.until(f"observerStudio.state.share >= {before} + 0.7 / 9")
    page.close()


def test_shots_are_kept(studio: br.OpenPage) -> None:
    studio.shot("observer")
    assert studio.page.locator("#studio-plan text").count() >= 6

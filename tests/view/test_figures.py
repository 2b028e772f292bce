"""Figures hold the numbers they are made from, say what is missing, and keep type apart."""

from __future__ import annotations

import io
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.patches import Rectangle
from matplotlib.text import Text

from lightflight import flags as fl
from lightflight.path.trace import trace_from_path
from lightflight.view import style
from lightflight.view.figures.calibration import calibration_figure, draw_bad_pixels
from lightflight.view.figures.camera import draw_camera_picture
from lightflight.view.figures.demo import demo_figure
from lightflight.view.figures.fiber import fiber_figure
from lightflight.view.figures.path import (
    draw_path_3d,
    draw_path_on_photo,
    legend_entries,
)
from lightflight.view.figures.pulls import draw_pulls
from lightflight.view.figures.timing import (
    distortion_rms_ps,
    draw_residual_map,
    draw_residuals_along,
    draw_time_errors,
    draw_times,
)
from lightflight.view.solids import field_of_view, mirror_outline, nice_factor
from tests.view import fakes


def xs(line: Any) -> Any:
    """Horizontal values of a line."""
    return np.asarray(line.get_xdata(), dtype=float)


def ys(line: Any) -> Any:
    """Vertical values of a line."""
    return np.asarray(line.get_ydata(), dtype=float)


def words_in(figure: Any) -> str:
    """All visible text of a figure in one string."""
    return "\n".join(t.get_text() for t in figure.findobj(Text) if t.get_visible())


def drawn_words(figure: Any) -> list[Text]:
    """Every text that is drawn: tick labels beyond an axis' limits exist but are not."""
    undrawn = set()
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            low, high = sorted(axis.get_view_interval())
            slack = 1e-6 * (high - low)
            for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
                outside = not low - slack <= tick.get_loc() <= high + slack
                if outside or not ax.axison:
                    undrawn |= {tick.label1, tick.label2}
            if not ax.axison:
                undrawn |= {axis.label, axis.offsetText}
    every = figure.findobj(Text)
    return [t for t in every if t.get_visible() and t.get_text().strip() and t not in undrawn]


def overlapping_words(figure: Any) -> list[tuple[str, str]]:
    """Pairs of texts whose ink boxes overlap, and texts that leave the page."""
    figure.canvas.draw()
    renderer = figure.canvas.get_renderer()
    boxes = []
    for text in drawn_words(figure):
        # Line height is generous: ink fills about 0.72 of it.
        box = text.get_window_extent(renderer).shrunk(0.96, 0.72)
        boxes.append((text.get_text(), box))
    page = figure.bbox
    bad = [
        (word, "leaves the page")
        for word, b in boxes
        if b.x0 < page.x0 or b.x1 > page.x1 or b.y0 < page.y0 or b.y1 > page.y1
    ]
    for i, (word, box) in enumerate(boxes):
        bad += [(word, other) for other, b in boxes[i + 1 :] if box.overlaps(b)]
    return bad


def lightness(color: Any) -> float:
    """CIE L* of a colour."""
    rgb = np.array(mpl.colors.to_rgb(color))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    y = float(linear @ [0.2126, 0.7152, 0.0722])
    return 116 * y ** (1 / 3) - 16 if y > 0.008856 else 903.3 * y


def test_the_style_prints_in_grey() -> None:
    assert lightness(style.EVENT) - lightness(style.ARRIVAL) > 15
    shades = np.array([lightness(c) for c in style.time_colormap()(np.linspace(0, 1, 64))])
    assert (np.diff(shades) > 0).all()
    assert shades[-1] < 88  # the lightest time is still visible on white
    ends = [lightness(c) for c in style.signed_colormap()([0.0, 1.0])]
    assert abs(ends[0] - ends[1]) > 15


def test_the_users_own_settings_come_back_and_pyplot_knows_nothing() -> None:
    before = dict(mpl.rcParams)
    draw_times(fakes.fake_path())
    assert dict(mpl.rcParams) == before
    import matplotlib.pyplot as plt

    assert plt.get_fignums() == []


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0856, "0.0856"), (-3.0, "\u22123.00"), (1234.5, "1234"), (np.nan, "\u2013"), (0, "0")],
)
def test_numbers_are_set_with_significant_digits(value: float, text: str) -> None:
    assert style.number(value) == text


@pytest.mark.parametrize(("ratio", "factor"), [(0.3, 1), (4.9, 2), (5.0, 5), (730, 500)])
def test_magnifications_are_round(ratio: float, factor: float) -> None:
    assert nice_factor(ratio) == factor


def test_the_papers_scene_is_distorted_by_its_stated_amount() -> None:
    exact = trace_from_path(fakes.truth_record(), camera=fakes.paper_camera())
    assert 174.0 < distortion_rms_ps(exact) < 176.0  # the paper: 174.80 ps


def test_times_start_at_zero_and_follow_both_clocks() -> None:
    path = fakes.fake_path()
    ax = draw_times(path)
    lines = {line.get_label(): line for line in ax.lines}
    trace = trace_from_path(path)
    frame, event = xs(lines["event time $t$"]), ys(lines["event time $t$"])
    np.testing.assert_allclose(frame, (trace.arrival_ps - trace.arrival_ps[0]) / 55.0)
    np.testing.assert_allclose(event, trace.event_time_ps - trace.event_time_ps[0])
    arrival = ys(lines["arrival time $t_a$"])
    assert arrival[0] == 0.0
    assert "truth" in lines


def test_time_errors_are_against_the_truth() -> None:
    path = fakes.fake_path()
    late = replace(path, vertices_mm=fakes.VERTICES_MM, vertex_times_ps=path.truth.vertex_times_ps)
    ax = draw_time_errors(late, points=False)
    error = ys(next(line for line in ax.lines if "sigma" in str(line.get_label())))
    assert np.nanmax(np.abs(error)) < 1e-6
    assert np.isnan(error).any()  # nothing is claimed outside the picture
    assert "truth is not known" in words_in(
        draw_time_errors(replace(path, truth=None)).get_figure()
    )


def test_residual_figures_mark_what_was_left_out() -> None:
    path = fakes.fake_path()
    ax = draw_residuals_along(path)
    text = words_in(ax.get_figure())
    assert "left out (1)" in text
    assert "ps" in text
    assert max(abs(v) for v in ax.get_ylim()) < 5  # one outlier of 9 ps does not set the scale
    ax = draw_residual_map(path)
    picture = np.asarray(ax.images[0].get_array(), dtype=float)
    used = path.residuals[path.residuals["used"]]
    assert np.isfinite(picture).sum() == len(np.unique(used[["row", "col"]]))
    negative = next(line for line in ax.lines if line.get_marker() == ".")
    assert len(xs(negative)) == (np.asarray(picture) < 0).sum()


def test_pulls_state_their_spread() -> None:
    path = fakes.fake_path()
    used = path.residuals[path.residuals["used"]]
    spread = np.std(used["residual_ps"] / used["std_ps"], ddof=1)
    ax = draw_pulls(path)
    assert f"{spread:.3f}" in words_in(ax.get_figure())
    assert sum(cast(Rectangle, p).get_height() for p in ax.patches) == len(used)


def test_path_figure_states_its_magnification() -> None:
    path = fakes.fake_path()
    ax = draw_path_3d(path, magnification=50)
    assert "enlarged 50\u00d7" in words_in(ax.get_figure())
    ax = draw_path_3d(replace(path, covariance=path.covariance * np.nan))
    assert "error tube" not in words_in(ax.get_figure())


def test_field_of_view_is_the_cameras() -> None:
    outline = field_of_view(fakes.paper_camera(), np.zeros(3))
    np.testing.assert_allclose(outline[:, 2], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.ptp(outline, axis=0)[:2], 245.0, rtol=1e-9)


def test_a_mirror_reflects_one_leg_into_the_next() -> None:
    before, corner, after = fakes.VERTICES_MM[:3]
    square = mirror_outline(before, corner, after, size_mm=20.0)
    normal = np.cross(square[1] - square[0], square[3] - square[0])
    normal /= np.linalg.norm(normal)
    incoming = (corner - before) / np.linalg.norm(corner - before)
    outgoing = (after - corner) / np.linalg.norm(after - corner)
    np.testing.assert_allclose(incoming - 2 * (incoming @ normal) * normal, outgoing, atol=1e-12)
    np.testing.assert_allclose(square.mean(axis=0), corner, atol=1e-12)


def test_the_camera_picture_shows_times_from_the_first() -> None:
    path = fakes.fake_path()
    arrivals = fakes.fake_arrivals(path)
    ax = draw_camera_picture(arrivals, path=path)
    picture = np.asarray(ax.images[0].get_array())
    table = path.residuals
    k = int(np.argmax(table["arrival_ps"]))
    span = np.ptp(table["arrival_ps"])
    assert picture[table["row"][k], table["col"][k]] == pytest.approx(span)
    assert np.nanmin(picture) == 0.0
    crosses = next(line for line in ax.lines if line.get_marker() == "x")
    assert len(xs(crosses)) == 2  # screaming and too wide; silent pixels stay blank


def test_a_flight_across_the_laser_period_is_shown_in_one_piece() -> None:
    path = fakes.fake_path()
    arrivals = fakes.fake_arrivals(path)
    shift = 50_000.0 - np.nanmedian(arrivals.arrival_ps)
    arrivals.arrival_ps = np.mod(arrivals.arrival_ps + shift, 50_000.0)
    ax = draw_camera_picture(arrivals)
    span = np.ptp(path.residuals["arrival_ps"])
    assert np.nanmax(np.asarray(ax.images[0].get_array())) == pytest.approx(span)


@pytest.mark.parametrize("case", ["all", "no arrivals", "no truth"])
def test_the_demo_figure_keeps_its_words_apart(case: str) -> None:
    path = fakes.fake_path()
    arrivals = None if case == "no arrivals" else fakes.fake_arrivals(path)
    if case == "no truth":
        path = replace(path, truth=None)
    figure = demo_figure(
        path,
        arrivals=arrivals,
        others={"paper": fakes.fake_path(seed=3, error_mm=1.2)},
        published={"published (2020)": (1.75, 3.84)},
    )
    assert overlapping_words(figure) == []
    text = words_in(figure)
    assert path.prior in text
    assert ("1.75 mm" in text) == (case != "no truth")
    for kind in ("svg", "pdf", "png"):
        out = io.BytesIO()
        figure.savefig(out, format=kind)
        assert len(out.getvalue()) > 10_000


def test_the_demo_figure_opens_for_a_path_with_nothing_but_vertices() -> None:
    path = replace(
        fakes.fake_path(residuals=False), covariance=np.full((16, 16), np.nan), truth=None
    )
    text = words_in(demo_figure(path))
    assert "the path carries no residuals" in text


def test_a_path_lies_on_the_photo_where_its_camera_sees_it() -> None:
    path, camera = fakes.fake_path(), fakes.paper_camera()
    ax = draw_path_on_photo(path, np.zeros((32, 32)), camera)
    row, col = camera.pixels_from_points(path.vertices_mm)
    line = max(ax.lines, key=lambda one: one.get_linewidth())
    assert np.nanmin(np.abs(xs(line) - 31.5)) < 1.0  # it reaches the picture's edge
    assert xs(ax.lines[-1])[0] == pytest.approx(col[0])
    assert ys(ax.lines[-1])[0] == pytest.approx(row[0])
    with pytest.raises(ValueError, match="give the camera of this photo"):
        draw_path_on_photo(path, np.zeros((10, 32)), camera)


def fake_timing(rng: np.random.Generator, *, flat: bool = True) -> Any:
    shape = (32, 32)
    words = np.zeros(shape, dtype=np.uint32)
    words.ravel()[rng.choice(1024, 73, replace=False)] = fl.SCREAMING
    words[3, 4] |= fl.DEAD
    mean = np.array([1.036, 0.922, 0.990, 1.096, 0.968, 0.982, 0.936, 1.069])
    nan = np.full(shape, np.nan)
    return SimpleNamespace(
        shape=shape,
        flags=words,
        gain=1 + 0.0065 * rng.normal(size=shape),
        phases=mean * (1 + 0.064 * rng.normal(size=(*shape, 8))),
        phase_std=np.full((*shape, 8), 0.008),
        skew_ps=300 * rng.normal(size=shape) if flat else np.zeros(shape),
        skew_std_ps=np.full(shape, 0.4) if flat else nan,
        response_std_ps=72 + 1.5 * rng.normal(size=shape) if flat else nan,
        bin_width_ps=55.06,
        scale_std=0.0035,
        laser_period_ps=50_000.0,
        reversed_codes=True,
        notes=("dead codes: absorbed or lost is unknown, so the time scale is uncertain",),
    )


@pytest.mark.parametrize("flat", [True, False])
def test_the_calibration_figure_shows_what_was_measured(
    rng: np.random.Generator, flat: bool
) -> None:
    timing = fake_timing(rng, flat=flat)
    figure = calibration_figure(timing)
    text = words_in(figure)
    assert overlapping_words(figure) == []
    assert "55.060 ps" in text
    assert "screaming: 73" in text
    assert "dead: 1" in text
    assert ("no flat recording" in text) == (not flat)
    good = fl.is_usable(timing.flags)
    assert f"{np.std(100 * timing.gain[good]):.2f} % rms" in text
    seen = np.std(timing.phases[good], axis=0)
    own = np.hypot(np.sqrt(np.mean(seen**2)), 0.008)
    assert f"pixels differ by {100 * own:.1f} % rms, known to 0.8 %" in text


def test_bad_pixels_are_drawn_where_they_are(rng: np.random.Generator) -> None:
    timing = fake_timing(rng)
    ax = draw_bad_pixels(timing)
    dead = next(line for line in ax.lines if str(line.get_label()).startswith("dead"))
    assert (xs(dead)[0], ys(dead)[0]) == (4, 3)


def fake_leg(members: Any, slope: float) -> Any:
    return SimpleNamespace(
        members=np.asarray(members),
        origin_px=np.array([16.0, 16.0]),
        direction_px=np.array([1.0, 0.0]),
        extent_px=(-14.0, 14.0),
        points_px=lambda s: np.array([16.0, 16.0]) + np.asarray(s)[..., None] * [1.0, 0.0],
        arrival_ps=lambda s: 100.0 + slope * np.asarray(s),
        apparent_speed_px_per_ps=1 / slope,
    )


def test_fiber_figure_claims_no_millimetres() -> None:
    path = fakes.fake_path()
    arrivals = fakes.fake_arrivals(path)
    hist = SimpleNamespace(photons=np.ones((32, 32)), bin_width_ps=None)
    track = np.array([[90.0, 10, 16], [np.nan, 0, 0], [110.0, 20, 16]])
    figure = fiber_figure(hist, arrivals, [fake_leg(np.arange(30), 0.8)], track, headline="Fibre")
    text = words_in(figure)
    assert "mm" not in text
    assert "(codes)" in text
    assert "1.25 px per code" in text
    assert overlapping_words(figure) == []
    with pytest.raises(ValueError, match="shape"):
        fiber_figure(hist, arrivals, [], np.zeros((3, 2)))
    assert "no leg was found" in words_in(fiber_figure(hist, arrivals, []))


def test_strays_without_number_are_counted_not_drawn() -> None:
    n = 400
    table = SimpleNamespace(
        row=np.arange(n) // 32, col=np.arange(n) % 32, arrival_ps=np.linspace(90.0, 100.0, n),
        std_ps=np.ones(n), flags=np.zeros(n, np.uint32), shape=(32, 32), laser_period_ps=None,
    )  # fmt: skip
    hist = SimpleNamespace(photons=np.ones((32, 32)), bin_width_ps=None)
    figure = fiber_figure(hist, table, [])
    assert "400 on no leg, not drawn" in words_in(figure)
    drawn = [len(c.get_offsets()) for c in figure.axes[0].collections]
    assert max(drawn, default=0) < 400


def test_legends_of_the_path_name_every_estimate() -> None:
    path = fakes.fake_path()
    ax = draw_path_3d(path, others={"paper": path, "start": path})
    labels = legend_entries(ax, path)[1]
    assert {"paper estimate", "start estimate", "truth"} <= set(labels)


def test_every_public_name_of_view_exists() -> None:
    from lightflight import view

    for name in view.__all__:
        assert callable(getattr(view, name)), name
    with pytest.raises(AttributeError, match="no_such"):
        view.no_such  # noqa: B018


def test_a_fit_is_drawn_beside_the_counts_that_pile_up_left() -> None:
    """Three frames of four hold a photon: 1.85 photons came for each that was counted."""
    from lightflight import Histograms, fit_pulses
    from lightflight.view.figures.camera import draw_pixel_histogram

    rng = np.random.default_rng(9)
    counts = np.full((1, 12, 200), 40, dtype=np.uint32)
    counts[..., 40:43] += 4000
    hist = Histograms(
        rng.poisson(counts), bin_width_ps=50.0, n_frames=26_600, periods_per_frame=4000
    )
    pulses = fit_pulses(hist, max_pulses=1)
    assert pulses.photons[0] > 1.7 * 12_000
    ax = draw_pixel_histogram(hist, 0, 0, pulses=pulses)
    drawn = next(p for p in ax.patches if p.get_label() == "fit").get_data().values  # type: ignore[attr-defined]
    assert drawn.sum() == pytest.approx(float(hist.photons[0, 0]), rel=0.02)


def test_a_fit_by_least_squares_is_drawn_as_it_was_fitted() -> None:
    """Sampled at the codes' middles; a pulse of one code, integrated, would be half as high."""
    from lightflight import Histograms, fit_pulses
    from lightflight.view.figures.camera import draw_pixel_histogram

    counts = np.full((1, 12, 200), 2, dtype=np.uint32)
    counts[..., 41] = 4000
    hist = Histograms(counts, bin_width_ps=50.0)
    pulses = fit_pulses(hist, max_pulses=1, method="least_squares")
    ax = draw_pixel_histogram(hist, 0, 0, pulses=pulses)
    drawn = next(p for p in ax.patches if p.get_label() == "fit").get_data().values  # type: ignore[attr-defined]
    assert pulses.photons[0] < 2500
    np.testing.assert_allclose(drawn, counts[0, 0], atol=8)


@pytest.mark.parametrize("center", [2025.0, 9_990.0])
def test_a_pixels_histogram_follows_its_codes_and_its_fit(center: float) -> None:
    from lightflight import Histograms
    from lightflight.view.figures.camera import draw_pixel_histogram, pixel_cases_figure

    rng = np.random.default_rng(8)
    counts = rng.poisson(0.2, size=(2, 3, 200)).astype(np.uint32)
    codes = np.floor(center / 50.0 + rng.normal(0, 1.4, 5000)).astype(int) % 200
    np.add.at(counts, (1, 2, codes), 1)
    hist = Histograms(counts, bin_width_ps=50.0, laser_period_ps=10_000.0)
    pulses = fakes.fake_pulses([1], [2], [center], std_ps=70.0, photons=5000.0)
    ax = draw_pixel_histogram(hist, 1, 2, pulses=pulses)
    low, high = ax.get_xlim()
    assert low < center < high  # in one piece, also across the end of the period
    bars = next(p for p in ax.patches if p.get_label() == "counts").get_data()  # type: ignore[attr-defined]
    code = np.rint(bars.edges[:-1:2] / 50.0).astype(int) % 200
    np.testing.assert_array_equal(bars.values[::2], counts[1, 2, code])
    assert sorted(code) == list(range(200))
    assert not bars.values[1::2].any()
    expected = next(p for p in ax.patches if p.get_label() == "fit").get_data().values  # type: ignore[attr-defined]
    # Five standard deviations of 5,000 photons.
    assert abs(expected.sum() - counts[1, 2].sum()) < 5 * np.sqrt(5000)
    assert "5000" in words_in(ax.get_figure())
    whole = draw_pixel_histogram(hist, 1, 2).get_xlim()
    assert whole == pytest.approx((0.0, 10_000.0))
    fullest = draw_pixel_histogram(hist, 1, 2, window_ps=500.0).get_xlim()
    top = 50.0 * (np.argmax(counts[1, 2]) + 0.5)
    assert fullest == pytest.approx((top - 250.0, top + 250.0))
    with pytest.raises(IndexError, match="2 x 3"):
        draw_pixel_histogram(hist, 2, 0)
    text = words_in(pixel_cases_figure(hist, pulses))
    assert "no pixel is\ntoo wide" in text
    assert "3  effective" in text

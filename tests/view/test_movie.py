"""Films: what a frame shows, and that files play."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_hex

from lightflight import Histograms, TimingCalibration
from lightflight.camera.model import Camera
from lightflight.errors import GeometryError, MissingExtraError, NothingFoundError
from lightflight.path.trace import trace_from_path
from lightflight.view import style
from lightflight.view.film import encode
from lightflight.view.film.flight import (
    MovieSettings,
    movie_frames,
    pulse_body,
    readings,
    write_movie,
)
from lightflight.view.film.recording import recording_frames, write_recording_movie
from lightflight.view.film.slices import slices_from_histograms
from lightflight.view.viewpoint import Viewpoint
from tests.path.test_second_view import side_camera
from tests.view import fakes

SMALL = MovieSettings(size_px=(320, 240), frames_per_second=10, pace_ps_per_s=8000)


def near_color(frame: Any, color: str, tolerance: int = 40) -> Any:
    """(n, 2) pixels (x, y) of about this colour."""
    rgb = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])
    match = np.abs(frame.astype(int) - rgb).max(axis=2) <= tolerance
    return np.argwhere(match)[:, ::-1]


def test_readings_run_from_before_the_first_light_to_after_the_last() -> None:
    trace = trace_from_path(fakes.fake_path())
    every = readings(trace, MovieSettings(frames_per_second=20, pace_ps_per_s=400))
    assert every[0] < 0
    assert every[-1] > np.ptp(trace.event_time_ps)
    np.testing.assert_allclose(np.diff(every), 20.0)


def test_the_body_of_the_pulse_is_where_it_is_and_as_long_as_it_is() -> None:
    path, view = fakes.fake_path(), Viewpoint()
    when = path.vertex_times_ps[0] + 500.0
    segments, colors = pulse_body(path, when, fwhm_ps=68.0, view=view, color=style.EVENT)
    points = np.array(segments).mean(axis=1)
    weights = colors[:, 3]
    center = np.average(points, axis=0, weights=weights)
    np.testing.assert_allclose(center, view.project(path.position_at([when])[0]), atol=1e-6)
    spread = np.sqrt(np.average(((points - center) ** 2).sum(axis=1), weights=weights))
    step = view.project(path.position_at([when, when + 100.0]))
    expected = 68.0 / 2.3548 * np.linalg.norm(step[1] - step[0]) / 100.0
    assert spread == pytest.approx(expected, rel=0.03)
    before = path.vertex_times_ps[0] - 500.0
    assert pulse_body(path, before, fwhm_ps=68.0, view=view, color=style.EVENT)[0] == []


def test_frames_show_the_pulse_moving_and_the_cameras_light() -> None:
    path = fakes.fake_path()
    settings = replace(SMALL, size_px=(640, 480))
    frames = list(movie_frames(path, settings=settings))
    every = readings(trace_from_path(path), settings)
    assert len(frames) == len(every)
    assert frames[0].shape == (480, 640, 3)
    still = frames[0].astype(int)
    assert every[0] < 0
    k = int(np.argmin(np.abs(every - 600.0)))  # on leg 1, seen by the camera
    changed = np.argwhere(np.abs(frames[k].astype(int) - still).max(axis=2) > 25)[:, ::-1]
    left = changed[(changed[:, 0] < 380) & (changed[:, 1] > 60) & (changed[:, 1] < 320)]
    later = np.argwhere(np.abs(frames[k + 1].astype(int) - still).max(axis=2) > 25)[:, ::-1]
    later = later[(later[:, 0] < 380) & (later[:, 1] > 60) & (later[:, 1] < 320)]
    assert len(left) > 20
    assert np.median(later[:, 0]) > np.median(left[:, 0])  # leg 1 runs to the right
    picture = changed[(changed[:, 0] > 425) & (changed[:, 1] > 110) & (changed[:, 1] < 310)]
    assert len(picture) > 20
    row = np.median(picture[:, 1])
    assert row > 210  # leg 1 is in the lower half of the camera's picture


def test_an_orbit_turns_the_scene() -> None:
    path = fakes.fake_path(residuals=False)
    still = [f for f, _ in zip(movie_frames(path, settings=SMALL), range(2), strict=False)]
    turning = replace(SMALL, orbit_deg=90.0)
    turned = [f for f, _ in zip(movie_frames(path, settings=turning), range(2), strict=False)]
    half = (slice(60, 160), slice(0, 190))
    assert np.abs(still[1][half].astype(int) - still[0][half].astype(int)).mean() < 0.5
    assert np.abs(turned[0][half].astype(int) - still[0][half].astype(int)).mean() > 1.0


def test_another_camera_can_look_on() -> None:
    path = fakes.fake_path()
    own = next(movie_frames(path, settings=SMALL))
    other = next(movie_frames(path, camera=side_camera(), settings=SMALL))
    assert (own[:, 200:] != other[:, 200:]).any()
    with pytest.raises(GeometryError):
        next(movie_frames(path, camera=Camera.facing_plane(center_mm=(9e3, 0)), settings=SMALL))


@pytest.mark.parametrize("n_vertices", [0, 1])
def test_a_path_without_legs_gives_a_film_that_says_so(n_vertices: int) -> None:
    bare = SimpleNamespace(
        vertices_mm=np.zeros((n_vertices, 3)), vertex_times_ps=np.zeros(n_vertices)
    )
    frames = list(movie_frames(bare, settings=SMALL))
    assert len(frames) == 1


def test_a_path_with_nan_errors_still_makes_a_film() -> None:
    path = fakes.fake_path(residuals=False)
    path = replace(path, covariance=path.covariance * np.nan, truth=None)
    assert next(movie_frames(path, settings=SMALL)).shape == (240, 320, 3)


def test_mp4_plays(tmp_path: Path) -> None:
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="MP4 needs the view extra")
    told: list[tuple[int, int]] = []
    file = tmp_path / "flight.mp4"
    write_movie(
        fakes.fake_path(),
        file,
        settings=SMALL,
        progress=lambda done, total: told.append((done, total)),
    )
    done = subprocess.run(
        [ffmpeg.get_ffmpeg_exe(), "-i", file, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"],
        capture_output=True,
        check=True,
    )
    frames = np.frombuffer(done.stdout, dtype=np.uint8).reshape(-1, 240, 320, 3)
    expected = list(movie_frames(fakes.fake_path(), settings=SMALL))
    assert len(frames) == len(expected)
    assert np.abs(frames[5].astype(int) - expected[5]).mean() < 4  # compressed, not changed
    heard = done.stderr.decode()
    assert "h264" in heard
    assert "10 fps" in heard
    assert told == [(k + 1, len(frames)) for k in range(len(frames))]


def test_gif_plays(tmp_path: Path) -> None:
    from PIL import Image

    file = tmp_path / "flight.gif"
    write_movie(fakes.fake_path(), file, settings=SMALL)
    film: Any
    with Image.open(file) as film:
        assert film.n_frames == len(readings(trace_from_path(fakes.fake_path()), SMALL))
        assert film.info["duration"] == 100
        film.seek(film.n_frames // 2)
        middle = np.asarray(film.convert("RGB"))
    assert len(near_color(middle, style.EVENT)) > 10  # the pulse kept its colour


def test_a_film_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    def breaks() -> Any:
        yield np.zeros((240, 320, 3), dtype=np.uint8)
        raise RuntimeError("lost power")

    for name in ("a.mp4", "a.gif"):
        if name.endswith("mp4"):
            pytest.importorskip("imageio_ffmpeg")
        with pytest.raises(RuntimeError, match="lost power"):
            encode.write_frames(
                breaks(), tmp_path / name, n_frames=2, size_px=(320, 240), frames_per_second=10
            )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"file": "a.avi"}, "must end in .mp4 or .gif"),
        ({"size_px": (321, 240)}, "must be even"),
        ({"size_px": (320, 20)}, "height"),
        ({"frames_per_second": 0.0}, "frames_per_second"),
    ],
)
def test_films_that_cannot_be_made_are_refused(changes: dict[str, Any], sentence: str) -> None:
    given = {"file": "a.mp4", "size_px": (320, 240), "frames_per_second": 10.0, **changes}
    with pytest.raises(ValueError, match=sentence):
        encode.check_movie(given.pop("file"), **given)
    with pytest.raises(ValueError, match="pace_ps_per_s"):
        MovieSettings(pace_ps_per_s=0.0)


def test_a_missing_encoder_is_said_in_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtraError, match=r"lightflight\[view\].*\.gif"):
        encode.check_movie("a.mp4", size_px=(320, 240), frames_per_second=10)
    encode.check_movie("a.gif", size_px=(320, 240), frames_per_second=10)


def recording(*, reversed_codes: bool) -> Histograms:
    """One pixel lit at delay 2,010 ps, one at 2,510 ps, faint background, 100 codes of 50 ps."""
    counts = np.random.default_rng(2).poisson(1.0, size=(4, 5, 100)).astype(np.uint32)
    for row, col, delay in ((1, 2, 2010.0), (3, 4, 2510.0)):
        counts[row, col, int((5000 - delay if reversed_codes else delay) // 50)] += 900
    counts[0, 0] += 4000  # screams
    return Histograms(
        counts, bin_width_ps=50.0, laser_period_ps=5000.0, reversed_codes=reversed_codes
    )


def clocks_apart(skew_ps: Any) -> TimingCalibration:
    """Nominal codes, each pixel with a delay of its own."""
    nominal = TimingCalibration.nominal(recording(reversed_codes=False))
    return replace(nominal, skew_ps=np.asarray(skew_ps, dtype=float))


@pytest.mark.parametrize("reversed_codes", [False, True])
def test_slices_of_a_recording_follow_the_light(reversed_codes: bool) -> None:
    slices = slices_from_histograms(recording(reversed_codes=reversed_codes))
    assert slices.unit == "ps"
    assert (np.diff(slices.edges) > 0).all()
    assert slices.edges[0] > 1500
    assert slices.edges[-1] < 3000
    for row, col, delay in ((1, 2, 2010.0), (3, 4, 2510.0)):
        k = int(np.searchsorted(slices.edges, delay)) - 1
        assert slices.counts[k, row, col] > 800
        assert slices.counts[:, row, col].argmax() == k


def test_slices_join_codes_and_lose_no_counts() -> None:
    hist = recording(reversed_codes=True)
    one = slices_from_histograms(hist, window=(0.0, 5000.0))
    three = slices_from_histograms(hist, slice_codes=3, window=(0.0, 5000.0))
    np.testing.assert_array_equal(one.counts.sum(axis=0), hist.counts.sum(axis=2))
    np.testing.assert_array_equal(three.counts.sum(axis=0), hist.counts.sum(axis=2))
    np.testing.assert_array_equal(three.counts[0], one.counts[:3].sum(axis=0))
    assert len(three.counts) == 34


def test_clocks_put_the_pixels_of_a_recording_in_time(tmp_path: Path) -> None:
    """One flash for all pixels, whose skews spread over 400 ps: calibrated, one slice holds it."""
    skew = np.linspace(-200.0, 200.0, 20).reshape(4, 5)
    timing = clocks_apart(skew)
    counts = np.zeros((4, 5, 100), dtype=np.uint32)
    rows, cols = np.indices((4, 5))
    counts[rows, cols, ((2025.0 + skew) // 50).astype(int)] = 1000
    hist = Histograms(counts, bin_width_ps=50.0, laser_period_ps=5000.0)
    apart = slices_from_histograms(hist)
    together = slices_from_histograms(hist, timing=timing)
    assert apart.counts.sum(axis=(1, 2)).max() < 5000
    k = int(np.searchsorted(together.edges, 2025.0)) - 1
    assert together.counts[k - 1 : k + 2].sum() == pytest.approx(20_000)
    assert together.counts.sum(axis=0) == pytest.approx(counts.sum(axis=2))
    assert "calibrated" in together.clocks
    assert "nominal" in apart.clocks
    write_recording_movie(hist, tmp_path / "a.gif", timing=timing, size_px=(320, 240))


def test_pixels_without_a_clock_are_left_out_of_the_film() -> None:
    skew = np.zeros((4, 5))
    skew[3, 3] = np.nan
    hist = recording(reversed_codes=False)
    slices = slices_from_histograms(hist, timing=clocks_apart(skew))
    assert {(int(r), int(c)) for r, c in np.argwhere(slices.left_out)} == {(0, 0), (3, 3)}
    assert not slices.counts[:, 3, 3].any()


def test_long_recordings_are_shown_in_longer_slices() -> None:
    counts = np.zeros((2, 2, 4000), dtype=np.uint32)
    counts[:, :, 500:1800] = 100
    hist = Histograms(counts, bin_width_ps=10.0)
    slices = slices_from_histograms(hist)
    assert 120 < len(slices.counts) <= 240
    np.testing.assert_allclose(np.diff(slices.edges)[:-1], 60.0)
    assert len(slices_from_histograms(hist, slice_codes=1).counts) > 1300


def test_the_flight_so_far_stays_in_the_picture() -> None:
    """What came earlier is still seen at the right in the last frame, each light in its colour."""
    slices = slices_from_histograms(recording(reversed_codes=False))
    last = list(recording_frames(slices, size_px=(480, 360)))[-1]
    colors = []
    for row, col in ((1, 2), (3, 4)):
        k = int(slices.counts[:, row, col].argmax())
        part = (k + 0.5) / len(slices.counts)
        colors.append(style.time_colormap()(part)[:3])
    for color in colors:
        there = near_color(last[:, 250:], to_hex(color), tolerance=25)
        assert (there[:, 0] < 250).sum() > 100


def test_a_recording_without_scale_counts_codes() -> None:
    hist = recording(reversed_codes=False)
    bare = Histograms(hist.counts)
    assert slices_from_histograms(bare).unit == "codes"


def test_frames_of_a_recording_show_the_lit_pixel() -> None:
    slices = slices_from_histograms(recording(reversed_codes=False))
    frames = list(recording_frames(slices, size_px=(480, 360)))
    assert len(frames) == len(slices.counts)
    k = int(slices.counts[:, 1, 2].argmax())
    dark = near_color(frames[k], "#084081", tolerance=50)
    other = int(slices.counts[:, 3, 4].argmax())
    dark_other = near_color(frames[other], "#084081", tolerance=50)
    middle = dark[dark[:, 1] < 250][:, 1].mean()
    assert dark_other[dark_other[:, 1] < 250][:, 1].mean() > middle  # row 3 is below row 1


@pytest.mark.parametrize(
    ("make", "sentence", "kind"),
    [
        (lambda h: slices_from_histograms(h, slice_codes=0), "slice_codes", ValueError),
        (lambda h: slices_from_histograms(h, window=(9e5, 9e6)), "holds no code", ValueError),
        (
            lambda h: slices_from_histograms(Histograms(np.zeros((2, 2, 9), dtype=int))),
            "no photons",
            NothingFoundError,
        ),
    ],
)
def test_recordings_that_cannot_be_shown_are_refused(make: Any, sentence: str, kind: Any) -> None:
    with pytest.raises(kind, match=sentence):
        make(recording(reversed_codes=False))


def test_a_recordings_film_plays(tmp_path: Path) -> None:
    from PIL import Image

    file = tmp_path / "recording.gif"
    write_recording_movie(recording(reversed_codes=True), file, size_px=(320, 240))
    film: Any
    with Image.open(file) as film:
        assert film.n_frames > 5

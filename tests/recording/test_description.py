"""description: what a recording is, told right for recordings we know all about."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.recording.description import describe_recording

CLOCK: dict[str, Any] = {"bin_width_ps": 55.0, "laser_period_ps": 50_000.0}


def _frames(rng, *, n=4000, pulse=None, occupancy=0.2, shift=0.0):
    """(n, 8, 8) codes; flat without `pulse`, else Gaussian about it, moving by `shift`."""
    codes = rng.integers(1, 900, (n, 8, 8)).astype(float)
    if pulse is not None:
        signal = rng.random(codes.shape) < 0.7
        moving = pulse + shift * (np.arange(n) >= n // 2)[:, None, None]
        codes = np.where(signal, np.rint(rng.normal(moving, 2.0, codes.shape)), codes)
    fired = rng.random(codes.shape) < occupancy
    return np.where(fired, codes, 0).astype(np.uint16)


def test_a_pulse_is_seen_and_counted(rng):
    frames = _frames(rng, pulse=400)
    frames[:, 0, 0] = 0
    frames[:, 1, 1] = rng.integers(1, 900, len(frames))
    recording = lf.Recording.from_frames(frames, n_codes=1024, no_photon_code=0, **CLOCK)
    found: Any = describe_recording(recording)
    assert found.kind == "frames"
    assert found.photons == np.count_nonzero(frames)
    assert found.occupancy == pytest.approx(0.2, abs=0.02)
    assert (found.n_silent, found.n_screaming, found.n_pulse_pixels) == (1, 1, 62)
    assert found.has_pulse
    assert abs(found.drift_codes) < 5 * found.drift_std_codes
    assert any("set-up file" in sentence for sentence in found.missing)


@pytest.mark.parametrize("seed", range(20))
def test_flat_light_shows_no_pulse(seed):
    """20 x 64 pixels: at six sigma and half above the median none may be taken for a pulse."""
    frames = _frames(np.random.default_rng(seed), n=1500, occupancy=0.5)
    found: Any = describe_recording(
        lf.Recording.from_frames(frames, n_codes=1024, no_photon_code=0)
    )
    assert found.n_pulse_pixels == 0
    assert not found.has_pulse
    assert "No pixel shows a pulse" in found.missing[0]
    assert "give bin_width_ps" in found.missing[1]


def test_drift_is_measured(rng):
    frames = _frames(rng, pulse=400, shift=0.5)
    found: Any = describe_recording(
        lf.Recording.from_frames(frames, n_codes=1024, no_photon_code=0, **CLOCK)
    )
    assert found.drift_codes == pytest.approx(0.5, abs=0.1)
    assert 0.003 < found.drift_std_codes < 0.05
    assert any("Pulses move" in remark for remark in found.remarks)


def test_frames_events_and_histograms_tell_the_same(rng, tmp_path):
    frames = _frames(rng, pulse=300)
    recording = lf.Recording.from_frames(frames, n_codes=1024, no_photon_code=0, **CLOCK)
    lf.write(recording, tmp_path / "x.h5")
    told = [
        describe_recording(record)
        for record in (recording, lf.read(tmp_path / "x.h5"), lf.histogram(recording))
    ]
    assert [one.kind for one in told] == ["frames", "events", "histograms"]
    for name in ("photons", "occupancy", "n_pulse_pixels", "live_codes", "n_screaming"):
        assert len({getattr(one, name) for one in told}) == 1, name
    assert told[0].drift_codes == pytest.approx(told[1].drift_codes)
    assert told[2].drift_codes is None


def test_edge_cases():
    dark = describe_recording(lf.Histograms(np.zeros((2, 2, 4), int)))
    assert dark.live_codes is None
    assert dark.n_silent == 4
    assert "not a single photon" in dark.remarks[0]
    full = np.ones((2, 2, 4), np.uint8)
    full[0, 0, 1] = 255
    assert describe_recording(lf.Histograms(full)).n_saturated == 1
    busy = lf.Histograms(np.full((1, 1, 4), 100), n_frames=1000, periods_per_frame=10)
    assert any("pile-up" in remark for remark in describe_recording(busy).remarks)
    empty = lf.Recording.from_frames(np.zeros((0, 2, 2), np.uint16), n_codes=8)
    assert describe_recording(empty).photons == 0


def test_progress_goes_once_to_the_end(rng):
    seen: list[tuple[int, int]] = []
    recording = lf.Recording.from_frames(_frames(rng, pulse=300), n_codes=1024)
    describe_recording(recording, progress=lambda done, total: seen.append((done, total)))
    assert seen[-1] == (4000, 4000)
    assert seen == sorted(seen)


# --- files of others --------------------------------------------------------------------


def test_a_real_code_density_recording(data_dir):
    found: Any = describe_recording(
        lf.read(data_dir / "pf32-codedensity-20mhz" / "pf32_codedensity_20mhz.npz")
    )
    assert found.n_screaming == 73
    assert found.n_pulse_pixels == 0
    assert not found.has_pulse
    assert 900 < found.live_codes[1] < 940  # the period ends at code 915


def test_real_light_in_flight_shows_a_pulse(data_dir):
    path = data_dir / "lift-fiber" / "lift_derived.h5"
    hist = lf.read(path, dataset="LinearFiber/cube_t_y_x", axes="tyx", poisson=False)
    found: Any = describe_recording(hist)
    assert found.has_pulse
    assert "give bin_width_ps" in found.missing[0]


def test_a_real_lifetime_image_shows_a_pulse(data_dir):
    path = data_dir / "flimera-pixel-skew" / "Coumarin.mat"
    found: Any = describe_recording(lf.read(path, axes="yxt", bin_width_ps=41.1))
    assert found.has_pulse
    assert found.n_pulse_pixels > 0.85 * 128 * 192


def test_bright_pixels_of_a_dark_scene_do_not_scream(rng):
    """The light itself is all there is; one pixel full of darkness does scream."""
    counts = np.zeros((16, 16, 128), int)
    counts[7] = rng.poisson(900 * np.exp(-0.5 * ((np.arange(128) - 60) / 2.0) ** 2) / 5, (16, 128))
    counts[2, 3] = rng.poisson(5.0, 128)
    found = describe_recording(lf.Histograms(counts, bin_width_ps=55.0))
    assert found.n_screaming == 1
    assert found.n_pulse_pixels == 16

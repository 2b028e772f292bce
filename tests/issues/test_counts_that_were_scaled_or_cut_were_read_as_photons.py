"""Counts that a program multiplied, or cut at a largest one, before they were stored.

Three counts for each photon: "times scatter by 11 sigma", and the calibration was to blame. Counts
cut at 255 in a wider type were fitted as they were, and with all bright pixels of a leg gone a
mirror was asked for that nothing shows (an error from the depths of NumPy).
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import SuspectDataWarning
from lightflight.reconstruct.other_light import second_path
from lightflight.recording.description import describe_recording
from lightflight.recording.stored import common_factor, largest_count
from tests.labs import one_leg


@pytest.fixture(scope="module")
def recording():
    lab = one_leg()
    return lab, lab.recording(0, 4000.0)


def _with(hist, counts):
    return replace(hist, counts=counts)


def test_photons_are_told_from_multiples(recording):
    lab, hist = recording
    assert common_factor(hist) == 1
    counts = hist.counts.astype(np.uint32)
    assert common_factor(_with(hist, 6 * counts)) == 6
    # Of few counts chance may be.
    few = np.zeros_like(counts)
    few[0, 0, :40] = 2
    assert common_factor(_with(hist, few)) == 1
    few[:, :, 7] = 4000
    assert common_factor(_with(hist, few)) == 1
    with pytest.raises(ValueError, match=r"multiples of 3: .*; divide counts by 3"):
        lf.reconstruct(_with(hist, 3 * counts), camera=lab.camera, timing=lab.timing)
    with pytest.raises(ValueError, match="multiples of 2"):
        lf.calibrate_timing(flat=_with(hist, 2 * counts))


@pytest.mark.parametrize("photons", [40.0, 4000.0])
def test_what_is_not_cut_thins_out_towards_its_brightest(photons):
    lab = one_leg()
    hist = lab.recording(1, photons)
    limit = np.iinfo(hist.counts.dtype).max
    assert largest_count(hist) == limit
    # Scaled to one largest count each: no pulse is cut.
    counts = hist.counts.astype(float)
    counts *= 200.0 / np.maximum(counts.max(axis=2, keepdims=True), 1.0)
    assert largest_count(_with(hist, np.rint(counts).astype(np.uint16))) == 65535


def test_counts_cut_below_their_type_are_saturated(recording):
    lab, hist = recording
    cut = _with(hist, np.minimum(hist.counts, 50).astype(np.uint16))
    assert largest_count(cut) == 50
    n_cut = int((cut.counts == 50).any(axis=2).sum())
    assert n_cut > 10
    assert describe_recording(cut).n_saturated == n_cut
    with pytest.warns(SuspectDataWarning, match=rf"{n_cut} pixels are saturated .* cut at 50"):
        pulses = lf.fit_pulses(cut, timing=lab.timing)
    assert np.count_nonzero(pulses.flags & 1 << 8) == n_cut


def test_a_path_that_no_pixel_shows_is_in_no_mirror(monkeypatch):
    place = SimpleNamespace(
        points_mm=np.ones((3, 3)), leg=0, beyond=np.ones(3, bool), event_ps=np.zeros(3),
        photons=np.ones(3),
    )  # fmt: skip
    monkeypatch.setattr(second_path, "lit_places", lambda *_, **__: [place])
    camera = lf.Camera.facing_plane((32, 32))
    fit: Any = SimpleNamespace(
        solution=SimpleNamespace(cameras=(camera,), medium=lf.Medium()),
        pictures=[SimpleNamespace(spot_std_px=0.5)],
    )
    whole: Any = SimpleNamespace(view=0, timing=SimpleNamespace(response=None))
    monkeypatch.setattr(second_path, "shape_of", lambda _: None)
    assert second_path.places_of_path(fit, 0, whole, 70.0, source_told=True).n_legs == 0
    place.beyond[0] = False
    assert second_path.places_of_path(fit, 0, whole, 70.0, source_told=True).n_legs == 1

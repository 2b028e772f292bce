"""formats.lightflight_hdf5: our records come back as they were."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError
from lightflight.files.store import load_record
from lightflight.recording.clock_fields import CLOCK_FIELDS
from tests.files.unsealed import unsealed

read: Any = lf.read

CLOCK: dict[str, Any] = {
    "bin_width_ps": 55.0,
    "laser_period_ps": 50_000.0,
    "periods_per_frame": 4000,
    "reversed_codes": True,
    "first_edge_ps": -3.5,
    "no_photon_code": 0,
}
SETTINGS = {"temperature_c": 21.5, "camera": "PF32", "notes": ["a", "b"]}


@dataclass(frozen=True)
class _Clock:
    shape: tuple[int, ...] = (1, 2)
    skew_ps: Any = None


@dataclass(frozen=True)
class _Truth:
    vertices_mm: Any
    vertex_times_ps: Any
    detector: Any
    seed: int = 3


TRUTH = _Truth(np.eye(3), np.array([0.0, 1.0, 2.5]), _Clock(skew_ps=np.array([1.0])))


def _frames(rng, n=300):
    frames = rng.integers(1, 64, (n, 3, 4)).astype(np.uint16)
    return np.where(rng.random(frames.shape) < 0.2, frames, 0).astype(np.uint16)


def _assert_same_clock_and_notes(back, record):
    for name in CLOCK_FIELDS:
        assert getattr(back, name) == getattr(record, name), name
    assert back.settings == SETTINGS
    np.testing.assert_array_equal(back.truth.vertices_mm, TRUTH.vertices_mm)
    np.testing.assert_array_equal(back.truth.vertex_times_ps, TRUTH.vertex_times_ps)
    assert back.truth.seed == 3
    assert back.truth.detector == {"shape": [1, 2], "skew_ps": [1.0]}


@pytest.mark.parametrize("poisson", [True, False])
def test_histograms_come_back(tmp_path, rng, poisson):
    values = rng.poisson(4.0, (3, 4, 64)) if poisson else rng.normal(size=(3, 4, 64))
    hist = lf.Histograms(
        values, **CLOCK, n_frames=500, poisson=poisson, settings=SETTINGS, truth=TRUTH
    )
    lf.write(hist, tmp_path / "h.h5")
    back = read(tmp_path / "h.h5")
    assert isinstance(back, lf.Histograms)
    assert back.counts.dtype == hist.counts.dtype
    assert back.poisson is poisson
    np.testing.assert_array_equal(back.counts, hist.counts)
    _assert_same_clock_and_notes(back, hist)
    lf.write(back, tmp_path / "again.h5")
    _assert_same_clock_and_notes(read(tmp_path / "again.h5"), hist)


def test_frames_become_events_of_four_bytes_and_count_the_same(tmp_path, rng):
    frames = _frames(rng, n=100_000)
    recording = lf.Recording.from_frames(
        frames, n_codes=64, **CLOCK, settings=SETTINGS, truth=TRUTH
    )
    lf.write(recording, tmp_path / "r.h5")
    back = read(tmp_path / "r.h5")
    assert back.kind == "events"
    assert back.n_frames == 100_000
    assert back.n_photons == np.count_nonzero(frames)
    _assert_same_clock_and_notes(back, recording)
    np.testing.assert_array_equal(lf.histogram(back).counts, lf.histogram(recording).counts)
    part: dict[str, Any] = {"frames": (777, 5000)}
    np.testing.assert_array_equal(
        lf.histogram(back, **part).counts, lf.histogram(recording, **part).counts
    )
    size = (tmp_path / "r.h5").stat().st_size
    assert size / back.n_photons < 4.8


def test_every_photon_keeps_its_frame(tmp_path, rng):
    frames = _frames(rng)
    recording = lf.Recording.from_frames(frames, n_codes=64, no_photon_code=0)
    lf.write(recording, tmp_path / "r.h5")
    back = read(tmp_path / "r.h5")
    frame = np.repeat(np.arange(300), np.diff(back.frame_starts).astype(int))
    rebuilt = np.zeros((300, 12), np.uint16)
    rebuilt[frame, np.asarray(back.pixel)] = np.asarray(back.code)
    np.testing.assert_array_equal(rebuilt.reshape(frames.shape), frames)


def test_frames_without_a_no_photon_code_stay_frames(tmp_path, rng):
    frames = _frames(rng)
    footers = rng.integers(0, 256, (300, 16)).astype(np.uint8)
    recording = lf.Recording.from_frames(frames, n_codes=64, footers=footers)
    lf.write(recording, tmp_path / "r.h5")
    back = read(tmp_path / "r.h5")
    assert back.kind == "frames"
    np.testing.assert_array_equal(back.frames, frames)
    np.testing.assert_array_equal(back.footers, footers)
    np.testing.assert_array_equal(lf.histogram(back).counts, lf.histogram(recording).counts)


@pytest.mark.parametrize("shape", [(3, 4), (300, 300)])
def test_events_without_frames_come_back(tmp_path, rng, shape):
    n = 5000
    recording = lf.Recording.from_events(
        rng.integers(0, shape[0], n),
        rng.integers(0, shape[1], n),
        rng.integers(0, 64, n),
        shape=shape,
        n_codes=64,
    )
    lf.write(recording, tmp_path / "r.h5")
    back = read(tmp_path / "r.h5")
    assert back.frame_starts is None
    assert back.n_frames is None
    np.testing.assert_array_equal(back.pixel, recording.pixel)
    np.testing.assert_array_equal(back.code, recording.code)


def test_an_empty_recording_comes_back(tmp_path):
    recording = lf.Recording.from_frames(
        np.zeros((0, 2, 2), np.uint16), n_codes=8, no_photon_code=0
    )
    lf.write(recording, tmp_path / "r.h5")
    back = read(tmp_path / "r.h5")
    assert (back.n_frames, back.n_photons) == (0, 0)
    assert lf.histogram(back).counts.sum() == 0


def test_other_kinds_and_damage_are_refused(tmp_path, rng):
    from lightflight.files.store import save_record

    save_record(tmp_path / "p.h5", kind="path", arrays={}, attributes={})
    with pytest.raises(FileFormatError, match="holds a path, no recording"):
        read(tmp_path / "p.h5")
    save_record(tmp_path / "h.h5", kind="histograms", arrays={}, attributes={})
    with pytest.raises(FileFormatError, match="holds no counts"):
        read(tmp_path / "h.h5")
    save_record(tmp_path / "r.h5", kind="recording", arrays={}, attributes={})
    with pytest.raises(FileFormatError, match="does not tell shape and n_codes"):
        read(tmp_path / "r.h5")
    lf.write(
        lf.Recording.from_frames(_frames(rng), n_codes=64, no_photon_code=0), tmp_path / "r.h5"
    )
    with unsealed(tmp_path / "r.h5") as file:
        file["photons_per_frame"][0] += 1
    with pytest.raises(FileFormatError, match="frame_starts must run from 0"):
        read(tmp_path / "r.h5")


def test_damage_found_while_streaming_names_the_file(tmp_path, rng):
    frames = _frames(rng, n=20_000)
    lf.write(lf.Recording.from_frames(frames, n_codes=64, no_photon_code=0), tmp_path / "r.h5")
    image = bytearray((tmp_path / "r.h5").read_bytes())
    with h5py.File(tmp_path / "r.h5", "r") as file:
        offset = file["code"].id.get_chunk_info(0).byte_offset
    image[offset + 5] ^= 1
    (tmp_path / "bad.h5").write_bytes(image)
    recording = read(tmp_path / "bad.h5")
    with pytest.raises(FileFormatError, match=r"bad\.h5: .*damaged"):
        lf.histogram(recording)


def test_the_file_says_how_it_was_made(tmp_path, rng):
    lf.write(lf.Histograms(np.ones((1, 1, 4), int)), tmp_path / "h.h5")
    assert "lightflight" in load_record(tmp_path / "h.h5", kind="histograms")[1]["provenance"]
    mine = {"command": "lightflight simulate", "seed": 5}
    lf.write(lf.Histograms(np.ones((1, 1, 4), int)), tmp_path / "h.h5", provenance=mine)
    attributes = load_record(tmp_path / "h.h5", kind="histograms")[1]
    assert attributes["provenance"] == mine
    assert json.dumps(attributes)

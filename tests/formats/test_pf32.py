"""formats.pf32_frames and pf32_text: files made byte by byte, and a real camera's."""

from __future__ import annotations

import gzip
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import ConfigError, FileFormatError

read: Any = lf.read


def _frames(rng, n):
    codes = rng.integers(8, 915, (n, 32, 32)).astype(np.uint16)
    return np.where(rng.random(codes.shape) < 0.04, codes, 0).astype(np.uint16)


def _with_footers(frames, rng):
    footers = rng.integers(0, 256, (len(frames), 16)).astype(np.uint8)
    rows = frames.astype("<u2").reshape(len(frames), -1).view(np.uint8)
    return np.hstack([rows, footers]).tobytes(), footers


# --- frames -----------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".bin", ".raw", ".RAW"])
def test_frames_without_footers(tmp_path, rng, suffix):
    frames = _frames(rng, 130)
    path = tmp_path / f"x{suffix}"
    frames.astype("<u2").tofile(path)
    recording = read(path, laser_period_ps=50_000)
    assert (recording.shape, recording.n_frames, recording.n_codes) == ((32, 32), 130, 1024)
    assert (recording.bin_width_ps, recording.reversed_codes) == (55.0, True)
    assert recording.no_photon_code == 0
    assert recording.footers is None
    np.testing.assert_array_equal(recording.frames, frames)
    assert isinstance(recording.frames, np.memmap)
    hist = lf.histogram(recording)
    assert hist.counts.sum() == 130 * 1024
    assert hist.photons.sum() == np.count_nonzero(frames)


def test_frames_with_footers_count_the_same(tmp_path, rng):
    frames = _frames(rng, 131)
    image, footers = _with_footers(frames, rng)
    (tmp_path / "x.bin").write_bytes(image)
    recording = read(tmp_path / "x.bin", laser_period_ps=50_000)
    np.testing.assert_array_equal(recording.frames, frames)
    np.testing.assert_array_equal(recording.footers, footers)
    assert recording.settings["footer_bytes"] == 16
    expected = lf.histogram(lf.Recording.from_frames(frames, n_codes=1024, no_photon_code=0))
    np.testing.assert_array_equal(lf.histogram(recording).counts, expected.counts)


def test_where_the_size_fits_both_the_content_decides(tmp_path, rng):
    """128 frames with footers are as long as 129 without."""
    image, _ = _with_footers(_frames(rng, 128), rng)
    (tmp_path / "x.bin").write_bytes(image)
    assert read(tmp_path / "x.bin").n_frames == 128
    _frames(rng, 129).tofile(tmp_path / "y.bin")
    assert read(tmp_path / "y.bin").n_frames == 129


def test_where_the_content_does_not_decide_the_user_must(tmp_path):
    np.zeros((129, 32, 32), "<u2").tofile(tmp_path / "x.bin")
    with pytest.raises(FileFormatError, match="give footer_bytes=0 or footer_bytes=16"):
        read(tmp_path / "x.bin")
    assert read(tmp_path / "x.bin", footer_bytes=0).n_frames == 129
    assert read(tmp_path / "x.bin", footer_bytes=16).n_frames == 128


def test_without_a_period_there_is_no_time_axis(tmp_path, rng):
    _frames(rng, 3).tofile(tmp_path / "x.bin")
    recording = read(tmp_path / "x.bin")
    assert recording.bin_width_ps is None
    assert recording.reversed_codes is False
    assert any("give laser_period_ps" in note for note in recording.settings["notes"])
    mine = read(tmp_path / "x.bin", laser_period_ps=50_000, bin_width_ps=54.67)
    assert (mine.bin_width_ps, mine.reversed_codes) == (54.67, True)
    forward = read(tmp_path / "x.bin", laser_period_ps=50_000, reversed_codes=False)
    assert forward.reversed_codes is False


def test_a_truncated_file_says_where_the_last_frame_ends(tmp_path, rng):
    image = _frames(rng, 5).tobytes()
    (tmp_path / "x.bin").write_bytes(image[:-7])
    with pytest.raises(FileFormatError, match="no whole number of frames") as caught:
        read(tmp_path / "x.bin", footer_bytes=0)
    assert caught.value.offset == 4 * 2048
    with pytest.raises(FileFormatError, match="2048 bytes or 2064 bytes"):
        read(tmp_path / "x.bin")
    (tmp_path / "x.bin").write_bytes(image[:100])
    with pytest.raises(FileFormatError, match="no whole number of frames"):
        read(tmp_path / "x.bin")


def test_other_shapes_and_bad_hints(tmp_path, rng):
    frames = rng.integers(0, 256, (10, 8, 4)).astype("<u2")
    frames.tofile(tmp_path / "x.raw")
    recording = read(tmp_path / "x.raw", shape=[8, 4], n_codes=256)
    np.testing.assert_array_equal(recording.frames, frames)
    for hints in ({"shape": (0, 4)}, {"shape": "8x4"}, {"footer_bytes": 3}, {"footer_bytes": -2}):
        with pytest.raises(ConfigError, match="hint"):
            read(tmp_path / "x.raw", **hints)


def test_big_endian_or_shifted_frames_are_noticed_when_counted(tmp_path, rng):
    _frames(rng, 5).astype(">u2").tofile(tmp_path / "x.bin")
    with pytest.raises(ValueError, match="check shape, footers and byte order"):
        lf.histogram(read(tmp_path / "x.bin"))


def test_frames_are_written_as_the_camera_writes_them(tmp_path, rng):
    frames = _frames(rng, 20)
    lf.write(lf.Recording.from_frames(frames, n_codes=1024), tmp_path / "x.bin")
    assert (tmp_path / "x.bin").read_bytes() == frames.astype("<u2").tobytes()
    with pytest.raises(ValueError, match="raw files hold dense frames"):
        lf.write(lf.Histograms(np.ones((1, 1, 4), int)), tmp_path / "x.bin")


# --- text -------------------------------------------------------------------------------


def _text(counts, tail="\n20000000\nframes = 0\n"):
    lines = ["Reading histogram data"]
    for pixel, row in enumerate(counts.reshape(-1, counts.shape[-1])):
        lines += [f"Pixel {pixel}", " ".join(map(str, row)) + " "]
    return "\n".join(lines) + "\n" + tail


@pytest.fixture
def counts(rng):
    photons = rng.poisson(5.0, (2, 3, 16))
    photons[..., 0] = 500 - photons[..., 1:].sum(axis=2)
    return photons


@pytest.mark.parametrize("zipped", [False, True])
def test_printed_histograms(tmp_path, counts, zipped):
    image = _text(counts).encode()
    path = tmp_path / ("x.log.gz" if zipped else "x.log")
    path.write_bytes(gzip.compress(image) if zipped else image)
    hist = read(path, shape=(2, 3))
    np.testing.assert_array_equal(hist.counts, counts)
    assert hist.laser_period_ps == 50_000.0
    assert (hist.bin_width_ps, hist.reversed_codes, hist.no_photon_code) == (55.0, True, 0)
    assert hist.n_frames == 500
    assert hist.settings["sync_hz"] == 20_000_000
    assert len(hist.settings["notes"]) == 4


def test_printed_histograms_without_their_end(tmp_path, counts):
    counts[0, 0, 0] += 1
    (tmp_path / "x.dat").write_text(_text(counts, tail=""))
    hist = read(tmp_path / "x.dat", shape=(2, 3))
    assert hist.n_frames is None
    assert hist.laser_period_ps is None
    assert hist.reversed_codes is False


def test_damaged_text_says_where(tmp_path, counts):
    good = _text(counts)
    cases = {
        good[: len(good) // 2]: "pixel 2 has|holds .* pixels of 6|list of counts",
        good.replace("Pixel 3", "Pixel 9"): "pixel 9 follows on pixel 2",
        good.replace("Pixel 5\n", "Pixel 5\nabc "): "after 'Pixel 5' is no list of counts",
        good.replace("Pixel 5\n", "Pixel 5\n-3 "): "after 'Pixel 5' is no list of counts",
        good.replace("Pixel 5\n", "Pixel 5\n7 "): "pixel 5 has 17 codes",
        good + "Pixel 6\n" + "1 " * 16: "more than 6 pixels",
        "Pixel 0\n" + "1" * (1 << 21): "over a million characters",
    }
    for text, message in cases.items():
        (tmp_path / "x.txt").write_text(text)
        with pytest.raises(FileFormatError, match=message):
            read(tmp_path / "x.txt", shape=(2, 3))
    (tmp_path / "x.txt.gz").write_bytes(gzip.compress(good.encode())[:-20])
    with pytest.raises(FileFormatError, match="damaged"):
        read(tmp_path / "x.txt.gz", shape=(2, 3))


# --- a real camera ----------------------------------------------------------------------


def test_a_real_code_density_recording_by_two_ways(data_dir):
    folder = data_dir / "pf32-codedensity-20mhz"
    parsed = read(folder / "pf32_codedensity_20mhz.npz")
    printed = read(folder / "swHistogram_stdout.txt.gz")
    np.testing.assert_array_equal(parsed.counts, printed.counts)
    assert parsed.counts.shape == (32, 32, 1024)
    for hist in (parsed, printed):
        assert hist.n_frames == 50_000
        assert (hist.counts.sum(axis=2) == 50_000).all()
        assert hist.laser_period_ps == pytest.approx(49_999.9, abs=1e-6)
        assert (hist.bin_width_ps, hist.reversed_codes, hist.no_photon_code) == (55.0, True, 0)
    assert parsed.periods_per_frame == 2000
    assert np.count_nonzero(parsed.photons > 30_000) == 73

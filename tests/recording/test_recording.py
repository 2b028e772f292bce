"""recording: frames and events add up to the right cube, whatever the chunks and windows."""

from __future__ import annotations

import subprocess
import sys
import textwrap
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lightflight._kernels import frames as kernels
from lightflight.recording.counting import histogram
from lightflight.recording.histograms import Histograms
from lightflight.recording.recording import Recording

CLOCK = {
    "bin_width_ps": 55.0,
    "laser_period_ps": 50_000.0,
    "reversed_codes": True,
    "no_photon_code": 0,
    "periods_per_frame": 4000,
}


def counts_by_numpy(frames, n_codes):
    """(rows, cols, codes): the plain reference."""
    n_frames, rows, cols = frames.shape
    flat = frames.reshape(n_frames, rows * cols).astype(np.int64)
    cube = np.stack([np.bincount(flat[:, p], minlength=n_codes) for p in range(rows * cols)])
    return cube.reshape(rows, cols, n_codes)


def frames_of_codes(rng, *, n_frames=500, rows=5, cols=7, n_codes=64, occupancy=0.1):
    codes = rng.integers(1, n_codes, (n_frames, rows, cols)).astype(np.uint16)
    return np.where(rng.random(codes.shape) < occupancy, codes, 0).astype(np.uint16)


def events_of(frames, n_codes, **clock):
    frame, row, col = np.nonzero(frames)
    return Recording.from_events(
        row,
        col,
        frames[frame, row, col],
        shape=frames.shape[1:],
        n_codes=n_codes,
        frame=frame,
        n_frames=frames.shape[0],
        **clock,
    )


# --- the cube ---------------------------------------------------------------------------


@pytest.mark.parametrize("occupancy", [0.0, 0.04, 1.0])
@pytest.mark.parametrize("no_photon_code", [0, None])
def test_frames_and_events_equal_bincount(rng, occupancy, no_photon_code):
    frames = frames_of_codes(rng, occupancy=occupancy)
    recording = Recording.from_frames(frames, n_codes=64, no_photon_code=no_photon_code)
    counted = histogram(recording)
    expected = counts_by_numpy(frames, 64)
    np.testing.assert_array_equal(counted.counts, expected)
    assert counted.counts.dtype == np.uint32
    assert counted.n_frames == 500
    events = histogram(events_of(frames, 64, no_photon_code=no_photon_code))
    if no_photon_code is None:
        expected = expected.copy()
        expected[..., 0] = 0  # events know photons only
    np.testing.assert_array_equal(events.counts, expected)


def test_the_clock_is_carried_over(rng):
    frames = frames_of_codes(rng)
    truth = object()
    counted = histogram(
        Recording.from_frames(frames, n_codes=64, truth=truth, settings={"room": "B9"}, **CLOCK)
    )
    for name, value in CLOCK.items():
        assert getattr(counted, name) == value, name
    assert counted.truth is truth
    assert counted.settings == {"room": "B9"}


@given(
    n_frames=st.integers(0, 40),
    chunk_bytes=st.integers(1, 3000),
    seed=st.integers(0, 2**32 - 1),
    as_events=st.booleans(),
    dtype=st.sampled_from([np.uint8, np.uint16]),
)
def test_chunks_do_not_matter(n_frames, chunk_bytes, seed, as_events, dtype):
    frames = frames_of_codes(np.random.default_rng(seed), n_frames=n_frames, rows=3).astype(dtype)
    recording = Recording.from_frames(frames, n_codes=64, no_photon_code=0)
    if as_events:
        recording = events_of(frames, 64, no_photon_code=0)
    counted = histogram(recording, chunk_bytes=chunk_bytes)
    np.testing.assert_array_equal(counted.counts, counts_by_numpy(frames, 64))


def test_frame_ranges_add_up(rng):
    frames = frames_of_codes(rng)
    for recording in (
        Recording.from_frames(frames, n_codes=64, no_photon_code=0),
        events_of(frames, 64, no_photon_code=0),
    ):
        parts = [histogram(recording, frames=pair) for pair in ((0, 123), (123, 124), (124, 500))]
        assert [part.n_frames for part in parts] == [123, 1, 376]
        total = sum(part.counts.astype(int) for part in parts)
        np.testing.assert_array_equal(total, histogram(recording).counts)


@pytest.mark.parametrize("reverse", [False, True])
def test_windows_cut_the_cube_and_keep_the_times(rng, reverse):
    frames = frames_of_codes(rng)
    clock = CLOCK | {"reversed_codes": reverse, "first_edge_ps": 12.5}
    window: dict[str, Any] = {"rows": (1, 4), "cols": (2, 7), "codes": (10, 50)}
    whole = histogram(Recording.from_frames(frames, n_codes=64, **clock))
    for source in (
        Recording.from_frames(frames, n_codes=64, **clock),
        events_of(frames, 64, **clock),
        whole,
    ):
        cut = histogram(source, **window)
        np.testing.assert_array_equal(cut.counts, whole.counts[1:4, 2:7, 10:50])
        assert cut.no_photon_code is None
        assert cut.settings["window_start"] == [1, 2, 10]
        for edges, all_edges in zip(
            cut.code_intervals_ps(), whole.code_intervals_ps(), strict=True
        ):
            np.testing.assert_allclose(edges, all_edges[10:50], rtol=1e-12)


def test_the_no_photon_column_of_a_window_holds_frames_without_a_kept_photon(rng):
    frames = frames_of_codes(rng, occupancy=0.5)
    cut = histogram(
        Recording.from_frames(frames, n_codes=64, no_photon_code=0, bin_width_ps=55.0),
        codes=(0, 20),
    )
    assert cut.no_photon_code == 0
    assert (cut.counts.sum(axis=2) == 500).all()


def test_counts_never_wrap(monkeypatch):
    """The type follows the number of frames: with more than 2**32 of them it is uint64."""

    class Endless:
        shape = (2**32 + 2, 1, 1)
        dtype = np.dtype(np.uint16)

        def __getitem__(self, key):
            return np.zeros((1, 1, 1), np.uint16)

    monkeypatch.setattr(kernels, "add_frames", lambda *args: True)
    counted = histogram(
        Recording.from_frames(Endless(), n_codes=4, no_photon_code=0), chunk_bytes=1 << 40
    )
    assert counted.counts.dtype == np.uint64
    assert counted.counts[0, 0, 0] == 2**32 + 2


def test_progress_ends_at_the_end(rng):
    seen = []
    frames = frames_of_codes(rng)
    histogram(
        Recording.from_frames(frames, n_codes=64),
        progress=lambda done, total: seen.append((done, total)),
        chunk_bytes=10_000,
    )
    assert seen[-1] == (500, 500)
    assert len(seen) > 3
    assert seen == sorted(seen)


# --- kernels ----------------------------------------------------------------------------


def plain_python(kernel: Any) -> Any:
    return kernel.py_func


@pytest.mark.parametrize("n_pixels", [1, 63, 64, 65, 128, 200, 1024])
@pytest.mark.parametrize("occupancy", [0.0, 0.04, 0.5, 1.0])
@pytest.mark.parametrize("absent", [0, 7, 65_535])
def test_photons_are_listed_in_order(rng, n_pixels, occupancy, absent):
    codes = rng.integers(0, 65_536, (13, n_pixels)).astype(np.uint16)
    codes[codes == absent] += np.uint16(1)
    frames = np.where(rng.random(codes.shape) < occupancy, codes, absent).astype(np.uint16)
    room = frames.size + kernels.SPARE
    for dtype in (np.uint16, np.uint32):
        pixels, listed = np.zeros(room, dtype), np.zeros(room, np.uint16)
        per_frame = np.zeros(13, np.uint32)
        n = kernels.list_photons(frames, np.uint16(absent), pixels, listed, per_frame)
        frame, pixel = np.nonzero(frames != absent)
        np.testing.assert_array_equal(pixels[:n], pixel)
        np.testing.assert_array_equal(listed[:n], frames[frame, pixel])
        np.testing.assert_array_equal(per_frame, (frames != absent).sum(axis=1))


def test_adding_photons_equals_its_python_and_numpy(rng):
    pixels = rng.integers(0, 35, 400).astype(np.uint16)
    codes = rng.integers(0, 64, 400).astype(np.uint16)
    expected = np.zeros((35, 64), np.uint32)
    np.add.at(expected, (pixels, codes), 1)
    slot = rng.permutation(35) - 5
    slot[slot < 0] = -1
    for n in (0, 1, 63, 64, 65, 400):  # ahead of the last ones nothing is asked of memory
        counts = np.zeros((35, 64), np.uint32)
        everywhere = np.arange(35)
        assert kernels.add_events(pixels[:n], codes[:n], 64, everywhere, 0, 64, True, counts)
        wanted = np.zeros((35, 64), np.uint32)
        np.add.at(wanted, (pixels[:n], codes[:n]), 1)
        np.testing.assert_array_equal(counts, wanted)
    for run in (lambda kernel: kernel, plain_python):
        kept = np.zeros((30, 40), np.uint32)
        assert run(kernels.add_events)(pixels, codes, 64, slot, 8, 40, False, kept)
        np.testing.assert_array_equal(kept[slot[slot >= 0]], expected[slot >= 0, 8:48])
        frames = codes[:350].reshape(10, 35)
        kept[:] = 0
        run(kernels.add_all_codes)(frames, slot, 8, 40, kept)
        all_codes = counts_by_numpy(frames[:, :, None], 64)[:, 0]
        np.testing.assert_array_equal(kept[slot[slot >= 0]], all_codes[slot >= 0, 8:48])


@pytest.mark.parametrize("shape", [(1, 1), (3, 21), (8, 8), (5, 13), (32, 32), (25, 41), (50, 50)])
@pytest.mark.parametrize("occupancy", [0.0, 0.04, 1.0])
@pytest.mark.parametrize("absent", [0, 7, 23])
def test_frames_of_any_size_equal_numpy(rng, shape, occupancy, absent):
    """Fewer pixels than are looked at together, as many, more; one piece of a frame, or some."""
    codes = rng.integers(0, 24, (31, *shape)).astype(np.uint16)
    frames = np.where(rng.random(codes.shape) < occupancy, codes, absent).astype(np.uint16)
    recording = Recording.from_frames(frames, n_codes=24, no_photon_code=absent)
    expected = counts_by_numpy(frames, 24)
    np.testing.assert_array_equal(histogram(recording).counts, expected)
    rows, cols = (shape[0] // 2, shape[0]), (0, max(1, shape[1] - 1))
    part = histogram(recording, rows=rows, cols=cols, codes=(5, 20)).counts
    wanted = expected[slice(*rows), slice(*cols), 5:20]
    of_photons = np.arange(5, 20) != absent  # the other column counts what the window left out
    np.testing.assert_array_equal(part[..., of_photons], wanted[..., of_photons])


@pytest.mark.parametrize("pixel", [0, 1023, 1024, 1999, 2000, 2024])
@pytest.mark.parametrize("window", [{}, {"codes": (3, 9)}])
def test_a_code_too_large_is_found_anywhere_and_not_counted(rng, pixel, window):
    frames = frames_of_codes(rng, n_frames=3, rows=45, cols=45)
    frames[2, pixel // 45, pixel % 45] = 64
    recording = Recording.from_frames(frames, n_codes=64, no_photon_code=0)
    with pytest.raises(ValueError, match=f"frame 2, pixel .{pixel // 45}, {pixel % 45}. holds"):
        histogram(recording, **window)


@pytest.mark.parametrize("n_codes", [1, 63, 64, 512, 1024, 2048])
def test_rows_that_are_pages_long_are_padded_and_come_out_right(rng, n_codes):
    """1,024 codes of 4 bytes are padded while they are counted; nothing of it must show."""
    frames = rng.integers(0, n_codes, (50, 2, 3)).astype(np.uint16)
    for absent in (None, 0):
        counted = histogram(
            Recording.from_frames(frames, n_codes=n_codes, no_photon_code=absent)
        ).counts
        np.testing.assert_array_equal(counted, counts_by_numpy(frames, n_codes))
        assert counted.flags.c_contiguous
    assert kernels.padded_columns(1024, 4) == 1040
    assert kernels.padded_columns(1000, 4) == 1000


def test_events_of_the_no_photon_code_are_no_photons():
    fields = {"pixel": np.zeros(3, np.uint16), "code": np.array([0, 2, 2], np.uint16)}
    recording = Recording((1, 1), n_codes=4, no_photon_code=0, n_frames=10, **fields)
    np.testing.assert_array_equal(histogram(recording).counts[0, 0], [8, 0, 2, 0])
    recording = Recording((1, 1), n_codes=4, no_photon_code=0, **fields)
    np.testing.assert_array_equal(histogram(recording).counts[0, 0], [0, 0, 2, 0])


# --- memory -----------------------------------------------------------------------------


def test_memory_does_not_grow_with_the_recording(tmp_path):
    """A 400 MB memory map is counted with less than 100 MB above the imports."""
    path = tmp_path / "frames.bin"
    script = f"""
        import resource
        import numpy as np
        from lightflight.recording.counting import histogram
        from lightflight.recording.recording import Recording
        def peak_mb():
            return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        few = np.zeros((4, 32, 32), np.uint16)
        histogram(Recording.from_frames(few, n_codes=1024, no_photon_code=0))
        with open({str(path)!r}, "wb") as file:
            file.truncate(2048 * 200_000)
        before = peak_mb()
        frames = np.memmap({str(path)!r}, np.uint16, "r", shape=(200_000, 32, 32))
        counted = histogram(Recording.from_frames(frames, n_codes=1024, no_photon_code=0))
        assert counted.counts[3, 4, 0] == 200_000
        print(peak_mb() - before)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True
    )
    assert float(done.stdout) < 100


# --- what is refused --------------------------------------------------------------------


def test_a_code_that_cannot_be_says_where_it_is(rng):
    frames = frames_of_codes(rng)
    frames[321, 2, 3] = 60_000
    with pytest.raises(ValueError, match=r"frame 321, pixel \(2, 3\) holds code 60000"):
        histogram(Recording.from_frames(frames, n_codes=64), chunk_bytes=5_000)
    bad = Recording(
        (2, 2),
        n_codes=8,
        pixel=np.array([0, 4], np.uint16),
        code=np.array([1, 1], np.uint16),
    )
    with pytest.raises(ValueError, match="photon 1 is of pixel 4"):
        histogram(bad)


def test_two_photons_in_a_frame_contradict_a_no_photon_code():
    recording = Recording.from_events(
        [0, 0],
        [0, 0],
        [3, 4],
        shape=(1, 1),
        n_codes=8,
        frame=[0, 0],
        n_frames=1,
        no_photon_code=0,
    )
    with pytest.raises(ValueError, match="2 photons in 1 frames"):
        histogram(recording)


@pytest.mark.parametrize(
    ("window", "text"),
    [
        ({"codes": (5, 5)}, "codes = "),
        ({"rows": (0, 6)}, "rows = "),
        ({"cols": (-1, 3)}, "cols = "),
        ({"frames": (0, 501)}, "frames = "),
    ],
)
def test_windows_must_lie_inside(rng, window, text):
    recording = Recording.from_frames(frames_of_codes(rng), n_codes=64)
    with pytest.raises(ValueError, match=text):
        histogram(recording, **window)


def test_frames_cannot_be_chosen_where_they_are_unknown(rng):
    with pytest.raises(ValueError, match="histograms already"):
        histogram(Histograms(np.ones((1, 1, 4), int)), frames=(0, 1))
    events = Recording.from_events([0], [0], [1], shape=(1, 1), n_codes=4)
    with pytest.raises(ValueError, match="do not tell their frames"):
        histogram(events, frames=(0, 1))


_U16 = np.zeros(3, np.uint16)
_FRAMES = np.zeros((3, 2, 2), np.uint16)


@pytest.mark.parametrize(
    ("fields", "error", "text"),
    [
        ({}, ValueError, "give either frames"),
        ({"frames": _FRAMES, "pixel": _U16, "code": _U16}, ValueError, "not both"),
        ({"frames": _FRAMES[0]}, ValueError, "frames must have shape"),
        ({"frames": _FRAMES.astype(float)}, TypeError, "uint16 or uint8"),
        ({"frames": _FRAMES, "n_frames": 4}, ValueError, "there are 3 frames"),
        ({"frames": _FRAMES, "n_codes": 0}, ValueError, "n_codes must be"),
        ({"frames": _FRAMES, "no_photon_code": 8}, ValueError, "no_photon_code = 8"),
        ({"frames": _FRAMES, "reversed_codes": True}, ValueError, "needs laser_period_ps"),
        ({"frames": _FRAMES, "bin_width_ps": -1.0}, ValueError, "bin_width_ps must be positive"),
        ({"pixel": _U16, "code": _U16[:2]}, ValueError, "3 pixels do not match 2 codes"),
        ({"pixel": _U16, "code": _U16.astype(int)}, TypeError, "unsigned"),
        ({"pixel": _U16, "code": _U16, "frame_starts": np.array([0, 2])}, ValueError, "run from"),
    ],
)
def test_recordings_that_do_not_fit_together(fields, error, text):
    with pytest.raises(error, match=text):
        Recording((2, 2), **({"n_codes": 8} | fields))


def test_from_events_checks_every_list():
    good: dict[str, Any] = {"row": [0, 1], "col": [0, 1], "code": [1, 2]}
    for name, values, text in [
        ("row", [0, 2], "row must be 0 ... 1"),
        ("col", [-1, 0], "col must be 0 ... 1"),
        ("code", [1, 8], "code must be 0 ... 7"),
        ("code", [1], "of one length"),
    ]:
        with pytest.raises(ValueError, match=text):
            Recording.from_events(**(good | {name: values}), shape=(2, 2), n_codes=8)
    with pytest.raises(TypeError, match="row must hold integers"):
        Recording.from_events([0.5], [0], [1], shape=(2, 2), n_codes=8)
    with pytest.raises(ValueError, match="frame needs n_frames"):
        Recording.from_events(**good, shape=(2, 2), n_codes=8, frame=[0, 1])


def test_the_cube_is_not_copied():
    """A megapixel cube fits into memory once, not twice."""
    counted = histogram(Recording.from_frames(_FRAMES, n_codes=8))
    assert counted.counts.flags.owndata
    assert not counted.counts.flags.writeable
    assert counted.counts is Histograms(counted.counts).counts

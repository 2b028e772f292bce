"""batch.work, pieces, tiles, window: one recording, whole or shared out, in this process."""

from __future__ import annotations

import errno
import os
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lightflight as lf
from lightflight.batch import pieces, tiles, work
from lightflight.batch.campaign import campaign_from_toml
from lightflight.batch.job import Job, JobError, Shares, finished_path, jobs_from_campaign, task
from lightflight.batch.window import TimingWindow
from lightflight.errors import CalibrationError, FileFormatError
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.code_clock import CodeClock
from tests.batch.conftest import recording_at

RNG = np.random.default_rng(7)


@pytest.fixture
def job(campaign_folder, tmp_path) -> Job:
    campaign = campaign_from_toml(campaign_folder / "campaign.toml", output=tmp_path / "out")
    return jobs_from_campaign(campaign)[0]


@pytest.fixture(scope="module")
def whole(campaign_folder, tmp_path_factory) -> lf.LightPath:
    """The path of the job's recording, neither in pieces nor in tiles."""
    output = tmp_path_factory.mktemp("whole")
    campaign = campaign_from_toml(campaign_folder / "campaign.toml", output=output)
    return whole_path(jobs_from_campaign(campaign)[0])


def whole_path(job: Job) -> lf.LightPath:
    assert work.begin(replace(job, piece_bytes=1e12, tile_bytes=1e12)) is None
    return lf.LightPath.load(job.target)


def in_tiles(job: Job, shares: Shares) -> lf.LightPath:
    sorted_pieces = [tiles.sort_piece(job, k, shares.n_pieces) for k in range(shares.n_pieces)]
    fitted = [tiles.fit_pulses_of_tile(job, k, *sorted_pieces) for k in range(shares.n_tiles)]
    tiles.finish_tiles(job, sorted_pieces, fitted)
    return lf.LightPath.load(job.target)


def test_a_job_goes_through_pickle(job):
    again = pickle.loads(pickle.dumps(job))
    assert again.key == job.key
    np.testing.assert_array_equal(
        again.lab.camera.world_from_camera, job.lab.camera.world_from_camera
    )


def test_a_path_says_what_made_it(job):
    path = whole_path(job)
    assert path.provenance["campaign_key"] == job.key
    assert path.provenance["inputs"][0]["name"] == Path(job.recording).name
    assert path.provenance["warnings"][0].startswith("no timing calibration")
    assert finished_path(job) is not None


def test_a_result_of_another_set_up_or_recording_is_not_taken_up(job, campaign_folder, tmp_path):
    whole_path(job)
    file = campaign_folder / "campaign.toml"
    other = campaign_from_toml(
        file, output=tmp_path / "out", assignments=["source.pulse_fwhm_ps=70"]
    )
    assert finished_path(jobs_from_campaign(other)[0]) is None
    status = Path(job.recording).stat()
    try:
        os.utime(job.recording, ns=(status.st_atime_ns, status.st_mtime_ns + 1))
        same = campaign_from_toml(file, output=tmp_path / "out")
        assert finished_path(jobs_from_campaign(same)[0]) is None
    finally:
        os.utime(job.recording, ns=(status.st_atime_ns, status.st_mtime_ns))


def recordings() -> dict[str, lf.Recording]:
    """One of each kind that pieces may be of."""
    frames = np.where(RNG.random((50, 4, 5)) < 0.3, RNG.integers(0, 16, (50, 4, 5)), 0)
    dense = lf.Recording.from_frames(frames.astype(np.uint16), n_codes=16, no_photon_code=0)
    n = 400
    row, col, code = (RNG.integers(0, end, n) for end in (4, 5, 16))
    loose = lf.Recording.from_events(row, col, code, shape=(4, 5), n_codes=16)
    frame = np.repeat(np.arange(50), 8)
    framed = lf.Recording.from_events(
        row, col, code, shape=(4, 5), n_codes=16, frame=frame, n_frames=50
    )
    return {
        "frames": dense,
        "every code": replace(dense, no_photon_code=None),
        "events": loose,
        "events in frames": framed,
        "events, frames told": replace(loose, n_frames=9000, no_photon_code=3),
    }


@pytest.mark.parametrize("codes", [None, (3, 11)])
@pytest.mark.parametrize("kind", list(recordings()))
@pytest.mark.parametrize("piece_bytes", [97, 700, 1e9])
def test_pieces_add_up_to_the_whole(kind, codes, piece_bytes):
    recording = recordings()[kind]
    n = pieces.n_pieces_of(recording, piece_bytes)
    assert (n > 1) == (piece_bytes < 1e9)
    total = np.zeros((4, 5, 16 if codes is None else 8), np.uint64)
    for k in range(n):
        part, options = pieces.piece_of(recording, k, n)
        total += lf.histogram(part, codes=codes, **options).counts
    found = pieces.histograms_from_sum(recording, total, codes)
    whole = lf.histogram(recording, codes=codes)
    np.testing.assert_array_equal(found.counts, whole.counts)
    assert found.counts.dtype == whole.counts.dtype
    for name in ("n_frames", "first_edge_ps", "no_photon_code", "settings"):
        assert getattr(found, name) == getattr(whole, name), name


def test_the_path_does_not_depend_on_the_pieces(job, whole):
    small = replace(job, piece_bytes=1500)
    shares = work.begin(small)
    assert isinstance(shares, Shares)
    assert shares.n_pieces > pieces.BRANCHES
    assert shares.n_tiles == 0
    files = [pieces.count_piece(small, k, shares.n_pieces) for k in range(shares.n_pieces)]
    sums = [pieces.add_up(small, *files[k : k + 8]) for k in range(0, len(files), 8)]
    pieces.finish_pieces(small, pieces.add_up(small, *sums))
    again = lf.LightPath.load(job.target)
    np.testing.assert_array_equal(again.vertices_mm, whole.vertices_mm)
    np.testing.assert_array_equal(again.covariance, whole.covariance)
    assert not Path(job.parts).exists()


def test_a_piece_that_was_counted_is_not_counted_again(job, monkeypatch):
    file = pieces.count_piece(job, 0, 3)
    before = Path(file).stat().st_mtime_ns
    monkeypatch.setattr(pieces, "recording_of", lambda *_: pytest.fail("counted again"))
    assert pieces.count_piece(job, 0, 3) == file
    assert Path(file).stat().st_mtime_ns == before


def test_the_path_does_not_depend_on_the_tiles(job, whole):
    """One typical width per tile instead of one for the camera: nothing else may differ."""
    small = replace(job, tile_bytes=5 * 16 * 128 * 4, piece_bytes=9000)
    shares = work.begin(small)
    assert shares == Shares(n_pieces=2, n_tiles=4)
    tiled = in_tiles(small, shares)
    np.testing.assert_allclose(tiled.vertices_mm, whole.vertices_mm, atol=1e-6)
    np.testing.assert_allclose(tiled.vertex_std, whole.vertex_std, rtol=1e-6, atol=1e-12)
    assert tiled.goodness.n_pulses == whole.goodness.n_pulses
    assert not Path(job.parts).exists()


def test_photons_are_sorted_in_pieces_that_fit_into_memory(job, monkeypatch):
    """However long a piece may be that is merely counted."""
    monkeypatch.setattr(tiles, "PIECE_BYTES", 5000)
    n_bytes = pieces.bytes_of(lf.read(job.recording))
    shares = work.begin(replace(job, tile_bytes=5 * 16 * 128 * 4, piece_bytes=1e9))
    assert shares == Shares(n_pieces=-(-n_bytes // 5000), n_tiles=4)


def test_a_window_of_codes_moves_no_time(job, whole):
    small = replace(job, codes=(20, 110), tile_bytes=5 * 16 * 90 * 4)
    shares = work.begin(small)
    assert isinstance(shares, Shares)
    tiled = in_tiles(small, shares)
    # Fewer codes of background: the same photons in the pulses
    np.testing.assert_allclose(tiled.vertices_mm, whole.vertices_mm, atol=0.2)
    assert work.begin(replace(job, codes=(20, 110))) is None
    cut = lf.LightPath.load(job.target)
    np.testing.assert_allclose(tiled.vertices_mm, cut.vertices_mm, atol=1e-6)


@pytest.mark.usefixtures("unexamined")  # its doubts would have both paths fitted anew
def test_tiles_with_a_calibration_equal_the_whole(job, tmp_path, rng):
    hist = lf.histogram(lf.read(job.recording))
    nominal = TimingCalibration.nominal(hist, assumed_skew_std_ps=2.0)
    skewed = replace(
        nominal,
        skew_ps=rng.normal(0, 3, hist.shape),
        skew_std_ps=np.full(hist.shape, 3.0),
        gain=1.0 + rng.normal(0, 1e-4, hist.shape),
    )
    skewed.save(tmp_path / "timing.h5")
    job = replace(job, timing=str(tmp_path / "timing.h5"))
    whole = whole_path(job)
    small = replace(job, tile_bytes=3 * 16 * 128 * 4)
    shares = work.begin(small)
    assert isinstance(shares, Shares)
    np.testing.assert_allclose(in_tiles(small, shares).vertices_mm, whole.vertices_mm, atol=1e-6)


@pytest.mark.usefixtures("unexamined")
@pytest.mark.filterwarnings("ignore:the background holds pulses")
def test_tiles_without_the_pulses_of_a_background_equal_the_whole(job, tmp_path, rng):
    """A leak of 50 photons in each pixel; faint light that only more pixels show there is none."""
    flight = lf.read(job.recording)
    pixels = np.repeat(np.arange(256, dtype=flight.pixel.dtype), 50)
    for name, seen in (("recording", flight), ("background", None)):
        codes = np.clip(np.rint(rng.normal(30.0, 1.5, len(pixels))), 0, 127)
        pixel, code = pixels, codes.astype(flight.code.dtype)
        if seen is not None:
            pixel, code = np.append(seen.pixel, pixel), np.append(seen.code, code)
        leaky = replace(flight, pixel=pixel, code=code, n_frames=10**6, frame_starts=None)
        lf.write(leaky, tmp_path / f"{name}.h5")
    job = replace(
        job, recording=str(tmp_path / "recording.h5"), background=str(tmp_path / "background.h5")
    )
    whole = whole_path(job)
    small = replace(job, tile_bytes=3 * 16 * 128 * 4)
    shares = work.begin(small)
    assert isinstance(shares, Shares)
    tiled = in_tiles(small, shares)
    np.testing.assert_allclose(tiled.vertices_mm, whole.vertices_mm, atol=0.05)
    assert abs(tiled.goodness.n_pulses - whole.goodness.n_pulses) <= 2


def test_a_window_of_the_clock_answers_for_its_pixels_and_codes(rng):
    hist = lf.Histograms(
        rng.integers(0, 9, (4, 3, 20)), bin_width_ps=50.0, laser_period_ps=1000.0,
        reversed_codes=True, no_photon_code=0,
    )  # fmt: skip
    timing = replace(
        TimingCalibration.nominal(hist),
        gain=1.0 + rng.normal(0, 0.01, (4, 3)),
        skew_ps=rng.normal(0, 5, (4, 3)),
        skew_std_ps=rng.uniform(1, 2, (4, 3)),
    )
    window = TimingWindow.of(timing, rows=(1, 3), codes=(4, 15))
    clocks: list[CodeClock] = [timing, window]  # a check of types: mypy fails where one lacks
    assert [clock.phases.shape for clock in clocks] == [(4, 3, 1), (2, 3, 1)]
    rows, cols = np.array([0, 1]), np.array([2, 0])
    for ours, theirs in zip(
        window.code_intervals_ps(rows, cols),
        timing.code_intervals_ps(rows + 1, cols),
        strict=True,
    ):
        np.testing.assert_array_equal(ours, theirs[:, 4:15])
    errors_ps = window.arrival_errors_ps(rows, cols, np.full(2, 300.0))[0]
    wanted_ps = timing.arrival_errors_ps(rows + 1, cols, np.full(2, 300.0))[0]
    np.testing.assert_array_equal(errors_ps, wanted_ps)
    np.testing.assert_array_equal(window.skew_ps, timing.skew_ps[1:3])
    assert (window.shape, window.n_codes, window.no_photon_code) == ((2, 3), 11, None)
    window.check_matches(lf.histogram(hist, rows=(1, 3), codes=(4, 15)))
    with pytest.raises(CalibrationError, match="not of the same camera"):
        window.check_matches(lf.histogram(hist, rows=(1, 3), codes=(5, 16)))
    with pytest.raises(CalibrationError, match="beyond the calibration"):
        TimingWindow.of(timing, codes=(4, 21))


def test_other_methods_do_not_work_in_tiles(job):
    lab = replace(job.lab, reconstruct={"method": "photon"})
    with pytest.raises(JobError, match="'photon' does not work in tiles"):
        work.begin(replace(job, lab=lab, tile_bytes=1000))


@pytest.mark.parametrize(
    ("error", "reason", "ends_run"),
    [
        (FileFormatError("is empty", path="/data/x.h5"), "is empty", False),
        (OSError(errno.ENOSPC, "No space left on device", "/out/p.h5"), "/out/p.h5: No spa", True),
        (OSError(errno.EFBIG, "File too large", "/out/p.h5"), "File too large", True),
        (PermissionError(errno.EACCES, "Permission denied", "/out"), "Permission denied", False),
        (MemoryError(), "not enough memory", False),
        (ZeroDivisionError("x"), "internal error, ZeroDivisionError: x", False),
    ],
)
def test_reasons(job, error, reason, ends_run):
    @task
    def fails(job: Job) -> None:
        raise error

    with pytest.raises(JobError) as caught:
        fails(replace(job, recording="/data/x.h5", label="x.h5"))
    assert reason in str(caught.value)
    assert "/data/" not in str(caught.value)
    assert caught.value.ends_run is ends_run
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.reason, again.ends_run) == (caught.value.reason, ends_run)


def test_a_photon_that_cannot_be_is_refused_in_tiles(job, tmp_path):
    recording = recording_at(0, seed=1)
    pixel = np.array(recording.pixel)
    pixel[5] = 999
    lf.write(replace(recording, pixel=pixel), tmp_path / "bad.h5")
    bad = replace(job, recording=str(tmp_path / "bad.h5"), label="bad.h5", tile_bytes=9000)
    with pytest.raises(JobError, match="pixel 999"):
        tiles.sort_piece(bad, 0, 1)

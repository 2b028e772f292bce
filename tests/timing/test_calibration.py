"""The clock: edges, errors, refusals, and files."""

import pickle
from dataclasses import fields, replace

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags
from lightflight.errors import CalibrationError, FileFormatError, UncalibratedWarning
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.clock.calibration import TimingCalibration
from lightflight.timing.clock.code_edges import phase_lever
from tests.clock_fakes import PERIOD_PS, fake_clock


def _every_pixel(shape):
    return [grid.ravel() for grid in np.indices(shape)]


@pytest.fixture(scope="module")
def calibrated():
    """One array, calibrated from code density and a flat at 2 ns, and its truth."""
    rng = np.random.default_rng(11)
    clock = fake_clock(rng, (8, 8))
    flat = clock.pulse(rng, 2000.0, 4e5)
    timing = calibrate_timing(
        clock.uniform(rng, 4e6), flat=flat, flat_arrival_ps=2000.0, dead_codes="absorbed"
    )
    return clock, timing


@pytest.mark.parametrize("reversed_codes", [True, False])
@pytest.mark.parametrize("first_edge_ps", [0.0, 120.0])
def test_nominal_clock_has_the_nominal_codes(reversed_codes, first_edge_ps):
    hist = lf.Histograms(
        np.zeros((2, 3, 210), int), bin_width_ps=55.0, laser_period_ps=12_000.0,
        reversed_codes=reversed_codes, first_edge_ps=first_edge_ps, no_photon_code=0,
    )  # fmt: skip
    timing = TimingCalibration.nominal(hist)
    timing.check_matches(hist)
    lower, upper = timing.code_intervals_ps([0, 1], [2, 0])
    want = hist.code_intervals_ps()
    np.testing.assert_allclose(lower, np.stack([want[0]] * 2), atol=1e-9)
    np.testing.assert_allclose(upper, np.stack([want[1]] * 2), atol=1e-9)


def test_nominal_clock_of_unknown_width_counts_in_codes():
    hist = lf.Histograms(np.zeros((1, 1, 10), int))
    timing = TimingCalibration.nominal(hist)
    timing.check_matches(hist)
    np.testing.assert_array_equal(timing.code_intervals_ps([0], [0])[0][0], np.arange(10.0))
    assert "codes" in timing.notes[-1]


@pytest.mark.parametrize("reversed_codes", [True, False])
@pytest.mark.parametrize("dead_codes", ["absorbed", "lost"])
def test_intervals_are_the_true_ones(rng, reversed_codes, dead_codes):
    clock = fake_clock(rng, (6, 6), lost=dead_codes == "lost", reversed_codes=reversed_codes)
    with pytest.warns(UncalibratedWarning, match="no flat recording"):
        timing = calibrate_timing(clock.uniform(rng, 4e6), dead_codes=dead_codes)
    lower, upper = timing.code_intervals_ps(*_every_pixel((6, 6)))
    assert (lower <= upper).all()
    live = np.arange(8, 880)
    # gain 3e-5 of 50 ns, phases 0.15 % of some codes, first live code 3 % of one
    assert np.abs(lower - clock.lower)[:, live].max() < 8.0
    assert np.abs(upper - clock.upper)[:, live].std() < 1.0
    assert (upper == lower)[:, :8].all()
    assert (upper == lower)[:, 960:].all()
    widths = np.abs(np.diff(lower[:, live]))
    assert widths.min() > 0.7 * 55


def test_dead_codes_unknown_is_a_shared_error_that_covers_both(rng):
    clock = fake_clock(rng, (6, 6), lost=True)
    recording = clock.uniform(rng, 1e6)
    flat = clock.pulse(rng, 2000.0, 1e5)
    results = {
        dead: calibrate_timing(recording, flat=flat, flat_arrival_ps=2000.0, dead_codes=dead)
        for dead in ("absorbed", "lost", None)
    }
    widths = {dead: timing.bin_width_ps for dead, timing in results.items()}
    unknown = results[None]
    half = 0.5 * (widths["absorbed"] - widths["lost"])
    assert unknown.bin_width_ps == pytest.approx(0.5 * (widths["absorbed"] + widths["lost"]))
    assert unknown.scale_std * unknown.bin_width_ps == pytest.approx(half, rel=0.01)
    assert "absorbed" in unknown.notes[0]
    assert "lost" in unknown.notes[0]
    assert f"{widths['lost']:.2f} ps if it is lost" in unknown.notes[0]
    rows, cols = _every_pixel((6, 6))
    _, modes, names = unknown.arrival_errors_ps(rows, cols, np.full(36, 12_000.0))
    assert names == ("clock scale",)
    distance = 12_000.0 - unknown.anchor_delay_ps.ravel()
    np.testing.assert_allclose(modes[:, 0], unknown.scale_std * distance)
    assert results["lost"].arrival_errors_ps(rows, cols, np.zeros(36))[1].shape == (36, 0)


def test_errors_vanish_but_for_the_photons_where_the_flat_sat(calibrated):
    _, timing = calibrated
    rows, cols = _every_pixel(timing.shape)
    anchor = timing.anchor_delay_ps.ravel()
    std, _, _ = timing.arrival_errors_ps(rows, cols, anchor)
    np.testing.assert_allclose(std, timing.skew_std_ps.ravel(), rtol=1e-9)
    farther = [timing.arrival_errors_ps(rows, cols, anchor + d)[0].mean() for d in (1e3, 1e4, 4e4)]
    assert farther[0] < farther[1] < farther[2] < 2.0


def test_whole_periods_change_no_error(calibrated):
    _, timing = calibrated
    rows, cols = _every_pixel(timing.shape)
    delay = np.linspace(10.0, PERIOD_PS - 10.0, len(rows))
    once = timing.arrival_errors_ps(rows, cols, delay)[0]
    np.testing.assert_allclose(once, timing.arrival_errors_ps(rows, cols, delay - PERIOD_PS)[0])


def test_error_does_not_fold_to_the_short_way_round(calibrated):
    # codes 100 ps before the end and 100 ps after the start of a period are 49.8 ns apart
    _, timing = calibrated
    near = replace(timing, anchor_delay_ps=np.full(timing.shape, 100.0))
    std, _, _ = near.arrival_errors_ps([0], [0], [PERIOD_PS - 100.0])
    assert std[0] > 0.9 * timing.gain_std[0, 0] / timing.gain[0, 0] * (PERIOD_PS - 200.0)


def test_nan_delay_gives_nan_error(calibrated):
    _, timing = calibrated
    assert np.isnan(timing.arrival_errors_ps([0], [0], [np.nan])[0]).all()


def test_phase_lever_is_the_derivative_of_a_pulse_mean(rng):
    # the mean time of a pulse, by brute force, when one phase is 1 % wider and the rest narrower
    n, width = 8, 1.3
    for place in (3.2, 100.9):
        lever = phase_lever(np.array([place]), np.array([width]), n)[0]
        u = np.linspace(place - 8.0, place + 8.0, 400_001)
        weight = np.exp(-0.5 * ((u - place) / width) ** 2)
        for j in range(n):
            below = np.floor((u - j) / n) + np.clip(np.mod(u - j, n), 0.0, 1.0) + (j > 0) * 0.0
            moved = below - u / n
            mean = np.sum(moved * weight) / weight.sum()
            period = np.linspace(place, place + n, 80_001)[:-1]
            whole = np.floor((period - j) / n) + np.clip(np.mod(period - j, n), 0.0, 1.0)
            assert lever[j] == pytest.approx(mean - np.mean(whole - period / n), abs=2e-4)


def test_one_part_alone_warns_of_what_it_costs(rng):
    clock = fake_clock(rng, (4, 4))
    with pytest.warns(UncalibratedWarning, match="delays of the pixels are taken as equal"):
        timing = calibrate_timing(clock.uniform(rng, 1e5), assumed_skew_std_ps=170.0)
    assert (timing.skew_std_ps == 170.0).all()
    assert (timing.flags & flags.UNCALIBRATED != 0).all()
    with pytest.warns(UncalibratedWarning, match="no code-density recording.*3-6 ps"):
        timing = calibrate_timing(flat=clock.pulse(rng, 2000.0, 1e5))
    assert timing.bin_width_ps == 55.0
    assert timing.gain_std.min() > 0.005
    # widths are as unequal as the drawn ones: 5.8 % shared and 3 % own, seen through 12 codes
    assert 0.03 < timing.phase_std.mean() < 0.1
    assert (timing.flags & flags.UNCALIBRATED != 0).all()
    assert flags.is_usable(timing.flags).all()


def test_nothing_given_is_refused():
    with pytest.raises(ValueError, match="nothing to calibrate from"):
        lf.calibrate_timing()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dead_codes": "gone"}, "dead_codes must be"),
        ({"assumed_skew_std_ps": -1.0}, "assumed_skew_std_ps must be"),
        ({"flat_arrival_ps": np.zeros((3, 3))}, "flat_arrival_ps must be a number or have shape"),
        ({"flat_arrival_ps": np.nan}, "flat_arrival_ps must be finite"),
    ],
)
def test_wrong_options_are_refused(rng, options, message):
    clock = fake_clock(rng, (4, 4))
    recordings = {"flat": clock.pulse(rng, 2000.0, 1e4)}
    with pytest.raises(ValueError, match=message):
        calibrate_timing(clock.uniform(rng, 1e5), **(recordings | options))


def test_recordings_of_two_cameras_are_refused(rng):
    with pytest.raises(CalibrationError, match="different cameras"):
        calibrate_timing(
            fake_clock(rng, (4, 4)).uniform(rng, 1e5),
            flat=fake_clock(rng, (4, 5)).pulse(rng, 2000.0, 1e4),
        )


def test_raw_arrays_and_intensities_are_refused(rng):
    with pytest.raises(TypeError, match="code_density must be Histograms, got ndarray"):
        calibrate_timing(np.zeros((2, 2, 10)))
    scaled = lf.Histograms(np.full((2, 2, 100), 0.5), bin_width_ps=10.0, poisson=False)
    with pytest.raises(CalibrationError, match="scaled intensities"):
        calibrate_timing(scaled)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"laser_period_ps": 25_000.0}, "laser_period_ps"),
        ({"reversed_codes": False}, "reversed_codes"),
        ({"no_photon_code": None}, "no_photon_code"),
        ({"bin_width_ps": 41.0}, "bin_width_ps"),
        ({"first_edge_ps": 500.0}, "first_edge_ps"),
        ({"counts": np.zeros((8, 8, 512), int)}, "n_codes"),
        ({"counts": np.zeros((8, 7, 1024), int)}, "shape"),
    ],
)
def test_calibration_of_another_camera_is_refused(calibrated, change, name):
    _, timing = calibrated
    same = {
        "counts": np.zeros((8, 8, 1024), int), "bin_width_ps": 55.0, "laser_period_ps": PERIOD_PS,
        "reversed_codes": True, "no_photon_code": 0,
    }  # fmt: skip
    timing.check_matches(lf.Histograms(**same))
    with pytest.raises(CalibrationError, match=f"has {name} ="):
        timing.check_matches(lf.Histograms(**(same | change)))


def test_codes_that_show_no_end_keep_the_nominal_width(rng):
    clock = fake_clock(rng, (6, 6), n_codes=800, first_live=0, start=(), gain_std=0.0)
    with pytest.warns(UncalibratedWarning) as caught:
        timing = calibrate_timing(clock.uniform(rng, 1e5))
    assert "show no end of the laser period" in str(caught[0].message)
    assert caught[0].filename == __file__
    assert timing.bin_width_ps == 55.0
    assert (timing.gain_std == 0.0065).all()
    lower, upper = timing.code_intervals_ps([0], [0])
    np.testing.assert_allclose((upper - lower)[0].mean(), 55.0, rtol=1e-3)


def test_one_sweep_without_a_period_keeps_its_codes(rng):
    clock = fake_clock(rng, (4, 4), reversed_codes=False, first_live=0, start=(), n_codes=600)
    density = clock.uniform(rng, 1e5, laser_period_ps=None, no_photon_code=None)
    with pytest.warns(UncalibratedWarning) as caught:
        timing = calibrate_timing(density)
    assert len(caught) == 2
    assert timing.laser_period_ps is None
    assert timing.n_phases == 8
    lower, upper = timing.code_intervals_ps([0], [0])
    assert lower[0, 0] == 0.0
    assert upper[0, -1] == pytest.approx(600 * 55.0, rel=1e-3)
    std, modes, _ = timing.arrival_errors_ps([0], [0], [1000.0])
    assert np.isfinite(std).all()
    assert modes.shape == (1, 1)


def test_dark_recording_flags_what_screams(rng):
    clock = fake_clock(rng, (6, 6))
    photons = np.full(36, 300.0)
    photons[7] = 45_000.0
    dark = clock.uniform(rng, photons, n_frames=50_000)
    with pytest.warns(UncalibratedWarning):
        timing = calibrate_timing(clock.uniform(rng, 1e5), dark=dark)
    screaming = (timing.flags & flags.SCREAMING).ravel()
    assert np.flatnonzero(screaming).tolist() == [7]


def test_file_gives_back_every_field(calibrated, tmp_path):
    _, timing = calibrated
    path = tmp_path / "clock.h5"
    timing.save(path)
    again = TimingCalibration.load(path)
    for item in fields(TimingCalibration):
        before, after = getattr(timing, item.name), getattr(again, item.name)
        np.testing.assert_array_equal(before, after, err_msg=item.name)
        assert type(before) is type(after), item.name


def test_file_of_another_kind_is_refused(tmp_path, calibrated):
    from lightflight.files.store import save_record

    save_record(tmp_path / "p.h5", kind="pulses", arrays={"a": np.zeros(2)}, attributes={})
    with pytest.raises(FileFormatError):
        TimingCalibration.load(tmp_path / "p.h5")
    save_record(
        tmp_path / "c.h5", kind="calibration", arrays={"gain": np.ones((2, 2))},
        attributes={"calibration_schema": 99},
    )  # fmt: skip
    with pytest.raises(FileFormatError, match="schema 99 is unknown"):
        TimingCalibration.load(tmp_path / "c.h5")


def test_arrays_are_read_only_and_checked(calibrated):
    _, timing = calibrated
    with pytest.raises(ValueError, match="read-only"):
        timing.gain[0, 0] = 2.0
    with pytest.raises(ValueError, match="gain must have shape"):
        replace(timing, gain=np.ones((2, 2)))
    with pytest.raises(ValueError, match="is not in a camera of"):
        timing.code_intervals_ps([8], [0])


def test_description_says_what_was_found(calibrated):
    _, timing = calibrated
    text = timing.describe()
    assert text.startswith("8 x 8 pixels (64 usable) of 1024 codes, 55.")
    assert "code widths repeat every 8 codes" in text
    assert text.endswith("flagged: none")


def test_notes_say_how_long_a_good_recording_takes(rng):
    clock = fake_clock(rng, (4, 4))
    # 100,000 frames of 4,000 periods of 50 ns: 20 s for 40,000 photons
    density = clock.uniform(rng, 40_000, n_frames=100_000, periods_per_frame=4000)
    with pytest.warns(UncalibratedWarning):
        notes = calibrate_timing(density).notes
    said = [note for note in notes if note.startswith("recorded in 20 s")]
    assert said == ["recorded in 20 s; 4 million photons per pixel take 33 min at this rate"]


def test_kept_edges_are_nobodys_to_change(calibrated, monkeypatch):
    """Worked out each time or kept: the same edges, in arrays of the caller's own."""
    _, timing = calibrated
    rows, cols = [3, 0, 7], [1, 5, 7]
    kept = timing.code_intervals_ps(rows, cols)
    for edges in timing.code_intervals_ps(rows, cols):
        edges[:] = np.nan
    monkeypatch.setattr("lightflight.timing.clock.calibration._KEPT_CODES", 0)
    anew = replace(timing).code_intervals_ps(rows, cols)
    np.testing.assert_array_equal(kept, anew)
    np.testing.assert_array_equal(timing.code_intervals_ps(rows, cols), anew)


def test_kept_edges_do_not_travel(calibrated):
    _, timing = calibrated
    before = len(pickle.dumps(replace(timing)))
    timing.code_intervals_ps([0], [0])
    sent = pickle.dumps(timing)
    assert len(sent) == before
    np.testing.assert_array_equal(
        pickle.loads(sent).code_intervals_ps([2], [3]), timing.code_intervals_ps([2], [3])
    )

"""Clocks from tables of edges: our own, and those of real LinoSPAD2 arrays."""

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags
from lightflight.errors import FileFormatError, UncalibratedWarning
from lightflight.simulate import ideal
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.calibrate.code_density import fit_code_density
from tests.clock_fakes import fake_clock
from tests.timing.edge_tables import clock_from_edges, edges_from_table


@pytest.mark.parametrize("reversed_codes", [True, False])
def test_edges_go_in_and_come_out(rng, reversed_codes):
    widths = rng.uniform(0.0, 40.0, (2, 3, 50))
    widths[..., :4] = 0.0
    edges = np.concatenate([np.zeros((2, 3, 1)), np.cumsum(widths, axis=2)], axis=2)
    skew = rng.normal(0, 100, (2, 3))
    clock = clock_from_edges(
        edges, laser_period_ps=2500.0, skew_ps=skew, reversed_codes=reversed_codes
    )
    lower, upper = clock.code_intervals_ps([0, 1], [2, 0])
    want = edges[[0, 1], [2, 0]]
    if reversed_codes:
        want = 2500.0 - want
        lower, upper = upper, lower
    np.testing.assert_allclose(lower, want[:, :-1], atol=1e-9)
    np.testing.assert_allclose(upper, want[:, 1:], atol=1e-9)
    np.testing.assert_array_equal(clock.skew_ps, skew)


def test_wrong_edges_are_refused():
    with pytest.raises(ValueError, match="must have shape"):
        clock_from_edges(np.zeros((2, 5)), laser_period_ps=1.0)
    with pytest.raises(ValueError, match="must not descend"):
        clock_from_edges([[[0.0, 2.0, 1.0]]], laser_period_ps=5.0)
    with pytest.raises(ValueError, match="within one period of 5"):
        clock_from_edges([[[0.0, 2.0, 6.0]]], laser_period_ps=5.0)
    with pytest.raises(ValueError, match="no calibrated pixel"):
        clock_from_edges([[[0.0, 0.0, 5.0]]], laser_period_ps=5.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no table"),
        (",0,1\n0,1.0,x\n", "is not a table"),
        (",0,1\n0,1.0,2.0\n1,1.0\n", "is not a table"),
        (",0,1\n0,2.0,1.0\n", "ascend"),
        (",0,1\n0,2.0,nan\n", "finite"),
    ],
)
def test_foreign_files_are_refused(tmp_path, text, message):
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=message):
        edges_from_table(path)
    with pytest.raises(FileFormatError, match="no such file"):
        edges_from_table(tmp_path / "none.csv")


def test_a_fitted_clock_becomes_a_table_and_back(rng):
    fake = fake_clock(rng, (3, 3), reversed_codes=False)
    with pytest.warns(UncalibratedWarning):
        fitted = calibrate_timing(fake.uniform(rng, 1e5), dead_codes="absorbed")
    rows, cols = (grid.ravel() for grid in np.indices((3, 3)))
    lower, upper = fitted.code_intervals_ps(rows, cols)
    edges = np.append(lower, upper[:, -1:], axis=1).reshape(3, 3, -1)
    again = clock_from_edges(np.clip(edges, 0.0, None), laser_period_ps=50_000.0)
    found = again.code_intervals_ps(rows, cols)
    np.testing.assert_allclose(found[1] - found[0], upper - lower, atol=1e-6)
    np.testing.assert_allclose(found[1][:, 8:], upper[:, 8:], atol=1e-6)


BLANK_PIXELS = {"A5_#36_2212b": 4, "B7d_#28_2212b": 2, "D2b_#4_2212s": 27, "NL11_#33_2212s": 1}


@pytest.fixture(params=BLANK_PIXELS)
def real_table(request, data_dir):
    folder = data_dir / "linospad2-tdc-calib"
    if not folder.is_dir():
        pytest.skip(f"no {folder.name} in {data_dir}")
    return request.param, edges_from_table(folder / f"TDC_{request.param}.csv")


def test_real_tables_as_clocks(real_table):
    name, edges = real_table
    assert edges.shape == (256, 141)
    clock = clock_from_edges(edges[:, None, :], laser_period_ps=2500.0)
    lower, upper = clock.code_intervals_ps(np.arange(256), np.zeros(256, int))
    good = (clock.flags.ravel() & flags.DEAD) == 0
    np.testing.assert_allclose(lower[good], edges[good, :-1], atol=1e-9)
    np.testing.assert_allclose(upper[good], edges[good, 1:], atol=1e-9)
    width = (upper - lower)[good]
    assert 19.5 < width[width > 0].mean() < 25.0
    assert np.count_nonzero(~good) == BLANK_PIXELS[name]


def test_code_density_finds_a_real_table_again(real_table, rng):
    _, edges = real_table
    widths = np.diff(edges, axis=1)
    good = np.count_nonzero(widths > 0, axis=1) > 1
    counts = rng.poisson(2e5 * widths[good] / 2500.0)
    hist = lf.Histograms(counts[:, None, :], bin_width_ps=2500.0 / 140, laser_period_ps=2500.0)
    fit = fit_code_density(hist)
    assert not fit.structured
    found = np.cumsum(fit.phases[:, 0], axis=1) / fit.phases[:, 0].sum(axis=1, keepdims=True)
    # the cumulated counts wander by sqrt(F (1 - F) / N) <= 0.5 / sqrt(2e5): 2.8 ps
    error = 2500.0 * found - edges[good, 1:]
    assert np.abs(error).max() < 6.0 * 2.8
    assert error.std() < 2.8


@pytest.mark.filterwarnings("ignore::lightflight.errors.SuspectDataWarning")
@pytest.mark.parametrize(
    "real_table",
    [
        pytest.param("A5_#36_2212b", marks=pytest.mark.long),
        "B7d_#28_2212b",
        "D2b_#4_2212s",
        pytest.param("NL11_#33_2212s", marks=pytest.mark.long),
    ],
    indirect=True,
)
def test_a_twin_with_the_codes_of_a_real_table_is_calibrated(real_table):
    """Codes from nothing to several times their mean, over the whole 2.5 ns: errors as stated."""
    _, edges = real_table
    widths = np.diff(edges, axis=1)
    blank = np.count_nonzero(widths > 0, axis=1) < 2
    widths[blank] = widths[~blank].mean(axis=0)
    camera = lf.Camera.facing_plane((16, 16), distance_mm=535.0, field_of_view_mm=(61.25, 61.25))
    detector = ideal(
        bin_width_ps=2500.0 / 140, laser_period_ps=2500.0, n_codes=140, response_fwhm_ps=100.0,
        skew_range_ps=100.0, phase_map=np.maximum(widths, 1e-3).reshape(16, 16, 140),
    )  # fmt: skip
    scene = lf.Scene([(-60.0, 0.0, 0.0), (60.0, 3.0, 8.0)], camera=camera, detector=detector)
    density = lf.simulate(scene, kind="code_density", photons_per_pixel=2e5, seed=1)
    flat, later = (
        lf.simulate(scene, kind="flat", photons_per_pixel=photons, seed=2, flat_arrival_ps=arrival)
        for photons, arrival in ((2e4, 1000.0), (2e5, 1700.0))
    )
    clock = lf.calibrate_timing(density, flat=flat, flat_arrival_ps=1000.0, dead_codes="absorbed")
    found = lf.find_arrivals(later, timing=clock)
    error = (found.arrival_ps - 1700.0)[found.usable]
    stated = np.hypot(found.photon_std_ps, found.pixel_std_ps)[found.usable]
    assert found.usable.mean() > 0.95
    assert np.sqrt(np.mean(error**2)) < 4.0
    assert 0.8 < np.sqrt(np.mean((error / stated) ** 2)) < 1.25

"""Records draw themselves and give their tables: `.plot`, `.to_dataframe`, `.to_xarray`."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import lightflight as lf
from lightflight.batch.table import CampaignTable
from lightflight.errors import MissingExtraError
from lightflight.view.records import CLOCK_FIGURES, PATH_FIGURES
from tests.view import fakes

pytest.importorskip("pandas")
pytest.importorskip("xarray")


def histograms():
    counts = np.random.default_rng(3).poisson(2.0, (4, 5, 64))
    counts[..., 30:33] += 400
    return lf.Histograms(counts, bin_width_ps=55.0, laser_period_ps=50_000.0, n_frames=100_000)


def clock():
    return lf.TimingCalibration.nominal(histograms())


def campaign():
    row = {"status": "done", "verdict": "trust", "group": "a", "set_point_deg": 4.0, "n_legs": 1}
    return CampaignTable(
        tuple(
            row | {"leg1_angle_deg": 4.0 + 0.1 * k, "leg1_angle_std_deg": 0.1,
                   "leg1_angle_photon_std_deg": 0.1}
            for k in range(3)
        )
    )  # fmt: skip


DRAWN = {
    "path": fakes.fake_path,
    "histograms": histograms,
    "clock": clock,
    "arrivals": lambda: lf.find_arrivals(histograms(), timing=clock()),
    "plan": lambda: lf.plan(fakes.fake_path()),
    "campaign": campaign,
}


@pytest.mark.filterwarnings("ignore:.*nominal:UserWarning")
@pytest.mark.parametrize("name", DRAWN)
def test_records_draw_themselves(name, tmp_path):
    record = DRAWN[name]()
    figure = record.plot()
    figure.savefig(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 5_000
    with pytest.raises(ValueError, match=r"can be drawn: '"):
        record.plot("nonsense")


@pytest.mark.parametrize("what", PATH_FIGURES)
def test_a_path_draws_what_the_command_does(what):
    assert fakes.fake_path().plot(what).axes


@pytest.mark.parametrize("what", CLOCK_FIGURES)
def test_a_clock_draws_what_the_command_does(what):
    assert clock().plot(what).axes


def test_the_table_of_a_path_has_its_corners_with_errors():
    path = fakes.fake_path()
    table = path.to_dataframe()
    assert len(table) == path.n_legs + 1
    np.testing.assert_array_equal(table[["x_mm", "y_mm", "z_mm"]], path.vertices_mm)
    np.testing.assert_array_equal(table["event_time_ps"], path.vertex_times_ps)
    np.testing.assert_array_equal(
        table[["x_std_mm", "y_std_mm", "z_std_mm", "event_time_std_ps"]], path.vertex_std
    )


@pytest.mark.filterwarnings("ignore:.*nominal:UserWarning")
def test_tables_of_pulses_plans_and_campaigns():
    arrivals = DRAWN["arrivals"]()
    table = arrivals.to_dataframe()
    assert len(table) == len(arrivals.row)
    np.testing.assert_array_equal(table["arrival_ps"], arrivals.arrival_ps)
    assert "flags" in table
    assert {"delay_ps", "photons"} <= set(lf.fit_pulses(histograms()).to_dataframe())
    plan = lf.plan(fakes.fake_path())
    assert list(plan.to_dataframe()["place"]) == [one.name for one in plan.placements]
    assert tuple(campaign().to_dataframe()) == campaign().columns


@pytest.mark.filterwarnings("ignore:.*nominal:UserWarning")
@pytest.mark.parametrize("name", ["path", "histograms", "clock", "arrivals"])
def test_labelled_arrays_are_those_of_view(name):
    record = DRAWN[name]()
    assert record.to_xarray().identical(lf.view.to_xarray(record))


def test_without_pandas_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingExtraError, match="pip install pandas"):
        fakes.fake_path().to_dataframe()


def test_what_cannot_be_drawn_is_told():
    with pytest.raises(TypeError, match="no figure is known of a Camera"):
        lf.view.figure_of(lf.Camera.facing_plane())
    with pytest.raises(TypeError, match="no table is known of a Camera"):
        lf.view.dataframe_of(lf.Camera.facing_plane())


def test_to_have_a_record_loads_nothing_that_draws():
    code = (
        "import sys, numpy as np, lightflight as lf\n"
        "repr(lf.Histograms(np.ones((2, 2, 3))))\n"
        "heavy = {'matplotlib', 'pandas', 'xarray'} & {m.partition('.')[0] for m in sys.modules}\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)

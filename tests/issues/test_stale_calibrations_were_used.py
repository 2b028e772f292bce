"""Workers of a lab's cluster kept the first calibration of a name under the next one's digest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.batch import work
from lightflight.batch.campaign import campaign_from_toml
from lightflight.batch.job import JobError, finished_path, jobs_from_campaign
from lightflight.timing.clock.calibration import TimingCalibration
from tests.batch.conftest import make_campaign


@pytest.fixture
def campaign_file(tmp_path):
    make_campaign(tmp_path / "campaign", n_repeats=1)
    file = tmp_path / "campaign" / "campaign.toml"
    file.write_text(file.read_text().replace("[campaign]", '[campaign]\ntiming = "clock.h5"'))
    return file


def _calibrated(file, later_ps: float) -> None:
    """A calibration of that campaign's camera, whose pixels are all so much later."""
    hist = lf.histogram(lf.read(file.parent / "angle_4" / "run8.h5"))
    nominal = TimingCalibration.nominal(hist, assumed_skew_std_ps=2.0)
    skew = np.full(hist.shape, later_ps)
    known = replace(nominal, skew_ps=skew, skew_std_ps=np.full(hist.shape, 2.0))
    known.save(file.parent / "clock.h5")


def test_the_calibration_is_that_of_the_file_now(campaign_file):
    """One process does both, as workers of `--scheduler` do."""
    emission = []
    for later_ps in (0.0, 400.0):
        _calibrated(campaign_file, later_ps)
        job = jobs_from_campaign(campaign_from_toml(campaign_file))[0]
        assert finished_path(job) is None
        assert work.begin(job) is None
        emission.append(finished_path(job).vertex_times_ps[0])
    assert emission[0] - emission[1] == pytest.approx(400.0, abs=1.0)


def test_one_that_is_replaced_meanwhile_is_told(campaign_file):
    _calibrated(campaign_file, 0.0)
    job = jobs_from_campaign(campaign_from_toml(campaign_file))[0]
    _calibrated(campaign_file, 400.0)
    with pytest.raises(JobError, match=r"clock.h5 was replaced while the campaign ran: run it ag"):
        work.begin(job)

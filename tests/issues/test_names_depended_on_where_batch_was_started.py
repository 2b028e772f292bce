"""`lightflight batch ../scan/campaign.toml` named recordings by whole paths, and did all anew."""

from __future__ import annotations

from lightflight.batch.campaign import campaign_from_toml
from lightflight.batch.job import jobs_from_campaign
from tests.batch.conftest import make_campaign


def test_recordings_and_results_have_one_name_from_everywhere(tmp_path, monkeypatch):
    make_campaign(tmp_path / "scan", n_repeats=1)
    (tmp_path / "elsewhere").mkdir()
    marks = []
    for place, told in (("scan", ""), ("elsewhere", "../scan/"), (".", "scan/./../scan/")):
        monkeypatch.chdir(tmp_path / place)
        jobs = jobs_from_campaign(campaign_from_toml(f"{told}campaign.toml", output="out"))
        marks.append([(job.label, job.key) for job in jobs])
    assert marks[0] == marks[1] == marks[2]
    assert [label for label, _ in marks[0]] == ["angle_-4/run8.h5", "angle_4/run8.h5"]

"""batch.campaign: what a campaign file means, and what is said about a wrong one."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from lightflight.batch.campaign import campaign_from_toml, toml_from_campaign
from lightflight.errors import ConfigError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("a/run10.h5", "a/run9.h5", "tilt_-2.5/x.bin", "tilt_10/x.bin", "tilt_none/x.bin"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    return tmp_path


def write(folder: Path, text: str) -> Path:
    (folder / "campaign.toml").write_text(text)
    return folder / "campaign.toml"


def test_patterns_are_in_natural_order_and_may_tell_the_set_point(folder):
    file = write(
        folder,
        """
        [[groups]]
        recordings = "a/*.h5"
        name = "first"
        [[groups]]
        recordings = ["tilt_{set_point_deg}/*.bin"]
        """,
    )
    shots = campaign_from_toml(file).shots
    assert [(s.label, s.group, s.set_point_deg) for s in shots] == [
        ("a/run9.h5", "first", None),
        ("a/run10.h5", "first", None),
        ("tilt_-2.5/x.bin", "-2.5 deg", -2.5),
        ("tilt_10/x.bin", "10 deg", 10.0),
    ]
    assert len({shot.name for shot in shots}) == 4


def test_a_stated_set_point_goes_before_the_name(folder):
    file = write(folder, '[[groups]]\nrecordings = "tilt_{set_point_deg}/*"\nset_point_deg = 3\n')
    assert {shot.set_point_deg for shot in campaign_from_toml(file).shots} == {3.0}


def test_results_and_calibration_are_no_recordings(folder):
    (folder / "results" / "paths").mkdir(parents=True)
    (folder / "results" / "paths" / "old.h5").write_bytes(b"x")
    (folder / "cal.h5").write_bytes(b"x")
    file = write(folder, '[campaign]\ntiming = "cal.h5"\n[[groups]]\nrecordings = "**/*.h5"\n')
    assert [s.label for s in campaign_from_toml(file).shots] == ["a/run9.h5", "a/run10.h5"]


def test_a_recording_that_is_named_but_missing_is_kept_for_its_row(folder):
    file = write(folder, '[[groups]]\nrecordings = ["a/run9.h5", "a/gone.h5"]\n')
    assert [shot.label for shot in campaign_from_toml(file).shots] == ["a/run9.h5", "a/gone.h5"]


def test_recordings_that_differ_by_suffix_alone_get_files_of_their_own(folder):
    (folder / "a" / "run9.npz").write_bytes(b"x")
    file = write(folder, '[[groups]]\nrecordings = "a/run9.*"\n')
    names = [shot.name for shot in campaign_from_toml(file).shots]
    assert len(set(names)) == 2


def test_the_campaign_goes_before_the_lab_key_by_key(folder):
    (folder / "lab.toml").write_text(
        "[source]\nposition_mm = [1, 2, 3]\npulse_fwhm_ps = 68\n[medium]\npath_group_index = 1.4\n"
    )
    file = write(
        folder,
        '[campaign]\nlab = "lab.toml"\n[source]\npulse_fwhm_ps = 50\n'
        '[[groups]]\nrecordings="a/*"\n',
    )
    lab = campaign_from_toml(file, assignments=["medium.path_group_index=1.5"]).lab
    assert tuple(lab.source.position_mm) == (1.0, 2.0, 3.0)
    assert lab.source.pulse_fwhm_ps == 50.0
    assert lab.medium.path_group_index == 1.5


def test_what_is_printed_reads_back_as_the_same_campaign(folder):
    file = write(
        folder,
        '[campaign]\ntitle = "A"\ncodes = [10, 90]\nleg = 2\n[camera]\ndistance_mm = 535.0\n'
        "field_of_view_mm = [245.0, 245.0]\n[[groups]]\n"
        'recordings = "tilt_{set_point_deg}/*.bin"\n[[groups]]\nrecordings = "a/*"\n',
    )
    first = campaign_from_toml(file)
    (folder / "again.toml").write_text(toml_from_campaign(first))
    again = campaign_from_toml(folder / "again.toml")
    assert again.shots == first.shots
    assert again.settings == first.settings
    for name in ("title", "timing", "background", "output", "leg", "codes", "piece_megabytes"):
        assert getattr(again, name) == getattr(first, name), name


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[camera]\ndistance_mm = 1\n", ["no recordings", "[[groups]]"]),
        ("[groups]\nrecordings = 'a'\n", ["[[groups]]"]),
        ("[[groups]]\nname = 'a'\n", ["number 1", "lacks recordings"]),
        ("[[groups]]\nrecording = 'a'\n", ["'recording'", "did you mean 'recordings'"]),
        ("[[groups]]\nrecordings = 3\n", ["recordings", "text in quotes"]),
        ("[[groups]]\nrecordings = []\n", ["recordings", "list"]),
        ("[[groups]]\nrecordings = 'b/*.h5'\n", ["'b/*.h5'", "no file matches"]),
        ("[[groups]]\nrecordings = ['a/*', 'a/run9.h5']\n", ["a/run9.h5", "named twice"]),
        ("[campain]\n[[groups]]\nrecordings='a/*'\n", ["'campain'", "did you mean 'campaign'"]),
        ("leg = 2\n[[groups]]\nrecordings='a/*'\n", ["'leg'", "under [campaign]"]),
        ("[campaign]\nleg = 0\n[[groups]]\nrecordings='a/*'\n", ["leg", "at least 1"]),
        ("[campaign]\ncodes = [9, 9]\n[[groups]]\nrecordings='a/*'\n", ["codes", "start < end"]),
        ("[campaign]\nlab = 'no.toml'\n[[groups]]\nrecordings='a/*'\n", ["no.toml"]),
        ("[source]\nposition = 1\n[[groups]]\nrecordings='a/*'\n", ["position_mm"]),
        ("[[groups]]\nrecordings='{set_point_deg}{set_point_deg}'\n", ["more than once"]),
        ("[[groups]\n", ["TOML", "line 1"]),
    ],
)
def test_a_wrong_file_is_one_sentence(folder, text, words):
    with pytest.raises(ConfigError) as caught:
        campaign_from_toml(write(folder, text))
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_every_default_can_be_printed_as_toml(folder):
    printed = toml_from_campaign(campaign_from_toml(write(folder, "[[groups]]\nrecordings='a/*'")))
    assert tomllib.loads(printed)["campaign"]["piece_megabytes"] == 1000.0

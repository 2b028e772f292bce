"""HDF5 that leads elsewhere: links out of a file are refused, by all who would follow them."""

from __future__ import annotations

import os
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.batch.campaign import campaign_from_toml
from lightflight.batch.runner import run_campaign
from lightflight.errors import ConfigError, FileFormatError
from lightflight.files import whole_file
from lightflight.files.tables import write_csv
from tests.batch.conftest import CAMPAIGN, LAB, recording_at
from tests.files.unsealed import unsealed

read: Any = lf.read


@pytest.fixture
def secret(tmp_path) -> Path:
    """A file of somebody else that the reader's user may read."""
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["counts"] = np.full((2, 2, 8), 7, np.uint16)
        file["photon_data/nanotimes"] = np.arange(5, dtype=np.uint16)
    return tmp_path / "secret.h5"


@pytest.mark.parametrize("link", ["external", "soft"])
def test_our_own_files_hold_none(tmp_path, secret, link):
    lf.write(lf.Histograms(np.ones((2, 2, 8), np.uint16)), tmp_path / "x.h5")
    with unsealed(tmp_path / "x.h5") as file:
        del file["counts"]
        away = h5py.ExternalLink("secret.h5", "/counts")
        file["counts"] = away if link == "external" else h5py.SoftLink("/attributes")
    with pytest.raises(FileFormatError, match=r"holds a link \(counts\)"):
        read(tmp_path / "x.h5")


def test_photon_hdf5_holds_none_out_of_the_file(tmp_path, secret):
    with h5py.File(tmp_path / "x.photon.h5", "w") as file:
        file.attrs["format_name"] = np.bytes_("Photon-HDF5")
        file["photon_data"] = h5py.ExternalLink("secret.h5", "/photon_data")
    with pytest.raises(FileFormatError, match=r"holds a link \(photon_data\)"):
        read(tmp_path / "x.photon.h5")


def test_datasets_of_others_behind_a_link_are_not_seen(tmp_path, secret):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["away"] = h5py.ExternalLink("secret.h5", "/counts")
    with pytest.raises(FileFormatError, match="holds no array of numbers"):
        read(tmp_path / "x.h5", axes="yxt")
    with pytest.raises(ConfigError, match="is no array of numbers"):
        read(tmp_path / "x.h5", axes="yxt", dataset="away")


def test_virtual_datasets_are_refused(tmp_path, secret):
    layout = h5py.VirtualLayout((2, 2, 8), "u2")
    layout[:] = h5py.VirtualSource(secret, "counts", (2, 2, 8))
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_virtual_dataset("cube", layout)
    with pytest.raises(FileFormatError, match="lies in another file"):
        read(tmp_path / "x.h5", axes="yxt")


@pytest.mark.parametrize("link", ["table.csv", "paths", "paths/angle_4_a.h5", "index_pages"])
def test_campaigns_write_through_none(tmp_path, link):
    """A folder of results that came by mail, and leads to somebody's own files."""
    (tmp_path / "lab.toml").write_text(LAB)
    (tmp_path / "campaign.toml").write_text(CAMPAIGN)
    (tmp_path / "angle_4").mkdir()
    lf.write(recording_at(4, seed=16), tmp_path / "angle_4" / "a.h5")
    (tmp_path / "mine").mkdir()
    place = tmp_path / "results" / link
    place.parent.mkdir(parents=True)
    place.symlink_to(tmp_path / "mine")
    with pytest.raises(FileFormatError, match=rf"holds a link \({link}\)"):
        run_campaign(campaign_from_toml(tmp_path / "campaign.toml"))
    assert list((tmp_path / "mine").iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
def test_nothing_is_written_through_somebody_elses_link_in_a_folder_for_all(tmp_path, monkeypatch):
    """What mallory makes of /tmp/path.csv must not cost anybody a file."""
    shared, mine = tmp_path / "tmp", tmp_path / "mine"
    for folder in (shared, mine):
        folder.mkdir()
    (mine / "kept.csv").write_text("years of work")
    (shared / "table.csv").symlink_to(mine / "kept.csv")
    (shared / "folder").symlink_to(mine)
    shared.chmod(0o1777)
    monkeypatch.setattr(whole_file, "_is_planted", _as_if_by_another_user)
    for name in ("table.csv", "folder/kept.csv"):
        with pytest.raises(PermissionError, match="somebody else put into a folder for all"):
            write_csv(["x"], [["1"]], shared / name)
    assert (mine / "kept.csv").read_text() == "years of work"
    assert list(shared.glob(".*")) == []


_is_planted = whole_file._is_planted


def _as_if_by_another_user(link, folder, user):
    for owner in (user, folder.st_uid):
        assert not _is_planted(SimpleNamespace(st_uid=owner), folder, user)
    stranger = SimpleNamespace(st_uid=max(user, folder.st_uid) + 1)
    private = SimpleNamespace(st_uid=folder.st_uid, st_mode=0o40755)
    assert not _is_planted(stranger, private, user)
    return _is_planted(stranger, folder, user)


def test_a_text_of_matlab_that_lies_in_another_file_is_not_read(tmp_path):
    (tmp_path / "secret").write_bytes("my secret".encode("utf-16-le"))
    with h5py.File(tmp_path / "x.mat", "w", userblock_size=512) as file:
        file["counts"] = np.ones((8, 2, 2), np.uint16)
        away = [(str(tmp_path / "secret"), 0, 18)]
        text = file.create_dataset("axes", (9, 1), "u2", external=away)
        text.attrs["MATLAB_class"] = np.bytes_("char")
    with (tmp_path / "x.mat").open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(116) + bytes(8) + b"\x00\x02IM")
    with pytest.raises(FileFormatError, match="lies in another file") as told:
        lf.read(tmp_path / "x.mat")
    assert "my secret" not in str(told.value)

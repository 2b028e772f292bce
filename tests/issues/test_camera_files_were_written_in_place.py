"""`calibrate camera` wrote over its earlier result: a full disk or a kill left half of it."""

from __future__ import annotations

import errno
import os

import numpy as np
import pytest
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main


@pytest.fixture
def points(tmp_path):
    rng = np.random.default_rng(16)
    camera = lf.Camera.facing_plane((16, 16), distance_mm=535.0, field_of_view_mm=(245.0, 245.0))
    world = rng.uniform((-100, -100, 0), (100, 100, 60), (40, 3))
    pixels = np.array(camera.pixels_from_points(world)).T + rng.normal(0, 0.05, (40, 2))
    np.savez(tmp_path / "points.npz", points_mm=world, pixels=pixels)
    return str(tmp_path / "points.npz")


def called(points, output):
    words = ["calibrate", "camera", points, "--shape", "16", "16", "-o", str(output)]
    return CliRunner().invoke(main, words)


def test_a_full_disk_leaves_the_earlier_result(points, tmp_path, monkeypatch):
    assert called(points, tmp_path / "camera.toml").exit_code == 0
    before = (tmp_path / "camera.toml").read_bytes()
    assert called(points, tmp_path / "camera.toml").exit_code == 0, "an earlier result is replaced"

    def full(handle):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    done = called(points, tmp_path / "camera.toml")
    assert done.exit_code == 3, done.output
    assert (tmp_path / "camera.toml").read_bytes() == before
    assert sorted(one.name for one in tmp_path.iterdir()) == ["camera.toml", "points.npz"]


@pytest.mark.skipif(os.name == "nt", reason="POSIX")
@pytest.mark.timeout(60)
def test_a_pipe_of_that_name_is_not_waited_for(points, tmp_path):
    os.mkfifo(tmp_path / "camera.toml")
    done = called(points, tmp_path / "camera.toml")
    assert done.exit_code == 2
    assert "is no earlier result of this command" in done.output

"""A path's file: everything comes back, and a foreign or damaged file is named in a sentence."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.errors import FileFormatError
from lightflight.files.store import load_record, save_record
from lightflight.flight import Medium, Source
from lightflight.path.light_path import LightPath
from lightflight.path.tables import RESIDUAL_DTYPE, Goodness
from tests.files.unsealed import unsealed
from tests.path_fakes import make_path, random_covariance, truth_of


def full_path():
    rng = np.random.default_rng(5)
    covariance = random_covariance(rng, 4, scale=0.1)
    residuals = np.zeros(7, RESIDUAL_DTYPE)
    for name in RESIDUAL_DTYPE.names or ():
        residuals[name] = rng.integers(0, 2, 7) if name == "used" else 10 * rng.normal(size=7) ** 2
    camera = Camera(
        np.array([[70.0, 0, 15.2], [0, 68.0, 16.0], [0, 0, 1]]),
        np.array([-0.2, 0.05, 0.001, -0.002, 0.01]),
        Camera.facing_plane((32, 32)).world_from_camera,
        (32, 32),
        pose_covariance=0.01 * np.eye(6),
    )
    return make_path(
        covariance=covariance,
        camera=camera,
        source=Source((0, 0, 0), position_std_mm=(1.0, 0.0, 2.0), emission_time_ps=2000.0),
        medium=Medium(1.47, 1.00027),
        method="joint",
        goodness=Goodness(12.5, 9, 12, 1, 1.5, 0.25, True),
        covariance_parts={"photon": 0.7 * covariance, "shared": 0.3 * covariance},
        residuals=residuals,
        prior="source ± 1 mm, emission time known",
        statements=("Exit depth and exit height are confounded (ρ = 0.999): give one.",),
        truth=truth_of(make_path().vertices_mm),
        provenance={"seed": 3, "settings": {"n_legs": None}},
    )


def test_round_trip_keeps_everything(tmp_path):
    path = full_path()
    path.save(tmp_path / "path.h5")
    back = LightPath.load(tmp_path / "path.h5")
    for name in ("vertices_mm", "vertex_times_ps", "covariance"):
        np.testing.assert_array_equal(getattr(back, name), getattr(path, name))
    for name in ("source", "medium", "method", "goodness", "prior", "statements"):
        assert getattr(back, name) == getattr(path, name), name
    assert dict(back.provenance) == dict(path.provenance)
    assert set(back.covariance_parts) == {"photon", "shared"}
    for name, part in path.covariance_parts.items():
        np.testing.assert_array_equal(back.covariance_parts[name], part)
    np.testing.assert_array_equal(back.residuals, path.residuals)
    for name, array in path.camera.to_arrays().items():
        np.testing.assert_array_equal(back.camera.to_arrays()[name], array)
    np.testing.assert_array_equal(back.truth.vertices_mm, path.truth.vertices_mm)
    np.testing.assert_array_equal(back.truth.vertex_times_ps, path.truth.vertex_times_ps)
    np.testing.assert_array_equal(back.sample(50), path.sample(50))


def test_a_path_without_truth_or_residuals_comes_back_without(tmp_path):
    make_path(source=Source()).save(tmp_path / "bare.h5")
    back = LightPath.load(tmp_path / "bare.h5")
    assert back.truth is None
    assert len(back.residuals) == 0
    assert back.source == Source()


def test_the_file_says_what_made_it(tmp_path):
    make_path().save(tmp_path / "path.h5")
    provenance = LightPath.load(tmp_path / "path.h5").provenance
    assert provenance, "a path without provenance of its own gets a record of versions"


def test_numpy_scalars_in_the_source_can_be_stored(tmp_path):
    source = Source(
        np.zeros(3),
        emission_time_ps=np.float32(2000.0),
        emission_time_std_ps=np.int64(2),
        pulse_fwhm_ps=np.float64(68.0),
    )
    make_path(source=source).save(tmp_path / "path.h5")
    assert LightPath.load(tmp_path / "path.h5").source == source


def test_nan_goodness_survives(tmp_path):
    path = make_path(goodness=Goodness(float("nan"), 0, 3, 0, float("inf"), 0.0, False))
    path.save(tmp_path / "path.h5")
    back = LightPath.load(tmp_path / "path.h5").goodness
    assert np.isnan(back.chi2)
    assert np.isinf(back.residual_rms_ps)
    assert back.converged is False


def test_an_existing_file_is_replaced_whole(tmp_path):
    file = tmp_path / "path.h5"
    file.write_text("my only copy")
    full_path().save(file)
    assert LightPath.load(file).n_legs == 3
    assert [p.name for p in tmp_path.iterdir()] == ["path.h5"]


def test_a_path_that_cannot_be_stored_leaves_the_old_file(tmp_path):
    file = tmp_path / "path.h5"
    make_path().save(file)
    before = file.read_bytes()
    with pytest.raises((TypeError, ValueError)):
        make_path(provenance={"what": object()}).save(file)
    assert file.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["path.h5"]


class TestForeignFiles:
    def test_missing_empty_and_text(self, tmp_path):
        with pytest.raises(FileFormatError, match=r"none\.h5"):
            LightPath.load(tmp_path / "none.h5")
        (tmp_path / "empty.h5").write_bytes(b"")
        with pytest.raises(FileFormatError, match="empty"):
            LightPath.load(tmp_path / "empty.h5")
        (tmp_path / "text.h5").write_text("x,y,z\n1,2,3\n")
        with pytest.raises(FileFormatError, match=r"text\.h5"):
            LightPath.load(tmp_path / "text.h5")

    def test_truncated(self, tmp_path):
        full_path().save(tmp_path / "path.h5")
        whole = (tmp_path / "path.h5").read_bytes()
        for keep in (20, 500, len(whole) // 2, len(whole) - 200):
            (tmp_path / "cut.h5").write_bytes(whole[:keep])
            with pytest.raises(FileFormatError, match=r"cut\.h5"):
                LightPath.load(tmp_path / "cut.h5")

    def test_other_kinds_of_ours(self, tmp_path):
        save_record(
            tmp_path / "other.h5", kind="pulses", arrays={"row": np.zeros(3)}, attributes={}
        )
        with pytest.raises(FileFormatError, match=r"'pulses'.*'path' is needed"):
            LightPath.load(tmp_path / "other.h5")

    @pytest.mark.parametrize(
        "name",
        ["vertices_mm", "covariance", "residuals_leg", "camera_matrix", "truth_vertex_times_ps"],
    )
    def test_an_array_is_missing(self, tmp_path, name):
        full_path().save(tmp_path / "path.h5")
        with unsealed(tmp_path / "path.h5") as file:
            del file[name]
        with pytest.raises(FileFormatError, match=r"path\.h5.*lacks .*damaged"):
            LightPath.load(tmp_path / "path.h5")

    @pytest.mark.parametrize("name", ["goodness", "source", "medium", "method"])
    @pytest.mark.parametrize("value", [None, 7, {"nonsense": 1}])
    def test_an_attribute_is_missing_or_wrong(self, tmp_path, name, value):
        full_path().save(tmp_path / "path.h5")
        arrays, attributes = load_record(tmp_path / "path.h5", kind="path")
        changed = {k: v for k, v in attributes.items() if k != name}
        if value is not None:
            changed[name] = value
        save_record(tmp_path / "path.h5", kind="path", arrays=arrays, attributes=changed)
        with pytest.raises(FileFormatError, match=r"path\.h5.*damaged"):
            LightPath.load(tmp_path / "path.h5")

    def test_arrays_that_make_no_path(self, tmp_path):
        full_path().save(tmp_path / "path.h5")
        with unsealed(tmp_path / "path.h5") as file:
            del file["vertices_mm"]
            file["vertices_mm"] = np.zeros((2, 3))
        with pytest.raises(FileFormatError, match=r"path\.h5.*vertices_mm.*damaged"):
            LightPath.load(tmp_path / "path.h5")

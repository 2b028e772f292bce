import dataclasses
import tomllib
from typing import Any

import numpy as np
import pytest

from lightflight.camera.model import Camera
from lightflight.errors import ConfigError
from lightflight.flight import Medium, Source
from lightflight.lab import (
    Lab,
    lab_from_table,
    lab_from_toml,
    reconstruct_options,
    table_from_lab,
    toml_from_lab,
)
from lightflight.materials import AIR, Material
from lightflight.simulate.detector import Detector

FACING = {"distance_mm": 535.0, "field_of_view_mm": [245.0, 245.0], "center_mm": [187.5, 37.5]}


def same(left, right):
    """Equal records, field by field, arrays included."""
    for item in dataclasses.fields(left):
        np.testing.assert_array_equal(getattr(left, item.name), getattr(right, item.name))


def test_a_set_up_file_becomes_records(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text(
        """
        [camera]
        distance_mm = 535.0
        field_of_view_mm = [245.0, 245.0]
        center_mm = [187.5, 37.5]
        position_std_mm = [0.1, 0.2, 0.3]

        [source]
        position_mm = [0, 0, 0]
        position_std_mm = 1.0

        [medium]
        path_group_index = 1.47

        [detector]
        gain_rms = 0.006
        laser_period_ps = "none"

        [recording]
        axes = "tyx"

        [reconstruct]
        n_legs = 3
        """
    )
    lab = lab_from_toml(path)
    reference = Camera.facing_plane(
        distance_mm=535.0, field_of_view_mm=(245.0, 245.0), center_mm=(187.5, 37.5)
    )
    np.testing.assert_array_equal(lab.camera.matrix, reference.matrix)
    np.testing.assert_array_equal(lab.camera.world_from_camera, reference.world_from_camera)
    variances = np.square([0, 0, 0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(lab.camera.pose_covariance, np.diag(variances))
    assert lab.source == Source((0, 0, 0), position_std_mm=1.0)
    assert lab.medium == Medium(1.47)
    assert lab.detector.gain_rms == 0.006
    assert lab.detector.laser_period_ps is None
    assert lab.recording == {"axes": "tyx"}
    assert lab.reconstruct == {"n_legs": 3}
    assert lab.camera_needs == ()


def test_round_trip_through_text_loses_no_digit():
    pose = np.eye(4)
    pose[:3, 3] = [1 / 3, -2.0, 1e-17]
    covariance = np.diag(np.linspace(0.1, 0.7, 6)) ** 2
    lab = Lab(
        camera=Camera(
            np.array([[70.1, 0, 15.5], [0, 69.9, 15.4], [0, 0, 1]]),
            np.array([0.1, -0.2, 0.001, 0.002, 0.3]),
            pose,
            (32, 48),
            covariance,
        ),
        source=Source((0.1, 0.2, 0.3), position_std_mm=(0.1, 0.2, 0.3), pulse_fwhm_ps=68.0),
        medium=Medium(1.47, 1.00027),
        detector=Detector(
            seed=3,
            laser_period_ps=None,
            phase_pattern=(0.9, 1.1),
            gain_map=np.linspace(0.9, 1.1, 6).reshape(2, 3),
        ),
        recording={"axes": "tyx", "bin_width_ps": 7.5},
        timing={"dead_codes": "lost"},
        reconstruct={"waypoints": ((1, 375.0, 25.0, 50.0, 0.5),)},
        scene={"vertices_mm": ((0.0, 0.0, 0.0), (375.0, 25.0, 50.0))},
    )
    again = lab_from_table(tomllib.loads(toml_from_lab(lab)))
    for name in ("camera", "source", "medium", "detector"):
        same(getattr(lab, name), getattr(again, name))
    for name in ("recording", "timing", "reconstruct", "scene"):
        assert getattr(lab, name) == getattr(again, name)


def test_an_empty_set_up_knows_nothing_and_says_what_the_camera_needs():
    lab = lab_from_table({})
    assert lab.camera is None
    assert lab.camera_needs == ("distance_mm", "field_of_view_mm")
    assert lab.detector is None
    assert lab.source == Source()
    assert lab_from_table({"camera": {"distance_mm": 5.0}}).camera_needs == ("field_of_view_mm",)
    assert lab_from_table({"camera": {"matrix": np.eye(3).tolist()}}).camera_needs == (
        "shape",
        "world_from_camera",
    )


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"camera": {"distance": 535}}, ["distance", "distance_mm"]),
        ({"sauce": {}}, ["sauce", "source"]),
        ({"camera": {**FACING, "distance_mm": -1.0}}, ["[camera]", "positive", "-1"]),
        ({"medium": {"path_group_index": 0.2}}, ["[medium]", "path_group_index", "0.2"]),
        ({"source": {"pulse_fwhm_ps": -68.0}}, ["[source]", "pulse_fwhm_ps"]),
        ({"detector": {"dark_rate": 5}}, ["dark_rate", "dark_rate_hz"]),
        ({"detector": {"preset": "pf23"}}, ["[detector]", "pf23", "pf32"]),
        ({"reconstruct": {"method": "best"}}, ["method", "'joint'", "'best'"]),
        ({"timing": {"dead_codes": "eaten"}}, ["dead_codes", "'lost'"]),
        (
            {"camera": {**FACING, "position_std_mm": 1, "pose_covariance": np.eye(6).tolist()}},
            ["pose_covariance", "not both"],
        ),
        ({"camera": {**FACING, "position_std_mm": -1}}, ["position_std_mm", "negative"]),
        ({"camera": {**FACING, "distortion": [0.1, 0, 0, 0]}}, ["distortion needs matrix"]),
        (
            {
                "camera": {
                    "matrix": np.eye(3).tolist(),
                    "world_from_camera": np.eye(4).tolist(),
                    "shape": [4, 4],
                    "distance_mm": 5,
                }
            },
            ["matrix", "distance_mm", "not both"],
        ),
    ],
)
def test_what_is_wrong_is_named(table, words):
    with pytest.raises(ConfigError) as caught:
        lab_from_table(table, where="lab.toml")
    assert str(caught.value).startswith("lab.toml: ")
    for word in words:
        assert word in str(caught.value)


def test_a_lab_without_a_detector_writes_no_detector():
    assert set(table_from_lab(Lab())) == {"source", "medium"}


BLOCK = {"center_mm": [187.5, 20.0, 15.0], "normal": [1.0, 0.0, 0.2], "thickness_mm": 20.0,
         "diameter_mm": 25.0, "glass": "BK7", "wavelength_nm": 532.0}  # fmt: skip


def test_blocks_of_glass_are_read_and_written():
    """One by its keys, several by rows, and written as rows."""
    lab = lab_from_table({"block": BLOCK})
    (block,) = lab.medium.blocks
    assert block.glass == Material.named("BK7", wavelength_nm=532.0)
    assert block.around == AIR
    assert (block.thickness_mm, block.diameter_mm) == (20.0, 25.0)
    written = table_from_lab(lab)
    assert set(written["medium"]) == {"path_group_index", "return_group_index"}
    rows: Any = written["block"]["blocks"]
    aside = [rows[0][0] + 60.0, *rows[0][1:]]
    again = lab_from_table({"block": {"blocks": [rows[0], aside]}})
    assert [one.glass.group_index for one in again.medium.blocks] == [block.glass.group_index] * 2
    assert table_from_lab(again)["block"]["blocks"] == [rows[0], aside]
    indices = {key: value for key, value in BLOCK.items() if key not in ("glass", "wavelength_nm")}
    told = lab_from_table({"block": indices | {"glass_indices": [1.5, 1.55]}})
    assert told.medium.blocks[0].glass == Material(1.5, 1.55)


CURVE = {"points_mm": [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [2.0, 0.1, 0.0], [3.0, 0.0, 0.0]],
         "point_std_mm": 0.3}  # fmt: skip


def test_a_told_curve_is_read_and_written():
    lab = lab_from_table({"curve": CURVE | {"leg": 1, "turn_std_deg": 2.0}})
    (curve,) = reconstruct_options(lab)["curves"]
    assert (curve.leg, curve.point_std_mm, curve.turn_std_deg) == (1, 0.3, 2.0)
    assert curve.places_mm.tolist() == CURVE["points_mm"]
    assert reconstruct_options(lab_from_table(table_from_lab(lab)))["curves"] == (curve,)
    assert reconstruct_options(lab_from_table({}))["curves"] == ()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"points_mm": None}, ["points_mm is missing"]),
        ({"point_std_mm": None}, ["point_std_mm is missing"]),
        ({"point_std_mm": 0.0}, ["point_std_mm must be positive"]),
        ({"points_mm": [[0.0, 0.0, 0.0]]}, ["4 to 200 rows"]),
    ],
)
def test_what_is_wrong_with_a_curve_is_named(changes, words):
    table = {key: value for key, value in (CURVE | changes).items() if value is not None}
    with pytest.raises(ConfigError) as caught:
        lab_from_table({"curve": table}, where="lab.toml")
    for word in ("lab.toml", "[curve]", *words):
        assert word in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"thickness_mm": None}, ["thickness_mm is missing"]),
        ({"thickness_mm": 0.0}, ["thickness_mm must be positive"]),
        ({"glass": None, "wavelength_nm": None}, ["glass (or glass_indices) is missing"]),
        ({"wavelength_nm": None}, ["needs wavelength_nm"]),
        ({"glass": None, "glass_indices": [1.5, 0.9]}, ["group_index must lie between 1 and 10"]),
        ({"glass": None, "glass_indices": [1.5]}, ["glass_indices"]),
        ({"blocks": [[1.0] * 12]}, ["give either blocks or", "not both"]),
        ({"around": "water"}, ["say what it stands in"]),
    ],
)
def test_what_is_wrong_with_a_block_is_named(changes, words):
    table = {key: value for key, value in (BLOCK | changes).items() if value is not None}
    with pytest.raises(ConfigError) as caught:
        lab_from_table({"block": table}, where="lab.toml")
    for word in ("lab.toml", "[block]", *words):
        assert word in str(caught.value)

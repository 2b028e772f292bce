"""Layers for napari: numbers, units, the plug-in's manifest; no window and no napari needed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from importlib.metadata import entry_points
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lightflight.formats.registry import write
from lightflight.path.trace import places_from_path
from lightflight.recording.histograms import Histograms
from lightflight.view.napari_layers import (
    layers_from_histograms,
    layers_from_path,
    napari_get_reader,
)
from tests.view import fakes

TURNED = np.diag([1.0, -1.0, -1.0, 1.0, 1.0])


def by_name(layers: Any) -> dict[str, Any]:
    return {attributes["name"]: (array, attributes, kind) for array, attributes, kind in layers}


def in_world(layer: Any) -> Any:
    """(n, 4): time since vertex 0 (ps), z, y, x (mm) of a layer of tracks or points."""
    array, attributes, kind = layer
    return array[:, 1 if kind == "tracks" else 0 :] * attributes["scale"]


def test_the_pulse_is_where_the_path_says_at_every_step_of_the_slider() -> None:
    path = fakes.fake_path()
    layers = by_name(layers_from_path(path, step_ps=5.0))
    world = in_world(layers["pulse, event time"])
    np.testing.assert_allclose(np.diff(world[:, 0]), 5.0)
    np.testing.assert_allclose(
        world[:, :0:-1], path.position_at(path.vertex_times_ps[0] + world[:, 0]), atol=1e-6
    )
    assert world[-1, 0] > path.vertex_times_ps[-1] - path.vertex_times_ps[0] - 5.0


def test_the_picture_is_where_its_light_left_from() -> None:
    path = fakes.fake_path()
    world = in_world(by_name(layers_from_path(path))["its picture, arrival"])
    index, c = path.medium.return_group_index, 0.299792458

    def way(points: Any) -> Any:
        return np.linalg.norm(points - path.camera.center_mm, axis=1) * index / c

    length = np.linalg.norm(np.diff(path.vertices_mm, axis=0), axis=1)
    points = world[:, :0:-1]
    arrival = world[:, 0] + way(path.vertices_mm[:1]) + path.vertex_times_ps[0]
    event = arrival - way(points)
    np.testing.assert_allclose(points, path.position_at(event), atol=0.05)
    assert length.sum() > 0


def test_points_carry_errors_residuals_and_units() -> None:
    path = fakes.fake_path()
    layers = by_name(layers_from_path(path))
    _array, attributes, kind = layers["vertices"]
    assert kind == "points"
    np.testing.assert_allclose(in_world(layers["vertices"])[:, :0:-1], path.vertices_mm)
    np.testing.assert_allclose(attributes["features"]["x_std_mm"], path.vertex_std[:, 0])
    pulses = layers["pulses"][1]["features"]
    places = places_from_path(path)
    np.testing.assert_array_equal(pulses["residual_ps"], places.residual_ps)
    assert len(layers["pulses"][0]) == len(places.row)
    for _, more, _ in layers.values():
        assert more["units"] == ("ps", "mm", "mm", "mm")
        # Right-handed as the world, but y downwards and z away, as napari draws.
        np.testing.assert_array_equal(more["affine"], TURNED)


def test_counts_run_forwards_in_ps_without_the_empty_frames() -> None:
    counts = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    clock = {"bin_width_ps": 55.0, "laser_period_ps": 50_000.0, "no_photon_code": 0}
    ((array, attributes, kind),) = layers_from_histograms(Histograms(counts, **clock))
    assert kind == "image"
    assert array.shape == (4, 2, 3)
    assert not array[0].any()
    np.testing.assert_array_equal(array[3], counts[..., 3])
    assert attributes["scale"] == (55.0, 1.0, 1.0)
    assert attributes["units"] == ("ps", "pixel", "pixel")
    backwards = Histograms(counts, reversed_codes=True, **clock)
    ((turned, _, _),) = layers_from_histograms(backwards)
    np.testing.assert_array_equal(turned, array[::-1])
    ((_, unknown, _),) = layers_from_histograms(Histograms(counts))
    assert unknown["units"] == ("pixel", "pixel", "pixel")


def test_poor_paths_give_the_layers_they_can() -> None:
    path = fakes.fake_path()
    bare = SimpleNamespace(vertices_mm=path.vertices_mm, vertex_times_ps=path.vertex_times_ps)
    assert list(by_name(layers_from_path(bare))) == ["pulse, event time", "vertices"]
    nowhere = SimpleNamespace(vertices_mm=np.zeros((1, 3)), vertex_times_ps=np.zeros(1))
    assert layers_from_path(nowhere) == []
    unsure = replace(path, covariance=path.covariance * np.nan)
    assert np.isnan(by_name(layers_from_path(unsure))["vertices"][1]["features"]["x_std_mm"]).all()
    with pytest.raises(ValueError, match="step_ps must be positive"):
        layers_from_path(path, step_ps=0.0)


def test_the_reader_takes_our_files_and_leaves_others(tmp_path: Path) -> None:
    fakes.fake_path().save(tmp_path / "path.h5")
    write(Histograms(np.ones((2, 3, 4), np.uint16), bin_width_ps=55.0), tmp_path / "counts.h5")
    (tmp_path / "other.h5").write_bytes(b"\x89HDF\r\n\x1a\nnothing")
    (tmp_path / "empty.h5").touch()
    for foreign in ("other.h5", "empty.h5", "absent.h5"):
        assert napari_get_reader(str(tmp_path / foreign)) is None
    assert napari_get_reader([]) is None
    both = [str(tmp_path / "path.h5"), str(tmp_path / "counts.h5")]
    assert napari_get_reader([*both, str(tmp_path / "other.h5")]) is None
    reader = napari_get_reader(both)
    assert reader is not None
    names = list(by_name(reader(both)))
    assert names[0] == "path: pulse, event time"
    assert names[-1] == "counts: counts"


def test_the_manifest_is_valid_and_names_a_reader_that_exists() -> None:
    manifest = files("lightflight.view").joinpath("napari.yaml")
    # npe2's own checks, in a process of its own: it warns, and warnings are errors here.
    code = (
        "import sys\n"
        "try:\n    from npe2 import PluginManifest\n"
        "except ImportError:\n    sys.exit(77)\n"
        "manifest = PluginManifest.from_file(sys.argv[1])\n"
        "manifest.validate_imports()\n"
        "print(manifest.contributions.readers[0].command)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(manifest)], capture_output=True, text=True, check=False
    )
    if done.returncode == 77:
        pytest.skip("npe2 is not installed")
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "lightflight.get_reader"


def test_napari_finds_the_manifest() -> None:
    found = [e for e in entry_points(group="napari.manifest") if e.name == "lightflight"]
    assert found, "install the package again: its entry points have changed"
    assert {e.value for e in found} == {"lightflight.view:napari.yaml"}

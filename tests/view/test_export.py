"""Files other programs open, read back with readers that are not ours."""

from __future__ import annotations

import csv
import json
import struct
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lightflight import Histograms
from lightflight.errors import MissingExtraError
from lightflight.flight import arrival_time_from_event
from lightflight.view.arrays import to_xarray
from lightflight.view.export import files as export
from lightflight.view.export.gltf import write_glb
from lightflight.view.export.tables import table_from_path, write_csv, write_parquet
from lightflight.view.export.vtk import write_vtu
from lightflight.view.figures.timing import draw_times
from tests.view import fakes


def read_csv(file: Path) -> dict[str, Any]:
    with file.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("what", ["samples", "pulses", "vertices"])
def test_csv_holds_the_tables_of_the_path(tmp_path: Path, what: str) -> None:
    path = fakes.fake_path()
    write_csv(path, tmp_path / "path.csv", what=what, samples=50)
    columns = read_csv(tmp_path / "path.csv")
    table = table_from_path(path, what, samples=50)
    assert list(columns) == list(table.dtype.names or ())
    for name, values in columns.items():
        np.testing.assert_allclose(values, table[name].astype(float), rtol=1e-8)


def test_the_vertex_table_is_the_paths() -> None:
    path = fakes.fake_path()
    table = table_from_path(path, "vertices")
    np.testing.assert_array_equal(table["z_mm"], path.vertices_mm[:, 2])
    np.testing.assert_array_equal(table["event_time_std_ps"], path.vertex_std[:, 3])
    with pytest.raises(ValueError, match="choose one of samples, pulses, vertices"):
        table_from_path(path, "corners")


def test_parquet_holds_the_samples_and_says_where_they_are_from(tmp_path: Path) -> None:
    pq = pytest.importorskip("pyarrow.parquet")
    path = fakes.fake_path()
    export.export_path(path, tmp_path / "path.parquet", samples=40)
    read = pq.read_table(tmp_path / "path.parquet")
    table = path.sample(40)
    for name in table.dtype.names or ():
        np.testing.assert_array_equal(read[name].to_numpy(), table[name])
    about = json.loads(read.schema.metadata[b"lightflight"])
    assert about["prior"] == path.prior


def test_mat_opens_as_a_struct(tmp_path: Path) -> None:
    from scipy.io import loadmat

    path = fakes.fake_path()
    export.export_path(path, tmp_path / "path.mat", samples=30)
    read = loadmat(tmp_path / "path.mat", simplify_cells=True)["lightflight"]
    np.testing.assert_array_equal(read["vertices_mm"], path.vertices_mm)
    np.testing.assert_array_equal(read["truth"]["vertices_mm"], fakes.VERTICES_MM)
    np.testing.assert_array_equal(
        read["samples"]["event_time_ps"], path.sample(30)["event_time_ps"]
    )
    np.testing.assert_array_equal(read["pulses"]["used"], path.residuals["used"])
    assert read["prior"] == path.prior
    np.testing.assert_array_equal(read["camera"]["matrix"], path.camera.matrix)


def test_vtu_opens_in_an_independent_reader(tmp_path: Path) -> None:
    meshio = pytest.importorskip("meshio", reason="the independent VTK reader is meshio")
    path = fakes.fake_path()
    file = tmp_path / "path.vtu"
    export.export_path(replace(path, prior="<a--b> & 'c'"), file)
    read = meshio.read(file)
    lines = read.cells_dict["line"]
    legs = read.cell_data["leg"][0]
    which = read.cell_data["estimate"][0]
    assert len(lines) == 3 * 64 + 3
    for leg in range(3):
        mine = lines[(legs == leg) & (which == 0)]
        np.testing.assert_allclose(read.points[mine[0, 0]], path.vertices_mm[leg], atol=1e-9)
        np.testing.assert_allclose(read.points[mine[-1, 1]], path.vertices_mm[leg + 1], atol=1e-9)
        exact = lines[(legs == leg) & (which == 1)]
        np.testing.assert_allclose(read.points[exact[0]], fakes.VERTICES_MM[leg : leg + 2])
    data = read.point_data
    own = np.unique(lines[which == 0])
    arrival = arrival_time_from_event(
        read.points[own], data["event_time_ps"][own], camera_center_mm=path.camera.center_mm
    )
    np.testing.assert_allclose(data["arrival_time_ps"][own], arrival)
    np.testing.assert_array_equal(data["in_view"][own] == 1, path.camera.sees(read.points[own]))
    assert np.isfinite(data["std_mm"][own]).all()


def glb_parts(file: Path) -> tuple[dict[str, Any], bytes]:
    raw = file.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", raw)
    assert (magic, version, length) == (b"glTF", 2, len(raw))
    size, kind = struct.unpack_from("<I4s", raw, 12)
    assert kind == b"JSON"
    document: dict[str, Any] = json.loads(raw[20 : 20 + size])
    binary_size, kind = struct.unpack_from("<I4s", raw, 20 + size)
    assert kind == b"BIN\0"
    return document, raw[28 + size : 28 + size + binary_size]


def accessor(document: dict[str, Any], binary: bytes, number: int) -> Any:
    part = document["accessors"][number]
    view = document["bufferViews"][part["bufferView"]]
    raw = binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    values = np.frombuffer(raw, "<f4" if part["componentType"] == 5126 else "<u4")
    values = values.reshape(part["count"], -1)
    np.testing.assert_array_equal(values.min(axis=0), part["min"])
    np.testing.assert_array_equal(values.max(axis=0), part["max"])
    return values


def test_the_flight_in_glb_is_the_paths(tmp_path: Path) -> None:
    path = fakes.fake_path()
    export.export_path(path, tmp_path / "path.glb")
    document, binary = glb_parts(tmp_path / "path.glb")
    names = [node["name"] for node in document["nodes"]]
    assert {"path", "truth", "mirror 1", "mirror 2", "field of view", "pulse"} <= set(names)
    assert any(name.startswith("errors, 1 sigma x ") for name in names)
    animation = document["animations"][0]
    sampler = animation["samplers"][0]
    seconds = accessor(document, binary, sampler["input"])[:, 0]
    places = accessor(document, binary, sampler["output"])
    assert names[animation["channels"][0]["target"]["node"]] == "pulse"
    np.testing.assert_allclose(places, path.vertices_mm * 1e-3, atol=1e-7)
    np.testing.assert_allclose(
        seconds, (path.vertex_times_ps - path.vertex_times_ps[0]) / 500.0, rtol=1e-6
    )
    # Linear keyframes: anywhere between them the pulse is where position_at says.
    when = 0.5 * (seconds[1] + seconds[2])
    place = [np.interp(when, seconds, places[:, k]) for k in range(3)]
    expected = path.position_at(path.vertex_times_ps[0] + 500.0 * when)[0] * 1e-3
    np.testing.assert_allclose(place, expected, atol=1e-6)
    for k in range(len(document["accessors"])):
        accessor(document, binary, k)


def test_glb_opens_in_an_independent_reader(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh", reason="the independent glTF reader is trimesh")
    path = fakes.fake_path()
    write_glb(path, tmp_path / "path.glb")
    scene = trimesh.load_scene(tmp_path / "path.glb")
    low, high = scene.geometry["path"].bounds
    np.testing.assert_allclose(low, path.vertices_mm.min(axis=0) * 1e-3, atol=2e-3)
    np.testing.assert_allclose(high, path.vertices_mm.max(axis=0) * 1e-3, atol=2e-3)
    assert scene.geometry["pulse"].is_watertight or len(scene.geometry["pulse"].faces) > 100


@pytest.mark.parametrize("spoil", ["errors", "truth", "camera"])
def test_poor_paths_are_exported_without_what_they_lack(tmp_path: Path, spoil: str) -> None:
    path: Any = fakes.fake_path()
    if spoil == "errors":
        path = replace(path, covariance=path.covariance * np.nan)
    elif spoil == "truth":
        path = replace(path, truth=None)
    else:
        path = SimpleNamespace(
            vertices_mm=path.vertices_mm,
            vertex_times_ps=path.vertex_times_ps,
            covariance=path.covariance,
        )
    write_glb(path, tmp_path / "a.glb")
    write_vtu(path, tmp_path / "a.vtu")
    names = [node["name"] for node in glb_parts(tmp_path / "a.glb")[0]["nodes"]]
    lacking = {"errors": "errors, 1 sigma", "truth": "truth", "camera": "field of view"}[spoil]
    assert not any(name.startswith(lacking) for name in names)


def test_xarray_carries_units_and_coordinates() -> None:
    xr = pytest.importorskip("xarray")
    path = fakes.fake_path()
    found = to_xarray(path, samples=20)
    assert isinstance(found, xr.Dataset)
    np.testing.assert_array_equal(found["x_mm"], path.sample(20)["x_mm"])
    assert found["x_mm"].attrs["units"] == "mm"
    assert found["event_time_ps"].attrs["units"] == "ps"
    np.testing.assert_array_equal(found["vertices_mm"], path.vertices_mm)
    near = found["z_mm"].sel(event_time_ps=path.vertex_times_ps[1], method="nearest")
    assert abs(float(near) - path.vertices_mm[1, 2]) < 5
    hist = Histograms(np.arange(24).reshape(2, 3, 4), bin_width_ps=50.0)
    counts = to_xarray(hist)["counts"]
    assert counts.dims == ("row", "col", "code")
    np.testing.assert_allclose(counts["delay_ps"], [25, 75, 125, 175])
    table = to_xarray(fakes.fake_pulses([1, 2], [3, 4], [5.0, 6.0], std_ps=1.0, photons=9.0))
    np.testing.assert_array_equal(table["delay_ps"], [5.0, 6.0])
    with pytest.raises(TypeError, match="got dict"):
        to_xarray({})


@pytest.mark.parametrize(
    ("module", "call", "sentence"),
    [
        ("pyarrow", lambda p: write_parquet(fakes.fake_path(), p), r"\[batch\]"),
        ("xarray", lambda p: to_xarray(fakes.fake_path()), "pip install xarray"),
    ],
)
def test_missing_packages_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, call: Any, sentence: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(MissingExtraError, match=sentence):
        call(tmp_path / "a.parquet")


@pytest.mark.parametrize(
    ("suffix", "magic"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")]
)
def test_figures_are_written_in_the_format_of_their_name(
    tmp_path: Path, suffix: str, magic: bytes
) -> None:
    figure = draw_times(fakes.fake_path()).get_figure(root=True)
    assert figure is not None
    for name in ("a", "b"):
        export.write_figure(figure, tmp_path / f"{name}.{suffix}")
    written = (tmp_path / f"a.{suffix}").read_bytes()
    assert written.startswith(magic)
    # SVG too, whose names were drawn anew: a figure written twice seemed half written.
    assert written == (tmp_path / f"b.{suffix}").read_bytes()


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda p: export.export_path(fakes.fake_path(), p / "a.xlsx"), r"\.csv, \.parquet"),
        (lambda p: write_csv(fakes.fake_path(), p / "a.txt"), r"must end in \.csv"),
        (lambda p: write_csv(fakes.fake_path(), p / "a.csv", samples=1), "at least 2"),
        (lambda p: write_vtu(fakes.fake_path(), p / "a.vtk"), r"must end in \.vtu"),
        (lambda p: write_glb(fakes.fake_path(), p / "a.glb", ps_per_s=0), "ps_per_s"),
        (
            lambda p: write_glb(
                SimpleNamespace(vertices_mm=np.zeros((1, 3)), vertex_times_ps=np.zeros(1)),
                p / "a.glb",
            ),
            "no finite legs",
        ),
        (
            lambda p: write_vtu(
                SimpleNamespace(vertices_mm=np.zeros((1, 3)), vertex_times_ps=np.zeros(1)),
                p / "a.vtu",
            ),
            "no legs",
        ),
        (
            lambda p: export.write_figure(draw_times(fakes.fake_path()).figure, p / "a.txt"),  # type: ignore[arg-type]
            r"must end in \.png",
        ),
    ],
)
def test_wrong_calls_are_refused_and_nothing_is_written(
    tmp_path: Path, call: Any, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        call(tmp_path)
    assert list(tmp_path.iterdir()) == []

"""Write the small files that every later version must be able to read.

Run once for each schema version that is released, never again for an old one: the test
`tests/formats/test_schema.py` reads all of them and knows what is in them.

    python tools/make_schema_files.py
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import lightflight as lf
from lightflight.files.store import SCHEMA_VERSION
from lightflight.flight import event_times_from_vertices
from lightflight.path.alternative import Alternative
from lightflight.path.tables import RESIDUAL_DTYPE, Goodness
from lightflight.timing.clock.response import Response

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "data"
CLOCK = {
    "bin_width_ps": 55.0,
    "laser_period_ps": 50_000.0,
    "periods_per_frame": 4000,
    "reversed_codes": True,
    "first_edge_ps": -3.5,
    "no_photon_code": 0,
}
SETTINGS = {"temperature_c": 21.5, "camera": "PF32", "notes": ["µ"]}


def known_frames() -> np.ndarray:
    """(9, 2, 3) codes below 32 that follow from a formula; a third of them 0."""
    index = np.arange(9 * 2 * 3)
    codes = np.where(index % 3 == 1, 0, index * 7 % 31 + 1)
    return codes.reshape(9, 2, 3).astype(np.uint16)


def known_path() -> lf.LightPath:
    """Two legs with everything a path file can hold; numbers that follow from formulas."""
    vertices = np.array([(0.0, 0.0, 0.0), (300.0, 20.0, 40.0), (10.0, 45.0, 15.0)])
    table = np.zeros(3, RESIDUAL_DTYPE)
    for k, name in enumerate(RESIDUAL_DTYPE.names or ()):
        table[name] = (np.arange(3) + k) % 2 if name == "used" else np.arange(3) + k
    half = np.eye(12) / 8
    return lf.LightPath(
        vertices,
        event_times_from_vertices(vertices, emission_time_ps=2000.0),
        2 * half,
        camera=lf.Camera.facing_plane(center_mm=(150.0, 20.0)),
        source=lf.Source((0.0, 0.0, 0.0), position_std_mm=(0.5, 0.5, 1.0), pulse_fwhm_ps=68.0),
        medium=lf.Medium(1.33, 1.0),
        goodness=Goodness(3.5, 2, 3, 0, 0.75, 0.0, True),
        covariance_parts={"photon": half, "pixel": 0.5 * half, "shared": 0.5 * half},
        residuals=table,
        prior="source ± (0.5, 0.5, 1) mm",
        statements=("Made by hand: µ.",),
        truth=SimpleNamespace(vertices_mm=vertices + 1.0, vertex_times_ps=np.arange(3.0)),
        provenance={"command": "tools/make_schema_files.py"},
    )


def known_path_with_a_gap() -> lf.LightPath:
    """Three legs of which nobody saw the second: schema 2 of paths."""
    vertices = np.array(
        [(0.0, 0.0, 0.0), (400.0, 0.0, 30.0), (400.0, 45.0, 30.0), (10.0, 45.0, 0.0)]
    )
    return replace(
        known_path(),
        vertices_mm=vertices,
        vertex_times_ps=event_times_from_vertices(vertices, emission_time_ps=2000.0),
        covariance=np.eye(16),
        covariance_parts={"photon": 0.5 * np.eye(16), "shared": 0.5 * np.eye(16)},
        truth=None,
        unseen_legs=(1,),
    )


def known_path_that_forks() -> lf.LightPath:
    """Three legs, two of which leave a beam splitter: schema 3 of paths."""
    path = known_path_with_a_gap()
    vertices = np.array(
        [(0.0, 0.0, 0.0), (200.0, 20.0, 10.0), (375.0, 37.5, 18.75), (200.0, 80.0, 0.0)]
    )
    chains = [[0, 1, 2], [0, 1, 3]]
    times = np.zeros(4)
    for chain in chains:
        times[chain] = event_times_from_vertices(vertices[chain], emission_time_ps=2000.0)
    truth = SimpleNamespace(
        vertices_mm=vertices + 1.0, vertex_times_ps=times + 1.0, forks=((2, 1),)
    )
    return replace(
        path,
        vertices_mm=vertices,
        vertex_times_ps=times,
        truth=truth,
        unseen_legs=(),
        forks=((2, 1),),
    )


def known_path_with_an_alternative() -> lf.LightPath:
    """Two legs, or one of them turned in depth: schema 4 of paths."""
    path = known_path()
    vertices = path.vertices_mm * [1.0, 1.0, -1.0]
    other = replace(path, vertices_mm=vertices, statements=("Made by hand too.",))
    return replace(path, alternatives=(Alternative(other, -1.25, "leg 1 turned in depth"),))


def known_path_through_glass() -> lf.LightPath:
    """One leg that a block of glass makes three: schema 4 of paths."""
    block = lf.Block(
        (200.0, 0.0, 0.0), (1.0, 0.0, 0.0), thickness_mm=20.0, diameter_mm=25.0,
        glass=lf.Material(1.5, 1.53), around=lf.Material(1.0, 1.0),
    )  # fmt: skip
    return replace(
        known_path_with_a_gap(),
        vertices_mm=np.array([(x, 0.0, 0.0) for x in (0.0, 190.0, 210.0, 400.0)]),
        vertex_times_ps=2000.0 + np.array([0.0, 190.0, 190.0 + 30.6, 380.0 + 30.6]) / 0.299792458,
        medium=lf.Medium(1.0, 1.0, blocks=(block,)),
        unseen_legs=(),
    )


def known_calibration() -> lf.TimingCalibration:
    """A nominal clock with a gain and a delay of its own in every pixel."""
    recording = lf.Recording.from_frames(known_frames(), n_codes=32, **CLOCK)
    index = np.arange(6.0).reshape(2, 3)
    nominal = lf.TimingCalibration.nominal(lf.histogram(recording))
    return replace(
        nominal,
        gain=1.0 + index / 1000,
        skew_ps=10.0 * index,
        notes=("Made by hand: µ.",),
        provenance={"command": "tools/make_schema_files.py"},
    )


def known_calibration_with_tail() -> lf.TimingCalibration:
    """The same, of a flat whose pulses have a tail: schema 2 of calibrations."""
    shape = Response.with_tail(std_ps=60.0, tail_ps=120.0, tail_share=0.25)
    sparse = slice(None, None, 25)
    curve = np.stack([shape.time_ps[sparse], shape.density[sparse]])
    return replace(known_calibration(), response_curve=curve, response_place_ps=2.5)


def known_calibration_of_unequal_codes() -> lf.TimingCalibration:
    """The same, of codes that differ one by one: schema 3 of calibrations."""
    widths = 1.0 + 0.05 * np.sin(np.arange(32.0) ** 2)
    return replace(known_calibration(), code_widths=widths, code_width_std=0.004)


def main() -> None:
    """Write the files of the current version."""
    FOLDER.mkdir(exist_ok=True)
    recording = lf.Recording.from_frames(known_frames(), n_codes=32, settings=SETTINGS, **CLOCK)
    dense = lf.Recording.from_frames(known_frames(), n_codes=32)
    for name, record in (
        ("recording", recording),
        ("frames", dense),
        ("histograms", lf.histogram(recording)),
    ):
        path = FOLDER / f"{name}_schema_{SCHEMA_VERSION}.h5"
        if path.exists():
            print(f"{path.name} exists and stays as it is")
            continue
        lf.write(record, path, provenance={"command": "tools/make_schema_files.py"})
        print(f"{path.name}: {path.stat().st_size} bytes")
    for name, version, result in (
        ("path", 1, known_path()),
        ("path", 2, known_path_with_a_gap()),
        ("path", 3, known_path_that_forks()),
        ("path", 4, known_path_with_an_alternative()),
        ("path_through_glass", 4, known_path_through_glass()),
        ("calibration", 1, known_calibration()),
        ("calibration", 2, known_calibration_with_tail()),
        ("calibration", 3, known_calibration_of_unequal_codes()),
    ):
        path = FOLDER / f"{name}_schema_{version}.h5"
        if path.exists():
            print(f"{path.name} exists and stays as it is")
            continue
        result.save(path)
        print(f"{path.name}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()

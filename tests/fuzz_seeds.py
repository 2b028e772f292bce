"""Small valid files of every format, for `fuzz_readers` to damage: ours and those of others.

Files of vendors come from writers that share nothing with the readers: put together byte by byte,
written by tttrlib and by ptufile, and, where LIGHTFLIGHT_DATA has them, the start of files of
instruments.
"""

from __future__ import annotations

import gzip
import io
import os
import struct
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tests.formats.made_by_hand import (
    ptu_bytes,
    ptu_image_bytes,
    sdt_bytes,
    spc_bytes,
    with_fewer_pixels,
    with_fewer_records,
)
from tests.fuzz_structure import Fields, fields_of


@dataclass(frozen=True, eq=False)
class Seed:
    """One valid file and how it is read."""

    name: str
    """File name, whose suffix tells the format."""

    content: bytes
    """What it holds; for a folder, a zip of it."""

    hints: Mapping[str, Any] = field(default_factory=dict)
    """Hints it is read with."""

    inner: str | None = None
    """How the interesting part is packed: "zip", "gzip", "mat", "hdf5" or "folder"."""

    weight: float = 1.0
    """Share of the files; less for readers that are slow to start."""

    isolated: bool = False
    """Read in a process of its own each time, by a vendor's reader."""

    reads: str = "recording"
    """What reads it: "recording", "calibration", "path", "table" (of pulses) or "points"."""

    checked: bool = False
    """Holds checksums over all it says: other values are never read in silence."""

    @cached_property
    def fields(self) -> Fields:
        """Where its structure keeps numbers."""
        return fields_of(self.name, self.content)


def seeds(folder: Path) -> list[Seed]:
    """A small valid file of every format whose reader is installed."""
    import lightflight as lf

    rng = np.random.default_rng(20200520)
    cube = rng.poisson(2.0, (4, 4, 32)).astype(np.uint16)
    clock: dict[str, Any] = {"bin_width_ps": 55.0, "laser_period_ps": 50_000.0}
    hist = lf.Histograms(cube, **clock, settings={"room": "B9"})
    codes = rng.integers(1, 32, (60, 4, 4))
    frames = np.where(rng.random(codes.shape) < 0.2, codes, 0).astype(np.uint16)
    recording = lf.Recording.from_frames(
        frames, n_codes=32, no_photon_code=0, periods_per_frame=10, **clock
    )
    dense = lf.Recording.from_frames(frames, n_codes=32)
    axes = {"axes": "yxt"}
    found = [
        _written(folder, "hist.h5", hist, inner="hdf5", checked=True),
        _written(folder, "events.h5", recording, inner="hdf5", checked=True),
        _written(folder, "frames.h5", dense, inner="hdf5", checked=True),
        _written(folder, "photons.photon.h5", recording, inner="hdf5"),
        _written(folder, "x.npz", hist, inner="zip", checked=True),
        _written(folder, "x.mat", hist, inner="mat", checked=True),
        _written(folder, "x.bin", dense, hints={"shape": [4, 4], "n_codes": 32}),
        Seed("footers.bin", _with_footers(frames), {"shape": [4, 4], "n_codes": 32}),
        Seed("x.npy", _npy(cube), axes),
        Seed("f.npy", _npy(frames), {"axes": "fyx", "n_codes": 32}),
        Seed("pf32.npz", _pf32_npz(cube), inner="zip", checked=True),
        Seed("text.txt", _pf32_text(cube), {"shape": [4, 4]}),
        Seed(
            "text.txt.gz",
            gzip.compress(_pf32_text(cube)),
            {"shape": [4, 4]},
            inner="gzip",
            checked=True,
        ),
        Seed("plain.mat", _plain_mat(cube), axes),
        Seed("new.mat", _new_mat(folder, cube), axes, inner="hdf5"),
        Seed("other.h5", _other_hdf5(folder, cube), inner="hdf5"),
        *_seeds_of_other_records(folder),
    ]
    if _installed("zarr"):
        lf.write(hist, folder / "x.zarr")
        content = _zipped(folder / "x.zarr")
        found.append(Seed("x.zarr", content, inner="folder", weight=0.5, checked=True))
    return found + _seeds_of_vendors(folder, rng)


def _seeds_of_vendors(folder: Path, rng: np.random.Generator) -> list[Seed]:
    """What instruments write, by writers that share no code with the readers."""
    contents = {
        "tiny.spc": np.array([0x8000005F, 5 << 16, 9 << 16, 0xC0000001], "<u4").tobytes(),
        "x.spc": spc_bytes(rng.integers(0, 4096, 300), rng.integers(0, 4, 300)),
        "tttrlib.spc": (Path(__file__).parent / "data" / "tttrlib.spc").read_bytes(),
    }
    if _installed("ptufile"):
        contents["x.ptu"] = ptu_bytes(rng.integers(0, 3000, 200))
        contents["image.ptu"] = ptu_image_bytes(rng.integers(0, 3000, (4, 4, 3)))
        contents["ptufile.ptu"] = _ptu_of_ptufile(folder / "ptufile.ptu", rng)
    if _installed("sdtfile"):
        contents["x.sdt"] = sdt_bytes(rng.poisson(9.0, (2, 64)))
        contents["packed.sdt"] = sdt_bytes(rng.poisson(9.0, (2, 64)), packed=True)
    contents |= {name: one for name, one in _of_instruments().items() if _reads(name)}
    kinds = [Path(name).suffix for name in contents]
    return [
        # Each kind alike, however many files stand for it.
        Seed(
            name,
            content,
            weight=(2.5 if name.endswith(".spc") else 0.05) / kinds.count(Path(name).suffix),
            isolated=not name.endswith(".spc"),
        )
        for name, content in contents.items()
    ]


def _reads(name: str) -> bool:
    return name.endswith(".spc") or _installed(f"{Path(name).suffix[1:]}file")


def _ptu_of_ptufile(path: Path, rng: np.random.Generator) -> bytes:
    import ptufile

    image = rng.poisson(0.1, (4, 4, 64)).astype(np.uint8)
    ptufile.imwrite(path, image, 5e-8, 1e-10)
    return path.read_bytes()


def _of_instruments() -> dict[str, bytes]:
    """The start of real files, with few records or pixels; none where it is not known where."""
    folder = Path(os.environ.get("LIGHTFLIGHT_DATA", ""), "tcspc-vendor-files")
    if not folder.is_absolute() or not folder.is_dir():
        return {}
    ptu = (folder / "hazelnut_FLIM_single_image.ptu").read_bytes()
    sdt = (folder / "seminal_receptacle_FLIM_single_image.sdt").read_bytes()
    return {
        "real.spc": (folder / "test_noise.spc").read_bytes()[:8000],
        "real.ptu": with_fewer_records(ptu, 40_000),
        "real.sdt": with_fewer_pixels(sdt, np.arange(8 * 8 * 256) % 5),
    }


def _seeds_of_other_records(folder: Path) -> list[Seed]:
    """What is read beside recordings: calibrations, paths, pulses, tables of points."""
    from lightflight.files.store import save_record

    released = Path(__file__).parent / "data"
    pulses = {"row": np.arange(5, dtype=np.int32), "delay_ps": np.linspace(0, 9, 5)}
    save_record(folder / "pulses.h5", kind="pulses", arrays=pulses, attributes={"method": "x"})
    points = np.random.default_rng(3).normal(size=(6, 3))
    pixels = np.random.default_rng(4).normal(size=(6, 2))
    packed = io.BytesIO()
    np.savez_compressed(packed, points_mm=points, pixels=pixels, shape=(4, 4))
    lines = [",".join(map(str, row)) for row in np.hstack([points, pixels])]
    text = "\n".join(["x_mm,y_mm,z_mm,row,col", *lines])
    calibration = (released / "calibration_schema_1.h5").read_bytes()
    path = (released / "path_schema_1.h5").read_bytes()
    table = (folder / "pulses.h5").read_bytes()
    return [
        Seed("calibration.h5", calibration, inner="hdf5", reads="calibration"),
        Seed("path.h5", path, inner="hdf5", reads="path"),
        Seed("pulses.h5", table, inner="hdf5", reads="table", weight=0.3, checked=True),
        Seed("points.csv", text.encode(), reads="points", weight=0.3),
        Seed(
            "points.npz", packed.getvalue(), inner="zip", reads="points", weight=0.3, checked=True
        ),
    ]


def _with_footers(frames: np.ndarray) -> bytes:
    """Frames as the camera sends them: 16 bytes after each, with its number in them."""
    out = b""
    for number, frame in enumerate(frames):
        out += frame.astype("<u2").tobytes() + struct.pack("<HHIHHHH", 0, 0, number, 1, 2, 3, 4)
    return out


def _installed(module: str) -> bool:
    import importlib.util

    return importlib.util.find_spec(module) is not None


def _written(folder: Path, name: str, record: Any, **more: Any) -> Seed:
    import lightflight as lf

    lf.write(record, folder / name)
    return Seed(name, (folder / name).read_bytes(), **more)


def _npy(values: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.save(out, values)
    return out.getvalue()


def _pf32_npz(cube: np.ndarray) -> bytes:
    out = io.BytesIO()
    np.savez_compressed(
        out, hist=cube, n_frames=500, exposure_us=100.0, sync_hz=20_000_000, mode="laser_master"
    )
    return out.getvalue()


def _pf32_text(cube: np.ndarray) -> bytes:
    lines = ["Reading histogram data"]
    for pixel, row in enumerate(cube.reshape(-1, cube.shape[-1])):
        lines += [f"Pixel {pixel}", " ".join(map(str, row))]
    return ("\n".join([*lines, "", "20000000", "frames = 0"]) + "\n").encode()


def _plain_mat(cube: np.ndarray) -> bytes:
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, {"data_cube": cube, "exposure": 2.0, "label": "text", "s": {"a": 1}})
    return out.getvalue()


def _new_mat(folder: Path, cube: np.ndarray) -> bytes:
    import h5py

    with h5py.File(folder / "new.mat", "w", userblock_size=512) as file:
        file.create_dataset("series", data=cube.T, chunks=(8, 4, 4), compression="gzip")
        file["series"].attrs["MATLAB_class"] = np.bytes_("uint16")
    content = (folder / "new.mat").read_bytes()
    return b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + content[128:]


def _other_hdf5(folder: Path, cube: np.ndarray) -> bytes:
    import h5py

    with h5py.File(folder / "other.h5", "w") as file:
        file.create_dataset("run/cube", data=cube, chunks=(2, 4, 32), compression="gzip")
        file["run/cube"].attrs["axes"] = "yxt"
        file["run"].attrs["exposure_s"] = 2.5
        file["names"] = np.array([b"a", b"b"])
    return (folder / "other.h5").read_bytes()


def _zipped(folder: Path) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, file.relative_to(folder).as_posix())
    return out.getvalue()

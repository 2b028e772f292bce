"""Damage files in ways that readers believe, and see that each gives one FileFormatError.

Run it for as long as it is given:

    python -m tests.fuzz_readers --files 20000 --seed 1

Every format starts from a small valid file, and so do calibrations, paths and tables of points.
A mutation knows the structure (`fuzz_structure`): it changes the numbers of headers, directories
and tags to values that hurt, does so inside compressed parts too, and rebuilds HDF5 files with
false types, shapes, sizes, links and attributes. Or it knows none (`fuzz_bytes`): numbers in
texts, bits anywhere; stretches that are cut, doubled and swapped. Each file is read, and counted,
in a process of its own kind that may be killed: a crash, a hang, memory beyond bounds, a
traceback, or an error that is not one sentence with the file's name is a finding, and its file is
kept. Reading something plausible is none: not every change is damage.
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import io
import json
import os
import select
import shutil
import struct
import subprocess
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tests.fuzz_bytes import HURTFUL, HURTFUL_WIDE, mutated
from tests.fuzz_structure import Fields, fields_of, rebuilt_hdf5, with_other_member, zip_bomb

TIME_LIMIT_S = 20.0
MEMORY_LIMIT_BYTES = 1 << 30


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

    @cached_property
    def fields(self) -> Fields:
        """Where its structure keeps numbers."""
        return fields_of(self.name, self.content)


@dataclass(frozen=True)
class Finding:
    """One mutated file that was not refused as it should be."""

    seed: str
    """Name of the valid file."""

    number: int
    """Which mutation of the run."""

    what: str
    """What happened."""


# --- valid files ------------------------------------------------------------------------


def seeds(folder: Path) -> list[Seed]:
    """A small valid file of every format whose reader is installed."""
    import lightflight as lf
    from tests.formats.made_by_hand import ptu_bytes, sdt_bytes

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
        _written(folder, "hist.h5", hist, inner="hdf5"),
        _written(folder, "events.h5", recording, inner="hdf5"),
        _written(folder, "frames.h5", dense, inner="hdf5"),
        _written(folder, "photons.photon.h5", recording, inner="hdf5"),
        _written(folder, "x.npz", hist, inner="zip"),
        _written(folder, "x.mat", hist, inner="mat"),
        _written(folder, "x.bin", dense, hints={"shape": [4, 4], "n_codes": 32}),
        Seed("footers.bin", _with_footers(frames), {"shape": [4, 4], "n_codes": 32}),
        Seed("x.npy", _npy(cube), axes),
        Seed("f.npy", _npy(frames), {"axes": "fyx", "n_codes": 32}),
        Seed("pf32.npz", _pf32_npz(cube), inner="zip"),
        Seed("text.txt", _pf32_text(cube), {"shape": [4, 4]}),
        Seed("text.txt.gz", gzip.compress(_pf32_text(cube)), {"shape": [4, 4]}, inner="gzip"),
        Seed("plain.mat", _plain_mat(cube), axes),
        Seed("new.mat", _new_mat(folder, cube), axes, inner="hdf5"),
        Seed("other.h5", _other_hdf5(folder, cube), inner="hdf5"),
        Seed("x.spc", np.array([0x8000005F, 5 << 16, 9 << 16, 0xC0000001], "<u4").tobytes()),
        *_seeds_of_other_records(folder),
    ]
    if _installed("zarr"):
        lf.write(hist, folder / "x.zarr")
        found.append(Seed("x.zarr", _zipped(folder / "x.zarr"), inner="folder", weight=0.5))
    if _installed("ptufile"):
        found.append(
            Seed("x.ptu", ptu_bytes(rng.integers(0, 3000, 200)), weight=0.05, isolated=True)
        )
    if _installed("sdtfile"):
        found.append(
            Seed("x.sdt", sdt_bytes(rng.poisson(9.0, (2, 64))), weight=0.05, isolated=True)
        )
    return found


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
        Seed("pulses.h5", table, inner="hdf5", reads="table", weight=0.3),
        Seed("points.csv", text.encode(), reads="points", weight=0.3),
        Seed("points.npz", packed.getvalue(), inner="zip", reads="points", weight=0.3),
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


# --- mutations --------------------------------------------------------------------------


def mutated_file(seed: Seed, rng: np.random.Generator) -> bytes:
    """A mutation of a valid file: of its structure, of its bytes, or of what is packed in it."""
    if seed.inner is None or rng.random() < 0.3:
        if seed.fields and rng.random() < 0.7:
            content = _with_other_fields(seed, rng)
            return content if rng.random() < 0.7 else mutated(content, rng)
        return mutated(seed.content, rng)
    if seed.inner == "hdf5":
        content = rebuilt_hdf5(seed.content, rng)
        return content if rng.random() < 0.9 else mutated(content, rng)
    if seed.inner == "zip" and rng.random() < 0.1:
        return zip_bomb(seed.content, rng)
    if seed.inner == "gzip":
        return gzip.compress(mutated(gzip.decompress(seed.content), rng))
    if seed.inner == "mat":
        return _mat_with_mutated_element(seed.content, rng)
    return with_other_member(seed.content, rng, lambda member: mutated(member, rng))


def _with_other_fields(seed: Seed, rng: np.random.Generator) -> bytes:
    """One to three numbers of the structure changed: to one that hurts, or to one nearby."""
    out = bytearray(seed.content)
    for _ in range(int(rng.integers(1, 4))):
        at, width = seed.fields[int(rng.integers(len(seed.fields)))]
        values = HURTFUL_WIDE if width == 8 else HURTFUL
        value = values[int(rng.integers(len(values)))]
        if rng.random() < 0.4:
            value = int.from_bytes(out[at : at + width], "little") + int(rng.integers(-9, 10))
        out[at : at + width] = (value & ((1 << 8 * width) - 1)).to_bytes(width, "little")
    return bytes(out)


def _mat_with_mutated_element(content: bytes, rng: np.random.Generator) -> bytes:
    elements = []
    at = 128
    while at < len(content):
        kind, n_bytes = struct.unpack_from("<II", content, at)
        elements.append((kind, content[at + 8 : at + 8 + n_bytes]))
        at += 8 + n_bytes
    chosen = int(rng.integers(len(elements)))
    out = content[:128]
    for index, (kind, body) in enumerate(elements):
        if index == chosen:
            body = zlib.compress(mutated(zlib.decompress(body), rng))
        out += struct.pack("<II", kind, len(body)) + body
    return out


# --- a process that may be killed -------------------------------------------------------


class Reader:
    """A child process that reads one file after another; made anew when it dies."""

    def __init__(self) -> None:
        self._child: subprocess.Popen[str] | None = None

    def outcome(self, path: Path, hints: Mapping[str, Any], reads: str = "recording") -> str:
        """What reading a file came to: "read", "refused", or what is wrong."""
        child = self._living_child()
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            task = {"path": str(path), "hints": dict(hints), "reads": reads}
            child.stdin.write(json.dumps(task) + "\n")
            child.stdin.flush()
        except BrokenPipeError:
            self.close()
            return "crash: it ended after the file before"
        ready, _, _ = select.select([child.stdout], [], [], TIME_LIMIT_S)
        if not ready:
            self.close()
            return f"hang: no answer in {TIME_LIMIT_S:.0f} s"
        line = child.stdout.readline()
        if not line:
            code = child.wait()
            self._child = None
            return f"crash: exit code {code}"
        return str(json.loads(line))

    def _living_child(self) -> subprocess.Popen[str]:
        if self._child is None:
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
            self._child = subprocess.Popen(
                [sys.executable, __file__, "--reader"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                env=environment,
            )
        return self._child

    def kill(self) -> None:
        """Let the child die as if it had crashed."""
        if self._child is not None:
            self._child.kill()
            self._child.wait()

    def close(self) -> None:
        """End the child."""
        if self._child is not None:
            self._child.kill()
            self._child.wait()
            for pipe in (self._child.stdin, self._child.stdout):
                if pipe is not None:
                    with contextlib.suppress(BrokenPipeError):
                        pipe.close()
            self._child = None


def _serve() -> None:
    """Read files named on stdin and answer on stdout, until stdin ends."""
    import resource
    import warnings

    from lightflight.files import filecheck
    from lightflight.formats import isolation

    # What readers may take is told to them, and kept track of.
    filecheck.free_memory_bytes = lambda: MEMORY_LIMIT_BYTES  # type: ignore[assignment]
    isolation.TIME_LIMIT_S = TIME_LIMIT_S / 2
    warnings.simplefilter("ignore")
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # nothing a library prints may look like an answer
    for line in sys.stdin:
        task = json.loads(line)
        answer = _try_to_read(task["path"], task["hints"], task["reads"])
        holders = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
        peak = max(resource.getrusage(holder).ru_maxrss for holder in holders) * 1024
        if peak > 3 * MEMORY_LIMIT_BYTES:
            answer = f"memory: {peak / 1e9:.1f} GB"
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _try_to_read(path: str, hints: Mapping[str, Any], reads: str) -> str:
    from lightflight.errors import FileFormatError

    try:
        record = _read(path, hints, reads)
    except FileFormatError as error:
        text = str(error)
        if path not in text or "\n" in text:
            return f"error that is not one sentence with the file's name: {text[:300]!r}"
        return "refused"
    except BaseException as error:  # noqa: BLE001  (that is what is looked for)
        return f"{type(error).__name__}: {str(error)[:300]}"
    return _try_to_count(record) if reads == "recording" else "read"


def _read(path: str, hints: Mapping[str, Any], reads: str) -> Any:
    """As the commands read it; what is believed must then also serve."""
    import lightflight as lf

    match reads:
        case "calibration":
            timing = lf.TimingCalibration.load(path)
            return timing.code_intervals_ps([0], [0])
        case "path":
            found = lf.LightPath.load(path, try_newer=True)
            return found.sample(20), [leg.angle_deg for leg in found.legs]
        case "table":
            from lightflight.files.store import load_record

            return load_record(path, kind="pulses")
        case "points":
            from lightflight.formats.point_tables import points_from_file

            return points_from_file(Path(path))
    return lf.read(path, **hints)


def _try_to_count(record: Any) -> str:
    import lightflight as lf
    from lightflight.errors import FileFormatError

    try:
        lf.histogram(record)
    except FileFormatError:
        return "refused"
    except ValueError as error:
        # A plausible file may still describe a cube that does not fit.
        return "refused" if " GB are free: " in str(error) else f"count: {error}"
    except BaseException as error:  # noqa: BLE001
        return f"count: {type(error).__name__}: {str(error)[:300]}"
    return "read"


# --- a run ------------------------------------------------------------------------------


def run(
    n_files: int,
    *,
    seed: int = 0,
    keep: Path | None = None,
    only: str | None = None,
    vendors: float = 1.0,
    report: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, dict[str, int]], list[Finding]]:
    """Read `n_files` mutated files; those of vendors' readers `vendors` times as often.

    Returns
    -------
    tally : dict
        By valid file, how many were read and how many refused.
    findings : list of Finding
        The rest; their files are copied to `keep`.
    """
    tally: dict[str, dict[str, int]] = {}
    findings: list[Finding] = []
    reader = Reader()
    with tempfile.TemporaryDirectory(prefix="lightflight-fuzz-") as name:
        folder = Path(name)
        for number, (one, content) in enumerate(_files(folder, n_files, seed, only, vendors)):
            path = placed(folder / "now", one, content)
            if path is None:
                continue
            outcome = reader.outcome(path, one.hints, one.reads)
            count = tally.setdefault(one.name, {"read": 0, "refused": 0, "found": 0})
            count[outcome if outcome in count else "found"] += 1
            if outcome.startswith("memory"):  # the most there was: the next starts afresh
                reader.close()
            if outcome not in ("read", "refused"):
                findings.append(Finding(one.name, number, outcome))
                report(f"{one.name} #{number}: {outcome}")
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{number:06d}-{one.name}").write_bytes(content)
        reader.close()
    return tally, findings


def _files(
    folder: Path, n_files: int, seed: int, only: str | None, vendors: float
) -> Iterator[tuple[Seed, bytes]]:
    """Mutated files, formats taking turns; the same for the same `seed`."""
    made = folder / "made"
    made.mkdir()
    valid = [one for one in seeds(made) if only is None or only in one.name]
    rng = np.random.default_rng(seed)
    weights = np.array([one.weight * (vendors if one.isolated else 1.0) for one in valid])
    for choice in rng.choice(len(valid), n_files, p=weights / weights.sum()):
        yield valid[choice], mutated_file(valid[choice], rng)


def placed(folder: Path, seed: Seed, content: bytes) -> Path | None:
    """Put a mutated file where it is read; None where a folder cannot be unpacked."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    path = folder / seed.name
    if seed.inner != "folder":
        path.write_bytes(content)
        return path
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            archive.extractall(path)
    except Exception:  # noqa: BLE001  (our own packing, not what is tested)
        return None
    return path


def main() -> int:
    """Run from the command line; exit code 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=20_000)
    parser.add_argument("--seed", type=int, help="of an earlier run, to do it again")
    parser.add_argument(
        "--vendors", type=float, default=5.0, help="so many times as many for vendors' readers"
    )
    parser.add_argument("--only", help="part of a name of a valid file")
    parser.add_argument("--keep", type=Path, help="folder for the files of findings")
    parser.add_argument("--reader", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.reader:
        _serve()
        return 0
    start = time.monotonic()
    number = int.from_bytes(os.urandom(4)) if options.seed is None else options.seed
    _say(f"seed {number}")
    tally, findings = run(
        options.files,
        seed=number,
        keep=options.keep,
        only=options.only,
        vendors=options.vendors,
        report=_say,
    )
    for name, count in sorted(tally.items()):
        _say(f"{name:20s}" + "".join(f"  {key} {value:6d}" for key, value in count.items()))
    _say(f"{len(findings)} findings in {time.monotonic() - start:.0f} s")
    return 1 if findings else 0


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())

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
import os
import shutil
import struct
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from tests.fuzz_bytes import HURTFUL, HURTFUL_WIDE, mutated
from tests.fuzz_process import Reader, Surroundings
from tests.fuzz_seeds import Seed, seeds
from tests.fuzz_structure import rebuilt_hdf5, with_other_member, zip_bomb


@dataclass(frozen=True)
class Finding:
    """One mutated file that was not refused as it should be."""

    seed: str
    """Name of the valid file."""

    number: int
    """Which mutation of the run."""

    what: str
    """What happened."""


@dataclass(frozen=True, eq=False)
class Mutant:
    """A valid file that was changed."""

    seed: Seed

    content: bytes

    made_new: bool = False
    """Whether it comes with new checksums: that is another file, and no damage."""

    beside: Mapping[str, bytes] = field(default_factory=dict)
    """Other files that lie in its folder."""

    change: str = ""
    """What was changed, in words."""


# --- mutations --------------------------------------------------------------------------


def mutated_file(seed: Seed, rng: np.random.Generator) -> bytes:
    """A mutation of a valid file: of its structure, of its bytes, or of what is packed in it."""
    return mutation(seed, rng)[0]


def mutation(seed: Seed, rng: np.random.Generator) -> tuple[bytes, bool]:
    """The same, and whether it comes with new checksums: that is another file, and no damage."""
    if seed.inner is None or rng.random() < 0.3:
        if seed.fields and rng.random() < 0.7:
            content = _with_other_fields(seed, rng)
            return content if rng.random() < 0.7 else mutated(content, rng), False
        return mutated(seed.content, rng), False
    if seed.inner == "hdf5":
        content = rebuilt_hdf5(seed.content, rng)
        made_new = not _has_mark(content)
        return content if rng.random() < 0.9 else mutated(content, rng), made_new
    if seed.inner == "zip" and rng.random() < 0.1:
        return zip_bomb(seed.content, rng), True
    if seed.inner == "gzip":
        return gzip.compress(mutated(gzip.decompress(seed.content), rng)), True
    if seed.inner == "mat":
        return _mat_with_mutated_element(seed.content, rng), True
    content = with_other_member(seed.content, rng, lambda member: mutated(member, rng))
    # The digest of a folder is over all its files.
    return content, seed.inner != "folder"


def _has_mark(content: bytes) -> bool:
    """Whether one of our files still says that it has a digest."""
    with contextlib.suppress(Exception), h5py.File(io.BytesIO(content), "r") as file:
        return "digest" in file.attrs or "sealed" in file.attrs
    return False


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


# --- a run ------------------------------------------------------------------------------


def run(
    n_files: int,
    *,
    seed: int = 0,
    keep: Path | None = None,
    only: str | None = None,
    vendors: float = 1.0,
    first: int = 0,
    report: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, dict[str, int]], list[Finding]]:
    """Read `n_files` mutated files; those of vendors' readers `vendors` times as often.

    The `first` ones are passed over: an earlier run of the same seed has read them.

    Returns
    -------
    tally : dict
        By valid file, how many were read and how many refused.
    findings : list of Finding
        The rest; their files are copied to `keep`.
    """
    with tempfile.TemporaryDirectory(prefix="lightflight-fuzz-") as name:
        mutants = _mutants(Path(name), n_files, seed, only, vendors)
        return read_all(mutants, Path(name), keep=keep, first=first, report=report)


def read_all(
    mutants: Iterable[Mutant],
    folder: Path,
    *,
    keep: Path | None = None,
    first: int = 0,
    report: Callable[[str], None] = lambda text: None,
) -> tuple[dict[str, dict[str, int]], list[Finding]]:
    """Read mutated files one after another in a `folder`, as `run` does, and tell as it does."""
    tally: dict[str, dict[str, int]] = {}
    findings: list[Finding] = []
    around = Surroundings(folder)
    report(f"{'sees' if around.sees else 'does not see'} who reads a file beside the recording")
    known: dict[str, str | None] = {}
    with contextlib.closing(Reader(around.work)) as reader:
        for number, mutant in enumerate(mutants):
            one = mutant.seed
            if number % 1000 == 999:
                report(f"{number + 1} files, {len(findings)} findings")
            if number < first:
                continue
            if one.name not in known:
                sound = placed(folder / "now", one, one.content)
                assert sound is not None
                known[one.name] = reader.answer(sound, one.hints, one.reads).told
            path = placed(folder / "now", one, mutant.content)
            if path is None:
                continue
            for name, content in mutant.beside.items():
                (folder / "now" / name).write_bytes(content)
            answer = reader.answer(path, one.hints, one.reads)
            outcome = around.touched(1 + len(mutant.beside)) or answer.outcome
            other = answer.told is not None and answer.told != known[one.name]
            if outcome == "read" and one.checked and not mutant.made_new and other:
                outcome = "other values, in silence"
            count = tally.setdefault(one.name, {"read": 0, "refused": 0, "found": 0})
            count[outcome if outcome in count else "found"] += 1
            if outcome.startswith("memory"):  # the most there was: the next starts afresh
                reader.close()
            if outcome not in ("read", "refused"):
                findings.append(Finding(one.name, number, outcome))
                report(f"{one.name} #{number} {mutant.change}: {outcome}")
                if keep is not None:
                    keep.mkdir(parents=True, exist_ok=True)
                    (keep / f"{number:06d}-{one.name}").write_bytes(mutant.content)
    return tally, findings


def _mutants(
    folder: Path, n_files: int, seed: int, only: str | None, vendors: float
) -> Iterator[Mutant]:
    """Mutated files, formats taking turns; the same for the same `seed`."""
    made = folder / "made"
    made.mkdir()
    valid = [one for one in seeds(made) if only is None or only in one.name]
    rng = np.random.default_rng(seed)
    weights = np.array([one.weight * (vendors if one.isolated else 1.0) for one in valid])
    for choice in rng.choice(len(valid), n_files, p=weights / weights.sum()):
        yield Mutant(valid[choice], *mutation(valid[choice], rng))


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
        "--vendors", type=float, default=55.0, help="so many times as many for vendors' readers"
    )
    parser.add_argument("--only", help="part of a name of a valid file")
    parser.add_argument("--first", type=int, default=0, help="go on from there")
    parser.add_argument("--keep", type=Path, help="folder for the files of findings")
    options = parser.parse_args()
    start = time.monotonic()
    number = int.from_bytes(os.urandom(4)) if options.seed is None else options.seed
    _say(f"seed {number}")
    tally, findings = run(
        options.files,
        seed=number,
        keep=options.keep,
        only=options.only,
        vendors=options.vendors,
        first=options.first,
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

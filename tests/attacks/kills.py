"""Kill -9 each writing command at random moments: nothing lost, nothing half, nothing left.

    python -m tests.attacks.kills --kills 100

Each command first runs undisturbed, over what an earlier run has written. Then it runs again and
again with one of two inputs in turn, and is killed at any moment of that, or (every other time, or
each with `--writing`) at a moment in the life of one of the temporary files that it writes, which
is waited for; what it writes must be that of the one or of the other, whole. At the end it runs
once more: beside its outputs nothing may lie there, nor in the temporary folder. Commands branch
off a process that has everything imported, so that kills fall into the work. No process of theirs
may be left either: `batch` has workers.
"""

from __future__ import annotations

import argparse
import atexit
import hashlib
import os
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from click.testing import CliRunner

import lightflight as lf
from lightflight.cli import main
from lightflight.errors import FileFormatError
from lightflight.files import litter
from lightflight.files.children import environment
from tests.batch.conftest import make_campaign

LAB = """
[camera]
shape = [16, 16]
distance_mm = 535.0
field_of_view_mm = [245.0, 245.0]
center_mm = [187.5, 37.5]
[source]
position_mm = [0.0, 0.0, 0.0]
[scene]
vertices_mm = [[0, 0, 0], [375, 25, 50]]
[detector]
preset = "pf32"
"""

COMMANDS = """
convert ../in/{}.h5 -o out.h5
convert ../in/{}.h5 -o out.zarr
convert ../in/{}.h5 -o out.npz
convert ../in/{}.h5 -o out.mat
convert ../in/events-{}.h5 -o out.photon.h5
convert ../in/events-{}.h5 -o out.csv -o out.parquet
convert ../in/frames-{}.bin --hint shape=[16,16] --hint n_codes=1024 -o out.bin
convert ../in/{}.ptu -o out.h5
calibrate --code-density ../in/dense-{}.h5 --flat ../in/flat.h5 -o out.h5 --plot out.png
calibrate camera ../in/{}.csv --shape 16 16 -o out.toml
reconstruct ../in/{}.h5 --lab ../in/lab.toml --timing ../in/calibration.h5 -o out.h5 -o out.csv
export ../in/path-{}.h5 -o out.csv -o out.mat -o out.vtu -o out.glb -o out.parquet
view ../in/path-{}.h5 -o out.html
plot ../in/path-{}.h5 -o out.png -o out.svg
movie ../in/path-{}.h5 --size 160x160 --fps 2 -o out.gif
simulate --lab ../in/lab.toml --seed {:d} -o out.h5
batch ../in/campaign-{}/campaign.toml --workers 2 -o results
"""
OF_CAMPAIGNS = """
table.csv table.parquet summary.png paths/angle_-4_run8.h5 paths/angle_4_run8.h5
"""
LARGE = """
convert ../in/large-{}.bin --hint shape=[64,64] --hint n_codes=1024 -o out.h5
convert ../in/large-{}.npy --hint axes=yxt -o out.zarr -o out.npz
calibrate --code-density ../in/large-{}.h5 --flat ../in/large-flat.h5 -o out.h5
"""


@dataclass(frozen=True)
class Command:
    """A command that writes."""

    text: str
    """As in a shell; `{}` becomes "a" or "b", the one or the other input."""

    @property
    def outputs(self) -> list[str]:
        """Files that it writes."""
        words = self.text.split()
        if words[0] == "batch":
            return [f"results/{name}" for name in OF_CAMPAIGNS.split()]
        return [after for word, after in pairwise(words) if word in ("-o", "--plot")]

    @property
    def name(self) -> str:
        """What it is called in the table."""
        if self.text.startswith("batch"):
            return "batch -> results"
        first = self.text.replace("../in/", "").replace("-{}", "").replace("{}", "x")
        n_words = 3 if "--code" in first else 2
        return f"{' '.join(first.split()[:n_words])} -> {' '.join(self.outputs)}"

    @property
    def replaces(self) -> bool:
        """Recordings are never replaced: those are written where nothing is."""
        return not self.text.startswith(("convert", "simulate"))

    def words(self, one: str) -> list[str]:
        """What to call it with, for the one or the other input."""
        return self.text.replace("{}", one).replace("{:d}", str("ab".index(one))).split()


def commands(*, large: bool) -> list[Command]:
    """All commands that write files, and some of them with large ones."""
    lines = (COMMANDS + (LARGE if large else "")).splitlines()
    return [Command(line) for line in lines if line]


# --- inputs -----------------------------------------------------------------------------


def call(words: str) -> None:
    """A command in this process; what it says is not heard."""
    result = CliRunner().invoke(main, words.split())
    assert result.exit_code == 0, (words, result.output)


def make_inputs(folder: Path, asked: str, *, large_bytes: int) -> None:
    """Two of each input that is `asked` for, in a folder `in`, made the same way every time."""
    from tests.formats.made_by_hand import ptu_bytes

    here = folder / "in"
    here.mkdir()
    (here / "lab.toml").write_text(LAB)
    rng = np.random.default_rng(16)
    points = rng.uniform((0, -80, 0), (375, 150, 60), (2, 40, 3))
    camera = lf.Camera.facing_plane(
        (16, 16), distance_mm=535.0, field_of_view_mm=(245.0, 245.0), center_mm=(187.5, 37.5)
    )
    lab = f"simulate --lab {here}/lab.toml"
    clock = any(name in asked for name in ("dense-", "calibration.h5", "path-"))
    if clock:
        call(f"{lab} --kind flat --photons 100000 -o {here}/flat.h5")
    for number, one in enumerate("ab"):
        call(f"{lab} --seed {number} -o {here}/{one}.h5")
        dense = f"--kind code_density --photons 100000 -o {here}/dense-{one}.h5"
        events = f"--kind events --photons 500 -o {here}/events-{one}.h5"
        for words in ([dense] if clock else []) + ([events] if "events-" in asked else []):
            call(f"{lab} --seed {number} {words}")
        rng.integers(0, 1024, (3000, 16, 16)).astype("<u2").tofile(here / f"frames-{one}.bin")
        (here / f"{one}.ptu").write_bytes(ptu_bytes(rng.integers(0, 3000, 20_000)))
        pixels = np.array(camera.pixels_from_points(points[number])).T
        rows = np.hstack([points[number], pixels + rng.normal(0, 0.05, (40, 2))])
        lines = ["x_mm,y_mm,z_mm,row,col", *(",".join(map(str, row)) for row in rows)]
        (here / f"{one}.csv").write_text("\n".join(lines))
    if clock:
        dense = f"{here}/dense-a.h5"
        call(f"calibrate --code-density {dense} --flat {here}/flat.h5 -o {here}/calibration.h5")
    for one in "ab" if "path-" in asked else "":
        call(
            f"reconstruct {here}/{one}.h5 --lab {here}/lab.toml --timing {here}/calibration.h5"
            f" --n-legs 1 -o {here}/path-{one}.h5"
        )
    if "campaign-" in asked:
        for number, one in enumerate("ab"):
            make_campaign(here / f"campaign-{one}", n_repeats=1, seed=100 + number)
    if large_bytes:
        _make_large(here, large_bytes, rng)


def _make_large(here: Path, n_bytes: int, rng: np.random.Generator) -> None:
    n_frames = n_bytes // (64 * 64 * 2)
    clock: dict[str, Any] = {"bin_width_ps": 55.0, "laser_period_ps": 50_000.0}
    for one in "ab":
        frames = np.where(
            rng.random((n_frames, 64, 64)) < 0.04, rng.integers(8, 908, (n_frames, 64, 64)), 0
        ).astype("<u2")
        frames.tofile(here / f"large-{one}.bin")
        cube = rng.poisson(3.0, (n_bytes // (64 * 1024 * 2), 64, 1024)).astype(np.uint16)
        np.save(here / f"large-{one}.npy", cube)
        dense = rng.poisson(100.0, (128, n_bytes // (128 * 1024 * 2), 1024)).astype(np.uint16)
        dense[..., 909:] = 0
        lf.write(lf.Histograms(dense, **clock), here / f"large-{one}.h5")
    pulse = 500 * np.exp(-0.5 * ((np.arange(1024) - 500) / 3.0) ** 2) + 1.0
    lf.write(
        lf.Histograms(rng.poisson(np.broadcast_to(pulse, dense.shape)).astype(np.uint16), **clock),
        here / "large-flat.h5",
    )


# --- what is whole ----------------------------------------------------------------------


def content(path: Path) -> str:
    """A digest of what an output says, without when and by which process it was written.

    Raises
    ------
    Exception
        Where it is not whole.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if path.suffix == ".h5" and not path.name.endswith(".photon.h5"):
            return _of_record(path)
        if path.suffix in (".npz", ".mat", ".zarr") or path.name.endswith(".photon.h5"):
            with suppress(FileFormatError):
                found: Any = lf.read(path)
                return hashlib.sha256(lf.histogram(found).counts.tobytes()).hexdigest()
    # The first words of a MATLAB file say when it was written.
    start = 128 if path.suffix == ".mat" else 0
    return hashlib.sha256(path.read_bytes()[start:]).hexdigest()


def _of_record(path: Path) -> str:
    """Of one of our own files, whose own digest is seen to first."""
    from lightflight.files.store import load_record

    with h5py.File(path) as file:
        assert "digest" in file.attrs
        kind = np.bytes_(file.attrs["kind"]).decode()
        names: list[str] = []
        file.visititems(lambda name, one: names.append(name) if hasattr(one, "shape") else None)
        parts = [name.encode() + np.asarray(file[name][()]).tobytes() for name in sorted(names)
                 if name != "attributes"]  # fmt: skip
    load_record(path, kind=kind)
    return hashlib.sha256(b"".join(parts)).hexdigest()


# --- kills ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moment:
    """When a command is killed: so many seconds of processors after its start, or see `which`."""

    after_s: float
    which: int | None = None
    """So many seconds of a clock after the temporary file of this number appeared."""


@dataclass
class Tally:
    """What became of one command."""

    name: str
    seconds: float = 0.0
    writes_from_s: float = 0.0
    """When the first name appeared beside what was there."""
    lives_s: list[float] = field(default_factory=list)
    """How long each temporary file was there, by a clock, in the order in which they appeared."""
    kills: int = 0
    in_writing: int = 0
    """Kills that left a half written file: it was just being written."""
    old: int = 0
    new: int = 0
    lost: int = 0
    half: int = 0
    left: list[str] = field(default_factory=list)
    """Files, and processes, that lie there after all."""
    swept: int = 0

    def moment(self, rng: np.random.Generator, *, while_writing: bool) -> Moment:
        """When to kill: at any moment, or while one of its temporary files is there."""
        if not (while_writing and self.lives_s):
            return Moment(rng.uniform(0.0, 1.05 * self.seconds))
        # A kill takes a millisecond to come: what lives shorter is hit by those that come at once.
        which = int(rng.integers(len(self.lives_s)))
        return Moment(rng.uniform(0.0, self.lives_s[which]), which)

    def line(self) -> str:
        """A row of the table."""
        times = (f"{self.seconds:.2g}", f"{self.writes_from_s:.2g}")
        found = (
            self.kills,
            self.in_writing,
            self.old,
            self.new,
            self.swept,
            self.lost,
            self.half,
            len(self.left),
        )
        return "| " + " | ".join(map(str, (self.name, *times, *found))) + " |"


HEAD = (
    "| command | s of CPU | writes from, s | kills | in writing | as before | new, whole | swept |"
    " lost | half | left after the next |\n|---|---|---|---|---|---|---|---|---|---|---|"
)


class Temporaries:
    """Temporary files of one run in a folder, as they come and go."""

    def __init__(self, folder: Path) -> None:
        """Those that lie there are of others."""
        self._folder, self._others = folder, set(_temporary(folder))
        self.seen: dict[str, tuple[float, float]] = {}
        """When each was seen first and last, by a clock."""

    def look(self) -> None:
        """Note which are there now."""
        now = time.perf_counter()
        for name in set(_temporary(self._folder)) - self._others:
            first, _ = self.seen.get(name, (now, now))
            self.seen[name] = first, now


def _temporary(folder: Path) -> list[str]:
    with os.scandir(folder) as entries:
        return [entry.name for entry in entries if entry.name.startswith(".lightflight-")]


def branched(
    words: list[str], kill: Moment | None, watch: Callable[[float], None] = lambda used_s: None
) -> bool:
    """Run a command in a branch of this process; True where it was killed before its end.

    Moments are those of its processors, not of a clock, so that a busy machine does not shift them,
    but for those in the life of a temporary file: most of that is waiting for the disk.
    """
    files = Temporaries(Path.cwd())
    sys.stdout.flush()
    pid = os.fork()
    if pid == 0:
        code = 1
        with suppress(BaseException):
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in (0, 1) if kill is None else (0, 1, 2):
                os.dup2(nowhere, stream)
            litter._swept.clear()
            atexit._clear()  # what this process wants to be done at its end is not for a branch
            result = CliRunner().invoke(main, words)
            code = result.exit_code
            if code:
                os.write(2, result.output.encode())
            atexit._run_exitfuncs()  # which `os._exit` leaves out
        os._exit(code)
    ended, status = os.waitpid(pid, os.WNOHANG)
    while not ended:
        asked = time.perf_counter()
        if kill is None:
            watch(_used_s(pid))
        if kill is not None and _is_time(kill, files, pid):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        # Asking about workers, too, takes a while: a fifth of the time at most.
        time.sleep(max(0.0005, 4 * (time.perf_counter() - asked)))
        ended, status = os.waitpid(pid, os.WNOHANG)
    assert kill is not None or status == 0, words
    return os.WIFSIGNALED(status)


def _is_time(kill: Moment, files: Temporaries, pid: int) -> bool:
    if kill.which is None:
        return _used_s(pid) >= kill.after_s
    files.look()
    appeared = [first for first, _ in files.seen.values()]
    if len(appeared) <= kill.which:
        return False
    return time.perf_counter() - appeared[kill.which] >= kill.after_s


def _used_s(process: int | str) -> float:
    """Seconds of processors that a process and those it started have used."""
    used = 0.0
    for thread in Path(f"/proc/{process}/task").glob("*"):
        with suppress(OSError):
            used += int((thread / "schedstat").read_text().split()[0]) / 1e9
            used += sum(map(_used_s, (thread / "children").read_text().split()))
    return used


def litter_in(folder: Path, known: Iterable[str]) -> list[str]:
    """What lies there, however deep, beside what should."""
    return sorted({str(one.relative_to(folder)) for one in _within(folder)} - set(known))


def _within(folder: Path) -> Iterator[Path]:
    """Files and empty folders; a store is one file."""
    for entry in folder.iterdir() if folder.is_dir() else ():
        inside = [] if entry.is_symlink() or entry.suffix == ".zarr" else list(_within(entry))
        yield from inside or [entry]


def processes_with(folder: Path) -> list[str]:
    """Processes started with that folder for temporary files that are still there after 20 s."""
    mark, end = f"TMPDIR={folder}".encode(), time.monotonic() + 20
    while True:
        left = []
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                if mark in (process / "environ").read_bytes().split(b"\0"):
                    left.append(process.name)
        if not left or time.monotonic() > end:
            return left
        time.sleep(0.05)


def killed_at_random(
    command: Command, folder: Path, n_kills: int, rng: np.random.Generator, *, writing: bool
) -> Tally:
    """Kill one command so many times; `folder` holds `in`, and `tmp` for temporary files."""
    here = folder / "work"
    shutil.rmtree(here, ignore_errors=True)
    here.mkdir()
    os.chdir(here)
    tally, whole = Tally(command.name), {name: set[str]() for name in command.outputs}
    words = [command.words(one) for one in "ab"]
    for one in (*words, *words):
        _remove(command, here)
        there, used = sorted(_within(here)), [0.0]
        first: list[float] = []
        files = Temporaries(here)

        def watch(
            used_s: float,
            there: list[Path] = there,
            used: list[float] = used,
            first: list[float] = first,
            files: Temporaries = files,
        ) -> None:
            files.look()
            used.append(max(used_s, used[-1]))
            if not first and sorted(_within(here)) != there:
                first.append(used[-2])

        branched(one, None, watch)
        tally.seconds = used[-1]
        tally.writes_from_s = first[0] if first else tally.seconds
        tally.lives_s = [last - first for first, last in files.seen.values()]
        for name in command.outputs:
            whole[name].add(content(here / name))
    before = {name: content(here / name) for name in command.outputs}
    tries = 0
    while tally.kills < n_kills and tries < 10 * n_kills + 20:
        tries += 1
        before = _remove(command, here) or before
        known = set(litter_in(here, command.outputs) + litter_in(folder / "tmp", ()))
        moment = tally.moment(rng, while_writing=writing or tries % 4 > 1)
        others = set(_temporary(here))
        was_killed = branched(words[tries % 2], moment)
        tally.kills += was_killed
        tally.in_writing += was_killed and bool(set(_temporary(here)) - others)
        tally.swept += len(known - set(litter_in(here, ()) + litter_in(folder / "tmp", ())))
        for name in command.outputs:
            now = _state(here / name, whole[name])
            is_old = now == before[name]
            if now == "half" or (now == "lost" and not is_old):
                setattr(tally, now, getattr(tally, now) + 1)
            elif was_killed:
                tally.old += is_old
                tally.new += not is_old
            before[name] = now
    _remove(command, here)
    branched(words[0], None)
    tally.half += sum(_state(here / name, whole[name]) not in whole[name] for name in whole)
    left = litter_in(here, command.outputs) + litter_in(folder / "tmp", ())
    tally.left = left + [f"process {one}" for one in processes_with(folder / "tmp")]
    return tally


def _remove(command: Command, here: Path) -> dict[str, str]:
    """Make room for a recording, which replaces nothing; what is there now, then."""
    if command.replaces:
        return {}
    for name in command.outputs:
        shutil.rmtree(here / name) if (here / name).is_dir() else (here / name).unlink(True)
    return dict.fromkeys(command.outputs, "lost")


def _state(path: Path, whole: set[str]) -> str:
    if not path.exists():
        return "lost"
    try:
        now = content(path)
    except Exception:  # noqa: BLE001  (whatever a reader says of half a file)
        return "half"
    return now if now in whole else "half"


def run(
    n_kills: int, *, large_bytes: int, only: str = "", seed: int = 16, writing: bool = False,
    report: Callable[[str], None] = lambda text: None,
) -> list[Tally]:  # fmt: skip
    """Kill each command so many times, in a temporary folder."""
    rng, found, home = np.random.default_rng(seed), [], Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "tmp").mkdir()
        chosen = [one for one in commands(large=large_bytes > 0) if only in one.name]
        asked = " ".join(one.text for one in chosen)
        make_inputs(folder, asked, large_bytes=large_bytes if "large" in asked else 0)
        before, tempfile.tempdir = tempfile.tempdir, str(folder / "tmp")
        try:
            with environment({"TMPDIR": str(folder / "tmp")}):
                for command in chosen:
                    tally = killed_at_random(command, folder, n_kills, rng, writing=writing)
                    found.append(tally)
                    report(found[-1].line())
        finally:
            os.chdir(home)
            tempfile.tempdir = before
    return found


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100, help="of each command")
    parser.add_argument("--large-mb", type=int, default=300, help="size of the large files")
    parser.add_argument("--only", default="", help="part of a command's name")
    parser.add_argument("--writing", action="store_true", help="each kill while a file is written")
    options = parser.parse_args()
    _say(HEAD)
    found = run(options.kills, large_bytes=options.large_mb * 1_000_000, only=options.only,
                writing=options.writing, report=_say)  # fmt: skip
    for one in found:
        _say("".join(f"{one.name} left {name}\n" for name in one.left))
    return 1 if any(one.lost or one.half or one.left for one in found) else 0


if __name__ == "__main__":
    sys.exit(_main())

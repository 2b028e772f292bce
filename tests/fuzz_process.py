"""The process in which `fuzz_readers` has damaged files read: it may be killed, and is watched.

`python -m tests.fuzz_process`: tasks as JSON lines on stdin, answers on stdout.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import io
import json
import os
import platform
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

TIME_LIMIT_S = 30.0 * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
"""What a file may take: half a minute of a machine that has nothing else to do."""

MEMORY_LIMIT_BYTES = 1 << 30
_REAL_STARTS = int(os.environ.get("LIGHTFLIGHT_REAL_STARTS", "10"))
"""One of so many vendors' readers is started as users start it; the others branch off."""

_LATE = "its reader did not finish in"

_FIRST_USE = (
    "import",
    "compile",
    "exec",
    "marshal",
    "ctypes",
    "socket.gethostname",
    "socket.__new__",
    "os.fork",
)
"""Events that the first file of a format brings about; `tests/attacks/test_audit.py` is strict."""


@dataclass(frozen=True)
class Answer:
    """What reading a file came to."""

    outcome: str
    """ "read", "refused", or what is wrong."""

    told: str | None = None
    """Of all that was read, a digest; None where there was an error or a warning."""


class Reader:
    """A child process that reads one file after another; made anew when it dies."""

    def __init__(self, folder: Path | None = None) -> None:
        """`folder` is where the child works and keeps temporary files; None: as this process."""
        self._child: subprocess.Popen[str] | None = None
        self._folder = folder

    def outcome(self, path: Path, hints: Mapping[str, Any], reads: str = "recording") -> str:
        """What reading a file came to: "read", "refused", or what is wrong."""
        return self.answer(path, hints, reads).outcome

    def answer(self, path: Path, hints: Mapping[str, Any], reads: str) -> Answer:
        """The same, and what was read."""
        child = self._living_child()
        assert child.stdin is not None
        assert child.stdout is not None
        try:
            task = {"path": str(path), "hints": dict(hints), "reads": reads}
            child.stdin.write(json.dumps(task) + "\n")
            child.stdin.flush()
        except BrokenPipeError:
            self.close()
            return Answer("crash: it ended after the file before")
        ready, _, _ = select.select([child.stdout], [], [], 2 * TIME_LIMIT_S)
        if not ready:
            self.close()
            return Answer(f"hang: no answer in {2 * TIME_LIMIT_S:.0f} s")
        line = child.stdout.readline()
        if not line:
            code = child.wait()
            self._child = None
            return Answer(f"crash: exit code {code}")
        return Answer(**json.loads(line))

    def _living_child(self) -> subprocess.Popen[str]:
        if self._child is None:
            told = [str(Path(__file__).parents[1]), *filter(None, sys.path)]
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(told)}
            if self._folder is not None:
                environment["TMPDIR"] = str(self._folder)
            self._child = subprocess.Popen(
                [sys.executable, "-P", "-m", "tests.fuzz_process"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                env=environment,
                cwd=self._folder,
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


class Surroundings:
    """A folder with a secret beside the file that is read, and all that is not to be touched.

    Whoever reads the secret, in Python or in C, changes the time of its last access.
    """

    def __init__(self, folder: Path) -> None:
        """`folder` holds the mutant in `now`, the secrets, and `work`, where the reader works."""
        import h5py

        self._folder = folder
        self.work = folder / "work"
        self.work.mkdir()
        # Before what an access is noted for (relatime), and at the same time each time.
        (folder / "secret").write_bytes(bytes(range(7, 77)) * 1000)
        with h5py.File(folder / "secret.h5", "w") as file:
            file["x"] = np.arange(7, 519, dtype=np.uint16).reshape(4, 4, 32)
        self._secrets = [folder / "secret", folder / "secret.h5"]
        self._hide()
        self._secrets[0].read_bytes()
        self.sees = self._seen() == ["secret"]
        self._hide()

    def _hide(self) -> None:
        for secret in self._secrets:
            os.utime(secret, (1_000_000_000, 1_000_000_001))

    def _seen(self) -> list[str]:
        return [one.name for one in self._secrets if one.stat().st_atime != 1_000_000_000]

    def touched(self, n_files: int = 1) -> str | None:
        """What reading did to the folder, where so many files were put; None: nothing."""
        if seen := self._seen():
            self._hide()
            return f"disclosed: {', '.join(seen)} was read"
        known = {"now", "work", "made", *(one.name for one in self._secrets)}
        new = [one.name for one in self._folder.iterdir() if one.name not in known]
        new += [f"work/{one.name}" for one in self.work.iterdir()]
        for one in self.work.iterdir():
            shutil.rmtree(one) if one.is_dir() else one.unlink()
        new += [one.name for one in list((self._folder / "now").iterdir())[n_files:]]
        return f"left: {', '.join(new)}" if new else None


def _serve() -> None:
    """Read files named on stdin and answer on stdout, until stdin ends."""
    import resource

    from lightflight.files import filecheck
    from lightflight.formats import isolation
    from tests.attacks import watched

    # What readers may take is told to them, and kept track of.
    filecheck.free_memory_bytes = lambda: MEMORY_LIMIT_BYTES  # type: ignore[attr-defined]
    isolation.TIME_LIMIT_S = TIME_LIMIT_S
    isolation.run_module = _Branches(isolation.run_module)  # type: ignore[attr-defined]
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # nothing a library prints may look like an answer
    # Both are asked once: one tries whether files can be written, the other asks the system.
    tempfile.gettempdir()
    platform.processor()
    sys.addaudithook(watched._hook)
    for line in sys.stdin:
        task = json.loads(line)
        watched.watch.seen = []
        answer, told = _told_and_outcome(task["path"], task["hints"], task["reads"])
        seen, watched.watch.seen = watched.watch.seen, None
        if done := [event for event in seen if not event.startswith(_FIRST_USE)]:
            answer = f"asked of Python: {done}"
        holders = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
        peak = max(resource.getrusage(holder).ru_maxrss for holder in holders) * 1024
        if peak > 2e9:
            answer = f"memory: {peak / 1e9:.1f} GB"
        answers.write(json.dumps({"outcome": answer, "told": told}) + "\n")
        answers.flush()


class _Branches:
    """`run_module` of vendors' readers without the second that each start takes: forks."""

    def __init__(self, real: Any) -> None:
        self._real = real
        self._count = 0

    def __call__(
        self, module: str, words: Sequence[str], *, told: str, time_limit_s: float
    ) -> subprocess.CompletedProcess[str]:
        from lightflight.formats import isolation

        importlib.import_module(words[0].partition(":")[0])
        for name in ("ptufile", "sdtfile"):
            with contextlib.suppress(ImportError):
                importlib.import_module(name)
        self._count += 1
        if self._count % _REAL_STARTS == 0:
            done: subprocess.CompletedProcess[str] = self._real(
                module, words, told=told, time_limit_s=time_limit_s
            )
            return done
        errors = Path(words[2], "stderr.txt")
        pid = os.fork()
        if pid == 0:
            with errors.open("w") as file:
                sys.stdin, sys.stderr = io.StringIO(told), file
                os.dup2(file.fileno(), 2)
                # What this process has mapped counts, too; a new one would have less.
                isolation._LIBRARIES_BYTES += _mapped_bytes()
                code = 1
                with contextlib.suppress(BaseException):
                    code = isolation._main(*words)
            os._exit(code)
        end = time.monotonic() + time_limit_s
        while (found := os.waitpid(pid, os.WNOHANG))[0] == 0:
            if time.monotonic() > end:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
                raise subprocess.TimeoutExpired(words, time_limit_s)
            time.sleep(0.002)
        code = os.waitstatus_to_exitcode(found[1])
        said = errors.read_text(errors="replace")
        return subprocess.CompletedProcess(words, code, "", said)


def _mapped_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def _told_and_outcome(path: str, hints: Mapping[str, Any], reads: str) -> tuple[str, str | None]:
    found: list[Any] = []
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        outcome = _try_to_read(path, hints, reads, found)
    quiet = outcome == "read" and not [one for one in said if one.category is UserWarning]
    return outcome, _digest(found) if quiet else None


def _try_to_read(
    path: str, hints: Mapping[str, Any], reads: str, found: list[Any] | None = None
) -> str:
    """What reading a file comes to; what was read is added to `found`."""
    from lightflight.errors import FileFormatError

    found = [] if found is None else found
    try:
        found.append(_read(path, hints, reads))
    except FileFormatError as error:
        text = str(error)
        if path not in text or "\n" in text:
            return f"error that is not one sentence with the file's name: {text[:300]!r}"
        return f"hang: {text}" if _LATE in text else "refused"
    except BaseException as error:  # noqa: BLE001  (that is what is looked for)
        return f"{type(error).__name__}: {str(error)[:300]}"
    return _try_to_count(found) if reads == "recording" else "read"


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


def _try_to_count(found: list[Any]) -> str:
    import lightflight as lf
    from lightflight.errors import FileFormatError

    try:
        hist = lf.histogram(found[0])
    except FileFormatError:
        return "refused"
    except ValueError as error:
        # A plausible file may still describe a cube that does not fit.
        return "refused" if " GB are free" in str(error) else f"count: {error}"
    except BaseException as error:  # noqa: BLE001
        return f"count: {type(error).__name__}: {str(error)[:300]}"
    clock = [hist.bin_width_ps, hist.laser_period_ps, hist.n_frames, hist.periods_per_frame]
    clock += [hist.reversed_codes, hist.first_edge_ps, hist.no_photon_code, hist.poisson]
    found[:] = [type(found[0]).__name__, np.asarray(hist.counts), clock, dict(hist.settings)]
    return "read"


def _digest(value: Any) -> str:
    """Of all that was read: arrays with their types and shapes, the rest as Python writes it."""
    parts = hashlib.sha256()

    def take(one: Any) -> None:
        if isinstance(one, np.ndarray):
            parts.update(f"{one.dtype.descr} {one.shape}".encode())
            parts.update(np.ascontiguousarray(one).tobytes())
        elif isinstance(one, Mapping):
            take(sorted(one.items()))
        elif isinstance(one, list | tuple):
            parts.update(f"{type(one).__name__} {len(one)}".encode())
            for inner in one:
                take(inner)
        elif hasattr(one, "__dataclass_fields__"):
            take([getattr(one, name) for name in one.__dataclass_fields__])
        else:
            parts.update(repr(one).encode("utf-8", "surrogatepass"))

    take(value)
    return parts.hexdigest()


if __name__ == "__main__":
    _serve()

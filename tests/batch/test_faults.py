"""Campaigns that are interrupted: by a full disk, Ctrl-C, kill -9, and workers that die.

Everything happens for real, in processes of its own. What was finished before a fault must be
there after it, untouched, and the table must come out the same, byte for byte.
"""

from __future__ import annotations

import csv
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from tests.batch.conftest import N_REPEATS as N

pytest.importorskip("distributed")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

COMMAND = (sys.executable, "-m", "lightflight", "batch", "campaign.toml")
LIMIT_S = 400
"""The first run may have to compile every kernel, on a machine that does other things too."""


@contextmanager
def running(folder: Path, *words: str, **options) -> Iterator[subprocess.Popen[str]]:
    """The command line in a process group of its own, of which nothing is left behind."""
    process = subprocess.Popen(
        [*COMMAND, *words], cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        start_new_session=True, **options,
    )  # fmt: skip
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def run(folder: Path, *words: str, **options) -> tuple[int, str, str]:
    with running(folder, *words, **options) as process:
        out, err = process.communicate(timeout=LIMIT_S)
    return process.returncode, out, err


def with_fault(folder: Path, sitecustomize: str) -> dict[str, str]:
    """An environment in which every process does this first."""
    (folder / "fault").mkdir()
    (folder / "fault" / "sitecustomize.py").write_text(sitecustomize)
    usual = os.environ.get("PYTHONPATH")
    return {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, (str(folder / "fault"), usual))),
    }


def finished(folder: Path) -> dict[str, int]:
    """Path files that are there, and when they were written."""
    return {
        file.name: file.stat().st_mtime_ns
        for file in (folder / "results" / "paths").glob("*.h5")
        if not file.name.startswith(".")
    }


def wait_for(folder: Path, n: int) -> None:
    """Until `n` paths are finished."""
    end = time.monotonic() + LIMIT_S
    while len(finished(folder)) < n:
        assert time.monotonic() < end, "no path was finished"
        time.sleep(0.005)


def worker_ids(parent: int) -> list[int]:
    """Dask workers of a process: they branch off a server that it started."""
    parents, servers = {}, set()
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            lines = dict(
                line.split(":", 1) for line in status.read_text().splitlines() if ":" in line
            )
            words = (status.parent / "cmdline").read_bytes()
        except OSError:
            continue
        parents[int(lines["Pid"])] = int(lines["PPid"])
        if int(lines["PPid"]) == parent and b"multiprocessing.forkserver" in words:
            servers.add(int(lines["Pid"]))
    return [one for one, above in parents.items() if above in servers]


@pytest.fixture
def folder(campaign_folder, tmp_path) -> Path:
    """A copy of the campaign, with a file that is no recording among the ten."""
    copy = tmp_path / "campaign"
    shutil.copytree(campaign_folder, copy)
    (copy / "angle_4" / "broken.h5").write_bytes(b"this is a letter\n" * 9)
    return copy


@pytest.fixture(scope="module")
def undisturbed(campaign_folder, tmp_path_factory) -> bytes:
    """The table of the same campaign by one worker whom nothing disturbs."""
    copy = tmp_path_factory.mktemp("undisturbed") / "campaign"
    shutil.copytree(campaign_folder, copy)
    (copy / "angle_4" / "broken.h5").write_bytes(b"this is a letter\n" * 9)
    code, _, err = run(copy, "--workers", "1")
    assert code == 0, err
    return (copy / "results" / "table.csv").read_bytes()


def test_one_bad_recording_is_a_row_and_the_others_go_on(undisturbed):
    rows = list(csv.DictReader(undisturbed.decode().splitlines()))
    assert [row["status"] for row in rows] == ["done"] * N + ["failed"] + ["done"] * N
    assert rows[N]["recording"] == "angle_4/broken.h5"
    assert "is not an HDF5 file" in rows[N]["reason"]
    for row in rows[:N] + rows[N + 1 :]:
        set_point, angle = float(row["set_point_deg"]), float(row["leg1_angle_deg"])
        assert abs(angle - set_point) < 6 * float(row["leg1_angle_std_deg"])
    # No clock times: nothing in it is as long as a date, and there is no such column
    assert not any("utc" in name or "date" in name for name in rows[0])


@pytest.fixture
def machines_folder() -> Iterator[Path]:
    """For temporary files of all processes; its name is short, as those of sockets must be."""
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def test_whatever_ends_a_run_the_next_goes_on_from_there(
    folder, undisturbed, machines_folder, tmp_path
):
    """Full disks, Ctrl-C, kill -9 of the whole run, and then a worker's death: one after another.

    The first disk is full at once; then every flush fails with ENOSPC after the second path file,
    in the worker too. Runs after that are hit once something is finished; the last one, with two
    workers, ends well, and nothing is left of any: Dask's folder and that of multiprocessing's
    sockets were. Readings wait, so that a run is still at work when it is hit, however fast the
    machine; what is read once the last hit has been waits no more.
    """
    all_hit = folder / "all_hit"
    slow = with_fault(
        folder,
        "import os, time\n"
        "import lightflight.formats.registry as registry\n"
        "usual = registry.read\n"
        "def read(path, **hints):\n"
        f"    time.sleep(0.0 if os.path.exists({str(all_hit)!r}) else 1.0)\n"
        "    return usual(path, **hints)\n"
        "registry.read = read\n",
    )
    slow["TMPDIR"] = str(machines_folder)
    sizes = "import resource as r, runpy, sys; r.setrlimit(r.RLIMIT_FSIZE, (9000, 9000)); "
    script = f"{sizes}sys.argv = sys.argv[1:]; runpy.run_module('lightflight', run_name='__main__')"
    done = subprocess.run(
        # -B: Python would leave half a file of byte code, and nobody could import it again.
        [sys.executable, "-B", "-c", script, *COMMAND[2:], "--workers", "1"],
        cwd=folder, capture_output=True, text=True, check=False, timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 3, done.stderr
    assert "File too large" in done.stderr
    assert "0 of 11 recordings are finished and kept" in done.stderr
    assert "Traceback" not in done.stderr
    assert finished(folder) == {}

    full = with_fault(
        tmp_path,
        "import errno, os, pathlib\n"
        "usual = os.fsync\n"
        "def fsync(handle):\n"
        "    name = os.readlink(f'/proc/self/fd/{handle}')\n"
        "    paths = pathlib.Path(name).parent\n"
        "    if paths.name == 'paths' and len(list(paths.glob('angle*.h5'))) >= 2:\n"
        "        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))\n"
        "    return usual(handle)\n"
        "os.fsync = fsync\n",
    )
    code, out, err = run(folder, "--workers", "1", env=full)
    assert code == 3, (out, err)
    assert "No space left on device" in err
    assert "2 of 11 recordings are finished and kept" in err
    before = finished(folder)
    assert len(before) == 2
    assert not (folder / "results" / "table.csv").exists()

    with running(folder, "--workers", "2", env=slow) as process:
        wait_for(folder, 3)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
        _, err = process.communicate(timeout=LIMIT_S)
    kept = finished(folder)
    assert process.returncode == 130, err
    assert "interrupted; what is finished is kept" in err
    assert "Traceback" not in err
    assert {name: kept[name] for name in before} == before
    assert 3 <= len(kept) < 2 * N

    with running(folder, "--workers", "2", env=slow) as process:
        wait_for(folder, len(kept) + 1)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    after = finished(folder)
    assert {name: after[name] for name in kept} == kept
    assert len(kept) < len(after)

    with running(folder, "--workers", "2", env=slow) as process:
        end = time.monotonic() + LIMIT_S
        while not worker_ids(process.pid):
            assert time.monotonic() < end, "no worker was started"
            time.sleep(0.005)
        wait_for(folder, min(2 * N, len(after) + 1))
        os.kill(worker_ids(process.pid)[0], signal.SIGKILL)
        all_hit.touch()
        _, err = process.communicate(timeout=LIMIT_S)
    assert process.returncode == 0, err
    assert "Traceback" not in err
    last = finished(folder)
    assert {name: last[name] for name in after} == after
    assert (folder / "results" / "table.csv").read_bytes() == undisturbed

    assert [file.name for file in (folder / "results").glob(".*")] == []
    assert list(machines_folder.iterdir()) == []


def test_a_recording_that_kills_its_workers_is_given_up(folder):
    """One recording ends the process that reads it; the others get their paths."""
    deadly = with_fault(
        folder,
        "import os\n"
        "import lightflight.formats.registry as registry\n"
        "usual = registry.read\n"
        "def read(path, **hints):\n"
        "    if str(path).endswith('angle_4/run9.h5'):\n"
        "        os._exit(9)\n"
        "    return usual(path, **hints)\n"
        "registry.read = read\n",
    )
    code, _, err = run(folder, "--workers", "1", env=deadly)
    assert code == 0, err
    rows = list(csv.DictReader((folder / "results" / "table.csv").read_text().splitlines()))
    reasons = {row["recording"]: row["reason"] for row in rows if row["status"] == "failed"}
    assert "died 3 times" in reasons.pop("angle_4/run9.h5")
    assert list(reasons) == ["angle_4/broken.h5"]


def test_a_script_whose_work_the_workers_would_do_again_is_told_so(folder):
    (folder / "script.py").write_text(
        "from pathlib import Path\n"
        "from lightflight.batch.campaign import campaign_from_toml\n"
        "from lightflight.batch.runner import run_campaign\n"
        "run_campaign(campaign_from_toml(Path('campaign.toml')), n_workers=1)\n"
    )
    done = subprocess.run(
        [sys.executable, "script.py"],
        cwd=folder, capture_output=True, text=True, check=False, timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    said = done.stderr.splitlines()[-1]
    assert "no worker could be started" in said
    assert 'script.py, so what it does must stand under if __name__ == "__main__":' in said


SCHEDULER = """
import sys
if __name__ == "__main__":
    from distributed import LocalCluster
    with LocalCluster(
        n_workers=1, threads_per_worker=2, dashboard_address="127.0.0.1:0", host="127.0.0.1",
        silence_logs=60,
    ) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""


def test_the_cluster_of_a_lab_and_what_happens_when_it_goes(folder, undisturbed):
    """A scheduler in a process of its own, its worker with two threads."""
    (folder / "scheduler.py").write_text(SCHEDULER)
    cluster = subprocess.Popen(
        [sys.executable, "scheduler.py"], cwd=folder, text=True, start_new_session=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        address = cluster.stdout.readline().strip()
        code, _, err = run(folder, "--scheduler", address)
        assert code == 0, err
        assert (folder / "results" / "table.csv").read_bytes() == undisturbed
        shutil.rmtree(folder / "results")
        with running(folder, "--scheduler", address) as process:
            wait_for(folder, 1)
            os.killpg(cluster.pid, signal.SIGKILL)
            _, err = process.communicate(timeout=LIMIT_S)
        assert process.returncode == 3, err
        assert "the scheduler is gone" in err
        assert "Traceback" not in err
        assert finished(folder)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(cluster.pid, signal.SIGKILL)
        cluster.communicate()

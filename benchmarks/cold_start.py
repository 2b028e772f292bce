"""What a newcomer waits for: commands with an empty Numba cache against the same, warm.

    python benchmarks/cold_start.py            # the tutorial's commands, medians of three
    python benchmarks/cold_start.py --quick    # one run each, and only the counts can fail; warm
                                               # is `reconstruct`

The commands of docs/tutorial/first-path.md (and the demo) run in processes of their own, byte code
present. Seconds are CPU time of the process, user and system. Functions are those that Numba
compiled in the cold run, its own and NumPy's for it included; more of them than `MOST` is an error:
each is 0.1 s and more, on whatever machine.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
from math import isnan, nan
from pathlib import Path
from statistics import median

import numba

COMMANDS = {
    "simulate": "simulate -o recording.h5",
    "info": "info recording.h5",
    "simulate code_density": "simulate --kind code_density -o bright.h5",
    "simulate flat": "simulate --kind flat --photons 400000 -o flat.h5",
    "calibrate": "calibrate --code-density bright.h5 --flat flat.h5 --dead-codes absorbed "
    "-o calibration.h5 -o clock.png",
    "reconstruct": "reconstruct recording.h5 --lab lab.toml --timing calibration.h5 -o path.h5 "
    "-o path.png",
    "reconstruct, no picture": "reconstruct recording.h5 --lab lab.toml --timing calibration.h5 "
    "-o path.h5",
    "view": "view path.h5 --recording recording.h5 --timing calibration.h5 -o page.html",
    "movie": "movie path.h5 --pace 900 --fps 10 --size 640x360 -o flight.gif",
    "plot": "plot path.h5 --what times -o two-clocks.png",
    "demo": "demo -o demo",
}
"""In the order of the tutorial: later ones read what earlier ones wrote."""

PULSE_KERNEL = 25
"""Functions that the fit of pulses takes, some to spare."""

MOST = dict.fromkeys(COMMANDS, 0) | dict.fromkeys(
    ("calibrate", "reconstruct", "reconstruct, no picture", "view", "demo"), PULSE_KERNEL
)
"""Functions that each command may compile."""

MOST_RATIO, MOST_DEMO_S = 5.0, 15.0

LAB = """
[camera]
distance_mm = 535.0
field_of_view_mm = [245.0, 245.0]
center_mm = [187.5, 37.5]
position_std_mm = 0.5

[source]
position_mm = [0.0, 0.0, 0.0]
pulse_fwhm_ps = 68.0
"""

NOT_QUICKLY = {"reconstruct, no picture"}
"""It compiles what `reconstruct` does."""

COUNTING = """
import atexit, sys
from numba.core import event

class Counter(event.Listener):
    n = 0
    def on_start(self, event):
        self.n += 1
    def on_end(self, event):
        pass

counter = Counter()
event.register("numba:compile", counter)
atexit.register(lambda: open(sys.argv.pop(), "w").write(str(counter.n)))
from lightflight.cli import main
main(sys.argv[1:-1], prog_name="lightflight")
"""


def cpu_seconds(arguments: list[str], folder: Path, cache: Path) -> float:
    """CPU time of a Python process, user and system."""
    before = os.times()
    subprocess.run(
        [sys.executable, *arguments], cwd=folder, check=True, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL, env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
    )  # fmt: skip
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])


def counted(command: str, folder: Path, *, again: bool) -> tuple[int, float, float]:
    """Functions that Numba compiles with an empty cache; CPU seconds of that run, of the next.

    The next is not made where nothing was compiled, or nobody asks for it: NaN.
    """
    with tempfile.TemporaryDirectory() as cache_name:
        cache = Path(cache_name)
        arguments = ["-c", COUNTING, *command.split(), str(cache / "count")]
        cold = cpu_seconds(arguments, folder, cache)
        n = int((cache / "count").read_text())
        return n, cold, cpu_seconds(arguments, folder, cache) if n and again else nan


def cold_and_warm(command: str, folder: Path, rounds: int) -> tuple[float, float]:
    """Medians of the CPU seconds with an empty cache, and with what that left."""
    cold, warm = [], []
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache:
            for seconds in (cold, warm):
                arguments = ["-m", "lightflight", *command.split()]
                seconds.append(cpu_seconds(arguments, folder, Path(cache)))
    return median(cold), median(warm)


def _shown(number: float) -> str:
    return "-" if isnan(number) else f"{number:.1f}"


def main() -> None:
    """Print the table; leave with an error where a figure is missed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="one run each, judged by counts alone")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    print(f"Python {platform.python_version()}, Numba {numba.__version__}, "
          f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")  # fmt: skip
    print("| command | functions compiled | at most | cold, s of CPU | warm | cold / warm |")
    print("|---|---:|---:|---:|---:|---:|")
    misses = []
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        (folder / "lab.toml").write_text(LAB)
        for name, command in COMMANDS.items():
            if options.quick and name in NOT_QUICKLY:
                continue
            again = options.quick and name == "reconstruct"
            n, cold, warm = counted(command, folder, again=again)
            if not options.quick:
                cold, warm = cold_and_warm(command, folder, options.rounds)
            seconds = " | ".join(map(_shown, (cold, warm, cold / warm)))
            print(f"| {name} | {n} | {MOST[name]} | {seconds} |", flush=True)
            if n > MOST[name]:
                misses.append(f"{name} compiles {n} functions, not {MOST[name]}")
            if not options.quick and cold > MOST_RATIO * warm:
                misses.append(f"{name} takes {cold / warm:.1f} times as long cold as warm")
            if not options.quick and name == "demo" and cold > MOST_DEMO_S:
                misses.append(f"the demo takes {cold:.0f} s cold")
    if misses:
        raise SystemExit(f"missed: {'; '.join(misses)}")


if __name__ == "__main__":
    main()

"""`lightflight versions | head -1` ended with exit code 1, "a fault of lightflight itself"."""

import os
import subprocess
import sys


def test_who_reads_no_further_is_no_fault():
    # The reading end is closed before anything is written.
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "lightflight", "versions"],
            stdout=writing, stderr=subprocess.PIPE, text=True, check=False,
        )  # fmt: skip
    finally:
        os.close(writing)
    assert done.stderr == ""
    assert done.returncode == 0

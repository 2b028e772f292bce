"""Tests that interrupt their children hung where a shell had told its jobs to ignore Ctrl-C.

A child inherits that; `tests/conftest.py` listens again.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_tests_hear_ctrl_c_wherever_they_were_started():
    script = """
import signal
signal.signal(signal.SIGINT, signal.SIG_IGN)
import tests.conftest
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
"""
    subprocess.run([sys.executable, "-c", script], cwd=Path(__file__).parents[2], check=True)

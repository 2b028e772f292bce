"""Ctrl-C that fell into a call of HDF5 was swallowed there, and the process went on."""

import os
import signal
import subprocess
import sys
import textwrap
import time

import numpy as np
import pytest

from lightflight.files.store import load_record, save_record


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_ctrl_c_while_writing_keeps_the_old_file(tmp_path):
    """For real: a process that writes the same record for ever is interrupted at some moment."""
    path = tmp_path / "r.h5"
    script = f"""
        import numpy as np
        from lightflight.files.store import save_record
        noise = np.random.default_rng(0).integers(0, 256, 3_000_000, dtype=np.uint8)
        print("ready", flush=True)
        try:
            while True:
                save_record({str(path)!r}, kind="path", arrays={{"x": noise}}, attributes={{}})
        except KeyboardInterrupt:
            print("interrupted", flush=True)
    """
    for wait_s in (0.05, 0.13, 0.31):
        save_record(path, kind="path", arrays={"x": np.arange(5)}, attributes={})
        with subprocess.Popen(
            [sys.executable, "-c", textwrap.dedent(script)], stdout=subprocess.PIPE, text=True
        ) as child:
            assert child.stdout is not None
            assert child.stdout.readline() == "ready\n"
            time.sleep(wait_s)
            child.send_signal(signal.SIGINT)
            assert child.stdout.read() == "interrupted\n"
        assert load_record(path, kind="path")[0]["x"].size in (5, 3_000_000)
        assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]

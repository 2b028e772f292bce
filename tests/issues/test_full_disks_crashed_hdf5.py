"""A disk that filled up crashed HDF5 while it closed the file, or gave a trace without its name."""

import subprocess
import sys
import textwrap

import numpy as np
import pytest

from lightflight.files.store import load_record, save_record


@pytest.mark.parametrize("limit", [3_000, 60_000, 1_000_000])
@pytest.mark.parametrize("how", ["write", "append"])
def test_a_full_disk_is_one_sentence_and_keeps_the_old_file(tmp_path, limit, how):
    """For real, in a process that may not write beyond `limit` bytes; HDF5 alone would crash."""
    path = tmp_path / "r.h5"
    save_record(path, kind="path", arrays={"x": np.arange(5)}, attributes={})
    script = f"""
        import resource, signal
        import numpy as np
        from lightflight.files.store import new_record
        resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
        noise = np.random.default_rng(0).integers(0, 256, 40_000_000, dtype=np.uint8)
        try:
            with new_record({str(path)!r}, kind="path", attributes={{}}) as record:
                record.write("small", np.arange(10))
                record.{how}("noise", noise.reshape(400, -1))
        except OSError as error:
            print(type(error).__name__, error)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True
    )
    assert "cannot write, File too large" in done.stdout
    assert str(path) in done.stdout
    assert done.stderr == ""
    np.testing.assert_array_equal(load_record(path, kind="path")[0]["x"], np.arange(5))
    assert [file.name for file in tmp_path.iterdir()] == ["r.h5"]

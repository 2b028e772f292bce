"""formats.registry: content first, then suffix; hints checked; plug-ins found."""

from __future__ import annotations

import gzip
import subprocess
import sys
import textwrap
from importlib.metadata import EntryPoint
from typing import Any

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import ConfigError, FileFormatError, LightflightWarning
from lightflight.formats import registry

read: Any = lf.read


@pytest.fixture
def cube(rng) -> lf.Histograms:
    return lf.Histograms(rng.poisson(3.0, (4, 5, 16)), bin_width_ps=50.0, laser_period_ps=800.0)


def test_content_goes_before_the_suffix(tmp_path, cube):
    lf.write(cube, tmp_path / "x.npz")
    (tmp_path / "x.npz").rename(tmp_path / "x.bin")
    np.testing.assert_array_equal(read(tmp_path / "x.bin").counts, cube.counts)


def test_a_named_format_goes_before_both(tmp_path):
    frames = np.ones((5, 2, 2), "<u2")
    frames.tofile(tmp_path / "frames.xyz")
    with pytest.raises(FileFormatError, match=r"of no known format .* say which with format="):
        read(tmp_path / "frames.xyz")
    recording = read(tmp_path / "frames.xyz", format="pf32-frames", shape=(2, 2))
    np.testing.assert_array_equal(recording.frames, frames)


def test_unknown_hints_name_the_nearest(tmp_path, cube):
    lf.write(cube, tmp_path / "x.h5")
    with pytest.raises(ConfigError, match=r"'bin_width' .* did you mean 'bin_width_ps'"):
        read(tmp_path / "x.h5", bin_width=3)
    with pytest.raises(ConfigError, match="unknown format 'nzp': did you mean 'npz'"):
        read(tmp_path / "x.h5", format="nzp")
    with pytest.raises(ConfigError, match=r"unknown option 'compres' .* did you mean 'compress'"):
        lf.write(cube, tmp_path / "x.npz", compres=True)
    assert not (tmp_path / "x.npz").exists()


@pytest.mark.parametrize(
    ("hint", "value", "text"),
    [
        ("bin_width_ps", "wide", "must be a number of ps"),
        ("bin_width_ps", float("nan"), "must be a number of ps"),
        ("n_frames", 1.5, "must be a whole number"),
        ("no_photon_code", True, "must be a whole number"),
        ("reversed_codes", "yes", "must be True or False"),
    ],
)
def test_hints_of_the_wrong_kind(tmp_path, cube, hint, value, text):
    lf.write(cube, tmp_path / "x.h5")
    with pytest.raises(ConfigError, match=f"hint {hint} {text}"):
        read(tmp_path / "x.h5", **{hint: value})


def test_hints_go_before_what_the_file_says(tmp_path, cube):
    lf.write(cube, tmp_path / "x.h5")
    back = read(tmp_path / "x.h5", bin_width_ps=51.5, reversed_codes=True, no_photon_code=2)
    assert (back.bin_width_ps, back.reversed_codes, back.no_photon_code) == (51.5, True, 2)
    assert back.laser_period_ps == 800.0
    with pytest.raises(ConfigError, match=r"hint bin_width_ps must be positive, got -1"):
        read(tmp_path / "x.h5", bin_width_ps=-1)


def test_files_that_are_nothing(tmp_path):
    (tmp_path / "empty.h5").touch()
    (tmp_path / "text.md").write_text("# not a recording")
    (tmp_path / "text.h5").write_text("# not a recording")
    (tmp_path / "text.txt.gz").write_bytes(gzip.compress(b"# not a recording"))
    for name, text in [
        ("absent.h5", "there is no such file"),
        ("empty.h5", "is empty"),
        ("text.md", "of no known format"),
        ("text.h5", "is not an HDF5 file"),
        ("text.txt.gz", "no line 'Pixel <n>'"),
        (".", "is a folder"),
    ]:
        with pytest.raises(FileFormatError, match=text) as caught:
            read(tmp_path / name)
        assert str(tmp_path) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_writing_asks_for_a_suffix_and_a_record(tmp_path, cube):
    with pytest.raises(ValueError, match=r"cannot tell the format of 'x.doc': .*\.npz"):
        lf.write(cube, tmp_path / "x.doc")
    with pytest.raises(ValueError, match="can be read, not written"):
        lf.write(cube, tmp_path / "x.npy", format="npy")
    with pytest.raises(TypeError, match="only a Recording or Histograms"):
        lf.write(cube.counts, tmp_path / "x.h5")


@pytest.mark.parametrize("suffix", [".h5", ".npz", ".mat", ".zarr", ".bin", ".photon.h5"])
def test_a_full_disk_is_one_sentence_and_keeps_the_old_file(tmp_path, suffix):
    """For real, in a process that may write no file beyond 200 kB."""
    if suffix == ".zarr":
        pytest.importorskip("zarr")
    path = tmp_path / f"x{suffix}"
    script = f"""
        import resource
        import numpy as np
        import lightflight as lf
        rng = np.random.default_rng(0)
        def record(n):
            if {suffix!r} not in (".bin", ".photon.h5"):
                return lf.Histograms(rng.integers(0, 2**31, (8, 8, n)))
            return lf.Recording.from_frames(
                rng.integers(0, 1024, (n, 8, 8)).astype(np.uint16), n_codes=1024,
                no_photon_code=0, laser_period_ps=5e4, periods_per_frame=10,
            )
        lf.write(record(5), {str(path)!r})
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
        try:
            lf.write(record(20_000), {str(path)!r})
        except OSError as error:
            print(error)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True
    )
    assert "cannot write, File too large: free some space" in done.stdout
    assert str(path) in done.stdout
    assert done.stdout.count("\n") == 1
    hints = {"shape": (8, 8)} if suffix == ".bin" else {}
    assert lf.histogram(read(path, **hints)).shape == (8, 8)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


# --- plug-ins ---------------------------------------------------------------------------


@pytest.fixture
def _forget_formats():
    registry.known_formats.cache_clear()
    yield
    registry.known_formats.cache_clear()


@pytest.mark.usefixtures("_forget_formats")
def test_an_installed_plug_in_package_is_found(tmp_path):
    """A real package with a real entry point, in a process of its own."""
    (tmp_path / "dummy_camera.py").write_text(
        textwrap.dedent(
            """
            import numpy as np
            from lightflight.formats.registry import Format
            from lightflight.recording.histograms import Histograms

            def read(path, clock, *, brightness=1):
                return Histograms(np.full((2, 3, 4), brightness), **clock)

            FORMAT = Format("dummy", "a dummy", (".dummy",), lambda path, start: False, read)
            """
        )
    )
    meta = tmp_path / "dummy_camera-1.0.dist-info"
    meta.mkdir()
    (meta / "METADATA").write_text("Metadata-Version: 2.1\nName: dummy-camera\nVersion: 1.0\n")
    (meta / "entry_points.txt").write_text("[lightflight.formats]\ndummy = dummy_camera:FORMAT\n")
    (tmp_path / "x.dummy").write_text("content")
    script = f"""
        import sys
        sys.path.insert(0, {str(tmp_path)!r})
        import lightflight as lf
        hist = lf.read({str(tmp_path / "x.dummy")!r}, brightness=7, bin_width_ps=3)
        print(hist.counts.shape, hist.counts.max(), hist.bin_width_ps)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(script)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split("\n")[0] == "(2, 3, 4) 7 3"


@pytest.mark.usefixtures("_forget_formats")
@pytest.mark.parametrize(
    ("target", "text"), [("no_such_module:FORMAT", "cannot be loaded"), ("math:pi", "not a Format")]
)
def test_a_broken_plug_in_is_left_out_with_a_warning(monkeypatch, target, text):
    point = EntryPoint("broken", target, registry.ENTRY_POINT_GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: [point])
    with pytest.warns(LightflightWarning, match=f"'broken' .*{text}.* left out"):
        names = [file_format.name for file_format in registry.known_formats()]
    assert "lightflight" in names

"""What importing loads, read off `sys.modules` in a fresh interpreter: seconds would be noise."""

import subprocess
import sys

import pytest

HEAVY = (
    "scipy", "numba", "llvmlite", "h5py", "matplotlib", "rich", "dask", "distributed", "plotly",
    "zarr", "pyarrow", "cv2", "imageio_ffmpeg", "ptufile", "sdtfile", "tomli_w",
)  # fmt: skip

_REPORT = "; import sys; print(*sorted({name.partition('.')[0] for name in sys.modules}))"


def loaded_by(statement):
    done = subprocess.run(
        [sys.executable, "-c", statement + _REPORT], capture_output=True, text=True, check=True
    )
    return set(done.stdout.splitlines()[-1].split())


def test_importing_the_package_loads_no_heavy_package_and_no_numpy():
    loaded = loaded_by("import lightflight")
    assert not loaded & {*HEAVY, "numpy", "click"}


def test_help_loads_no_heavy_package_and_no_numpy():
    statement = (
        "import contextlib, io\n"
        "from lightflight.cli import main\n"
        "with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):\n"
        "    main(['--help'])\n"
        "assert 'reconstruct' in out.getvalue()\n"
        "pass"
    )
    assert not loaded_by(statement) & {*HEAVY, "numpy"}


@pytest.mark.parametrize(
    "command",
    [
        "simulate", "info", "convert", "calibrate", "reconstruct", "batch", "demo", "paper",
        "versions",
    ],
)  # fmt: skip
def test_help_of_a_command_loads_no_heavy_package(command):
    statement = (
        "import contextlib, io\n"
        "from lightflight.cli import main\n"
        "with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.suppress(SystemExit):\n"
        f"    main(['{command}', '--help'])\n"
        f"assert '{command}' in out.getvalue()\n"
        "pass"
    )
    assert not loaded_by(statement) & {*HEAVY, "numpy"}


def test_reconstructing_loads_no_plotting_and_no_dask():
    loaded = loaded_by(
        "import lightflight as lf; lf.reconstruct, lf.simulate, lf.read, lf.LightPath"
    )
    assert not loaded & {"matplotlib", "plotly", "dask", "distributed", "rich", "click"}


def test_reading_a_set_up_and_a_recording_loads_no_scipy():
    """A sixth of what `info` waited for."""
    loaded = loaded_by("import lightflight.lab.keys; import lightflight as lf; lf.read")
    assert not loaded & {"scipy", "numba", "matplotlib"}


def test_a_fit_loads_neither_signals_nor_statistics():
    """A third of what every process of `reconstruct` waited for before it began."""
    statement = (
        "import sys, lightflight.reconstruct.ways.joint, lightflight.reconstruct.ways.photon\n"
        "import lightflight.reconstruct.verdict.examine\n"
        "print({'scipy.signal', 'scipy.stats'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", statement], capture_output=True, text=True, check=True
    )
    assert done.stdout == "set()\n"

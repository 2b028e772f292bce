"""Small recordings on disk, made once by the command line itself."""

import pytest
from click.testing import CliRunner

from lightflight.cli import main


def lines_said(done):
    """Lines on stderr, without those that tell on a busy machine what takes long ("... ...")."""
    return [line for line in done.stderr.strip().splitlines() if not line.endswith(" ...")]


LAB = """
[camera]
distance_mm = 535.0
field_of_view_mm = [245.0, 245.0]
center_mm = [187.5, 37.5]

[source]
position_mm = [0.0, 0.0, 0.0]
pulse_fwhm_ps = 68.0
"""


@pytest.fixture(scope="session")
def run():
    """Run the command line in this process; gives click's Result."""

    def run_command(*words):
        return CliRunner().invoke(main, [str(word) for word in words], prog_name="lightflight")

    return run_command


@pytest.fixture(scope="session")
def lab_folder(tmp_path_factory, run):
    """Folder with lab.toml, recording.h5, bright.h5, flat.h5 and calibration.h5."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "lab.toml").write_text(LAB)
    for kind, photons, name in (
        ("histograms", 20_000, "recording.h5"),
        ("code_density", 400_000, "bright.h5"),
        ("flat", 40_000, "flat.h5"),
    ):
        done = run("simulate", "--kind", kind, "--photons", photons, "-o", folder / name)
        assert done.exit_code == 0, done.stderr
    done = run(
        "calibrate", "--code-density", folder / "bright.h5", "--flat", folder / "flat.h5",
        "--dead-codes", "absorbed", "-o", folder / "calibration.h5",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    return folder

"""A small campaign on disk: 16 x 16 pixels, two angles, five repeats."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import lightflight as lf
from lightflight.simulate.presets import ideal

LAB = """
[camera]
shape = [16, 16]
distance_mm = 535.0
field_of_view_mm = [245.0, 245.0]
center_mm = [122.5, 0.0]

[source]
position_mm = [0.0, 0.0, 0.0]
pulse_fwhm_ps = 68.0

[reconstruct]
n_legs = 1
"""

CAMPAIGN = """
[campaign]
lab = "lab.toml"

[[groups]]
recordings = "angle_{set_point_deg}/*.h5"
"""

ANGLES = (-4, 4)
N_REPEATS = 5


def recording_at(angle_deg: float, seed: int, photons: float = 300.0) -> lf.Recording:
    """Photon events of one straight leg."""
    angle = np.deg2rad(angle_deg)
    scene = lf.Scene(
        [[0, 0, 0], [245 * np.cos(angle), 10, 245 * np.sin(angle)]],
        camera=lf.Camera.facing_plane(
            shape=(16, 16),
            distance_mm=535.0,
            field_of_view_mm=(245.0, 245.0),
            center_mm=(122.5, 0.0),
        ),
        source=lf.Source((0, 0, 0), pulse_fwhm_ps=68.0),
        detector=replace(ideal(), n_codes=128, bin_width_ps=55.0),
    )
    return lf.simulate(scene, photons_per_pixel=photons, seed=seed, kind="events")


def make_campaign(folder: Path, n_repeats: int = N_REPEATS, seed: int = 100) -> None:
    """Write campaign.toml, lab.toml and the recordings that they name, the same every time."""
    folder.mkdir(exist_ok=True)
    (folder / "lab.toml").write_text(LAB)
    (folder / "campaign.toml").write_text(CAMPAIGN)
    for angle in ANGLES:
        (folder / f"angle_{angle}").mkdir()
        for k in range(n_repeats):
            recording = recording_at(angle, seed=seed + 10 * k + angle)
            lf.write(recording, folder / f"angle_{angle}" / f"run{k + 8}.h5")


@pytest.fixture(scope="session")
def campaign_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with campaign.toml, lab.toml and ten recordings."""
    folder = tmp_path_factory.mktemp("campaign")
    make_campaign(folder)
    return folder

"""Write the small files that every later version must be able to read.

Run once for each schema version that is released, never again for an old one: the test
`tests/formats/test_schema.py` reads all of them and knows what is in them.

    python tools/make_schema_files.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import lightflight as lf
from lightflight.store import SCHEMA_VERSION

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "data"
CLOCK = {
    "bin_width_ps": 55.0,
    "laser_period_ps": 50_000.0,
    "periods_per_frame": 4000,
    "reversed_codes": True,
    "first_edge_ps": -3.5,
    "no_photon_code": 0,
}
SETTINGS = {"temperature_c": 21.5, "camera": "PF32", "notes": ["µ"]}


def known_frames() -> np.ndarray:
    """(9, 2, 3) codes below 32 that follow from a formula; a third of them 0."""
    index = np.arange(9 * 2 * 3)
    codes = np.where(index % 3 == 1, 0, index * 7 % 31 + 1)
    return codes.reshape(9, 2, 3).astype(np.uint16)


def main() -> None:
    """Write the files of the current version."""
    FOLDER.mkdir(exist_ok=True)
    recording = lf.Recording.from_frames(known_frames(), n_codes=32, settings=SETTINGS, **CLOCK)
    dense = lf.Recording.from_frames(known_frames(), n_codes=32)
    for name, record in (
        ("recording", recording),
        ("frames", dense),
        ("histograms", lf.histogram(recording)),
    ):
        path = FOLDER / f"{name}_schema_{SCHEMA_VERSION}.h5"
        if path.exists():
            print(f"{path.name} exists and stays as it is")
            continue
        lf.write(record, path, provenance={"command": "tools/make_schema_files.py"})
        print(f"{path.name}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()

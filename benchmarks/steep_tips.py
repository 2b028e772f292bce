"""Tips of a steep leg between two rows of pixels, where no other pixel counts anything.

One leg of 300 mm at 60 degrees, all of it in the picture, 4,000 photons a pixel, a detector without
defects: nothing tells a halo from the leg. Printed for the end of the leg: rms of its distance
along the leg from where it is (mm), rms pull, median and largest stated error (mm), refusals.

    python benchmarks/steep_tips.py --method photon --first 20 --runs 60
"""

from __future__ import annotations

import argparse
import warnings

import numpy as np

import lightflight as lf
from lightflight.errors import LightflightWarning
from lightflight.simulate.presets import ideal

LEG_MM = 300.0


def scene_of(angle_deg: float) -> lf.Scene:
    """The leg about the middle of the field, its source where it begins."""
    angle = np.radians(angle_deg)
    half = 0.5 * LEG_MM * np.array([np.cos(angle), 0.0, np.sin(angle)])
    return lf.Scene(
        np.array([-half, half]),
        camera=lf.Camera.facing_plane(),
        source=lf.Source(-half, emission_time_ps=2000.0, pulse_fwhm_ps=68.0),
        detector=ideal(psf_std_px=0.3, active_width_px=0.12),
    )


def main() -> None:
    """Print one line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--method", default="photon")
    parser.add_argument("--angle", type=float, default=60.0, help="degrees")
    parser.add_argument("--first", type=int, default=20, help="first seed")
    parser.add_argument("--runs", type=int, default=60)
    options = parser.parse_args()
    warnings.simplefilter("ignore", LightflightWarning)
    scene, rows, refused = scene_of(options.angle), [], 0
    along = np.diff(scene.vertices_mm, axis=0)[0] / LEG_MM
    for seed in range(options.first, options.first + options.runs):
        hist = lf.simulate(scene, photons_per_pixel=4000.0, seed=seed, threads=1)
        try:
            path = lf.reconstruct(
                hist, camera=scene.camera, source=scene.source, n_legs=1,
                timing=lf.TimingCalibration.nominal(hist), method=options.method,
            )  # fmt: skip
        except (ValueError, RuntimeError):
            refused += 1
            continue
        place = path.covariance[-4:-1, -4:-1]
        rows.append(
            ((path.vertices_mm - scene.vertices_mm)[-1] @ along, np.sqrt(along @ place @ along))
        )
    error, stated = np.array(rows).T
    print(
        f"{options.method}: {len(rows)} tips, {np.sqrt(np.mean(error**2)):.2f} mm rms, pull "
        f"{np.sqrt(np.mean((error / stated) ** 2)):.2f}, stated {np.median(stated):.2f} mm "
        f"(median), {stated.max():.2g} mm at most; {refused} refused"
    )


if __name__ == "__main__":
    main()

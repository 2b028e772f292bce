"""Ready-made detectors and scenes.

Detectors: `ideal`, `pf32` (as measured on a real one), `spad256`, `streak`.
Scenes: `paper_scene` (three legs, two mirrors), `angle_scene` (one leg at an angle).
"""

from __future__ import annotations

import math
from typing import Any, Literal

from lightflight.camera.model import Camera
from lightflight.flight import Medium, Source
from lightflight.simulate.detector import Detector
from lightflight.simulate.scene import Scene

LASER_PERIOD_PS = 50_000.0
"""The paper's laser: 20 MHz."""

PULSE_FWHM_PS = 68.0
"""The paper's laser, by its manual."""

PF32_PHASES = (1.036, 0.922, 0.990, 1.096, 0.968, 0.982, 0.936, 1.069)
"""Relative width of the codes modulo 8, mean over a real PF32's array."""

PF32_PHASE_RMS = 0.030
"""Spread of a pixel's own eight widths about that mean, as the covariance between the even and
the odd periods of eight tells (Poisson noise drops out)."""

PF32_START_WIDTHS = (1.76, 1.53, 1.13)
"""Relative widths of its first three live codes (8, 9, 10), the eight phases taken off."""

PF32_END_CODE = 914.6
"""Code at which the 50 ns period ends."""

PAPER_VERTICES_MM = ((0.0, 0.0, 0.0), (375.0, 25.0, 50.0), (0.0, 50.0, 10.0), (375.0, 75.0, 50.0))
"""Source, two mirrors, exit; the paper gives the box, these corners fill it."""

_FIELD_MM = 245.0
_CAMERA_DISTANCE_MM = 535.0
_OUTSIDE_MM = 65.0


# --- detectors --------------------------------------------------------------------------


def ideal(**changes: Any) -> Detector:
    """A clean forward clock of 55 ps codes, 150 ps response, no defect.

    Parameters
    ----------
    **changes : object
        Fields of `Detector` to set otherwise.

    Returns
    -------
    Detector
        909 codes over a laser period of 50 ns.
    """
    return Detector(**changes)


def pf32(
    seed: int = 0, *, dead_codes: Literal["absorbed", "lost"] = "absorbed", **changes: object
) -> Detector:
    """The paper's camera with the defects measured on a real one of its kind.

    Parameters
    ----------
    seed : int, optional
        Which camera: decides gains, phases, delays and screaming pixels.
    dead_codes : {"absorbed", "lost"}, optional
        What became of the time of the dead codes 1-7. "absorbed": the live codes share it (55.06 ps
        each); "lost": its photons are lost (54.67 ps each).
    **changes : object
        Fields of `Detector` to set otherwise, e.g. `skew_range_ps=0.0`.

    Returns
    -------
    Detector
        A reversed clock of 1,024 codes; give the scene a camera of shape (32, 32).
    """
    if dead_codes not in ("absorbed", "lost"):
        raise ValueError(f'dead_codes must be "absorbed" or "lost", got {dead_codes!r}')
    lost = dead_codes == "lost"
    start_excess = sum((width - 1.0) * PF32_PHASES[k] for k, width in enumerate(PF32_START_WIDTHS))
    codes = PF32_END_CODE if lost else PF32_END_CODE - 8.0 + start_excess
    settings: dict[str, Any] = {
        "seed": seed,
        "psf_std_px": 0.35,
        "active_width_px": 6.1 / 50.0,
        "n_codes": 1024,
        "bin_width_ps": 55.0,
        "code_width_ps": LASER_PERIOD_PS / codes,
        "laser_period_ps": LASER_PERIOD_PS,
        "reversed_codes": True,
        "no_photon_code": 0,
        "first_live_code": 8,
        "start_code_widths": PF32_START_WIDTHS,
        "dead_time_is_lost": lost,
        "gain_rms": 0.0065,
        "phase_pattern": PF32_PHASES,
        "phase_rms": PF32_PHASE_RMS,
        "skew_range_ps": 300.0,
        "response_fwhm_ps": 150.0,
        "periods_per_frame": 4000,
        "first_photon_only": True,
        "dark_rate_hz": 50.0,
        "dark_rate_spread": 0.5,
        "screaming_fraction": 73 / 1024,
        "screaming_occupancy": (0.6, 1.0),
    }
    return Detector(**(settings | changes))


def spad256(seed: int = 0, **changes: object) -> Detector:
    """A 256 x 256 array with 61 % fill factor and a gated clock of 512 codes of 38 ps.

    The kind of array the paper hopes for. Codes start at `first_edge_ps` after the sync; light
    outside the 19 ns gate is lost. Give the scene a camera of shape (256, 256).

    Parameters
    ----------
    seed : int, optional
        Which camera: decides all random defects of its pixels.
    **changes : object
        Fields of `Detector` to set otherwise.

    Returns
    -------
    Detector
        A forward clock without a code for "no photon".
    """
    settings: dict[str, Any] = {
        "seed": seed,
        "psf_std_px": 0.6,
        "active_width_px": math.sqrt(0.61),
        "n_codes": 512,
        "bin_width_ps": 38.0,
        "laser_period_ps": LASER_PERIOD_PS,
        "gain_rms": 0.005,
        "phase_rms": 0.03,
        "phase_pattern": (1.02, 0.98, 1.01, 0.99),
        "skew_range_ps": 200.0,
        "response_fwhm_ps": 120.0,
        "periods_per_frame": 4000,
        "first_photon_only": True,
        "dark_rate_hz": 20.0,
        "dark_rate_spread": 0.6,
        "screaming_fraction": 0.01,
        "crosstalk_probability": 0.002,
    }
    return Detector(**(settings | changes))


def streak(**changes: object) -> Detector:
    """A scanned streak camera: one sweep of 1024 codes of 2 ps, no period, no frames.

    The sweep starts at `first_edge_ps`; light outside it is lost.

    Parameters
    ----------
    **changes : object
        Fields of `Detector` to set otherwise.

    Returns
    -------
    Detector
        Without laser period: nothing folds.
    """
    settings: dict[str, Any] = {
        "psf_std_px": 0.6,
        "active_width_px": 1.0,
        "n_codes": 1024,
        "bin_width_ps": 2.0,
        "laser_period_ps": None,
        "response_fwhm_ps": 10.0,
    }
    return Detector(**(settings | changes))


PRESETS = {"ideal": ideal, "pf32": pf32, "spad256": spad256, "streak": streak}
"""Detectors by name, for set-up files."""


# --- scenes -----------------------------------------------------------------------------


def paper_scene(detector: Detector | None = None, **changes: Any) -> Scene:
    """The paper's three-leg experiment: source, two mirrors and exit outside the field of view.

    Parameters
    ----------
    detector : Detector, optional
        None: `pf32()`.
    **changes : object
        Fields of `Scene` to set otherwise. The source is at its true place, its emission time not
        known.

    Returns
    -------
    Scene
        The light field of 245 mm, seen from 535 mm.

    References
    ----------
    G. Zheng et al. 2020; vertices within the box that it gives.
    """
    settings: dict[str, Any] = {
        "camera": _paper_camera((187.5, 37.5), (32, 32)),
        "source": Source(PAPER_VERTICES_MM[0], pulse_fwhm_ps=PULSE_FWHM_PS),
        "medium": Medium(),
        "detector": pf32() if detector is None else detector,
    }
    vertices = changes.pop("vertices_mm", PAPER_VERTICES_MM)
    return Scene(vertices, **(settings | changes))


def angle_scene(
    angle_deg: float, detector: Detector | None = None, *, height_mm: float = 0.0, **changes: object
) -> Scene:
    """One leg along x through the middle of the field, at an elevation towards the camera.

    The source lies on the z = 0 plane, 65 mm left of the field's edge; the leg ends 65 mm
    beyond the far edge (for legs so steep that they would pass the camera: halfway to it).

    Parameters
    ----------
    angle_deg : float
        Elevation, in (-90, 90); positive: towards the camera.
    detector : Detector, optional
        None: `pf32()`.
    height_mm : float, optional
        y of the leg, against the middle of the field.
    **changes : object
        Fields of `Scene` to set otherwise.

    Returns
    -------
    Scene
        With a path of two vertices.

    Raises
    ------
    ValueError
        For an angle that is not in (-90, 90).
    """
    if not -90.0 < angle_deg < 90.0:
        raise ValueError(f"angle_deg must lie between -90 and 90, got {angle_deg}")
    start_x = -_OUTSIDE_MM
    run = _FIELD_MM + 2.0 * _OUTSIDE_MM
    rise = run * math.tan(math.radians(angle_deg))
    shortening = min(1.0, 0.5 * _CAMERA_DISTANCE_MM / rise) if rise > 0 else 1.0
    end = (start_x + shortening * run, height_mm, shortening * rise)
    start = (start_x, height_mm, 0.0)
    settings: dict[str, Any] = {
        "camera": _paper_camera((0.5 * _FIELD_MM, 0.0), (32, 32)),
        "source": Source(start, pulse_fwhm_ps=PULSE_FWHM_PS),
        "medium": Medium(),
        "detector": pf32() if detector is None else detector,
    }
    return Scene((start, end), **(settings | changes))


def _paper_camera(center_mm: tuple[float, float], shape: tuple[int, int]) -> Camera:
    return Camera.facing_plane(
        shape,
        distance_mm=_CAMERA_DISTANCE_MM,
        field_of_view_mm=(_FIELD_MM, _FIELD_MM),
        center_mm=center_mm,
    )

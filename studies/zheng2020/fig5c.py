"""Fig. 5(c): width of the pulse against its angle, by both readings (see `pulse_width`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightflight.simulate.presets import angle_scene
from studies.zheng2020 import fig5a
from studies.zheng2020.pulse_width import frame_width_theory_ps
from studies.zheng2020.work import Unit

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fig5c:
    """FWHM of the pulse, ps; mean over the recordings of each angle and their scatter."""

    angles_deg: Floats
    """(a,), true angles."""
    pixel_ps: Floats
    """(a,), of a pixel, deconvolved."""
    pixel_std_ps: Floats
    """(a,), scatter between recordings."""
    frame_ps: Floats
    """(a,), of a frame, in event time, deconvolved."""
    frame_std_ps: Floats
    """(a,), scatter between recordings."""
    theory_pixel_ps: float
    """The laser's, at every angle."""
    theory_frame_ps: Floats
    """(a,), n_p tau / (n_p - n_r d.u)."""

    @property
    def width_ps(self) -> float:
        """Mean deconvolved width of a pixel's pulse: what the paper reports as 65 ps."""
        return float(np.mean(self.pixel_ps))


def units(quick: bool) -> tuple[Unit, ...]:
    """Those of Fig. 5(a)."""
    return fig5a.units(quick)


def record_from_results(results: Sequence[Mapping[str, Any]]) -> Fig5c:
    """The figure from the results of `units`."""

    def column(name: str) -> Floats:
        return np.array([[one[name] for one in result["widths"]] for result in results])

    angles = np.array([one["angle_deg"] for one in results])
    pixel, frame = column("pixel_deconvolved_ps"), column("frame_deconvolved_ps")
    scenes = [angle_scene(float(angle)) for angle in angles]
    return Fig5c(
        angles_deg=angles,
        pixel_ps=pixel.mean(axis=1),
        pixel_std_ps=pixel.std(axis=1),
        frame_ps=np.nanmean(frame, axis=1),
        frame_std_ps=np.nanstd(frame, axis=1),
        theory_pixel_ps=scenes[0].pulse_fwhm_ps,
        theory_frame_ps=np.array([frame_width_theory_ps(s) for s in scenes]),
    )

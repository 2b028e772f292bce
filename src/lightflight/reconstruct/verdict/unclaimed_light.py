"""Pulses on no leg of a path that all tests let stand, or of which none of counts was made.

Where footprints are cut, within two pixels of corners and ends in the picture, no test of counts
looks; a short leg may lie there as a whole. Whether its pulses come when some leg's light does is
asked of all.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from lightflight.path.verdict import FindingName, Level, Verdict, noted
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model.light import MUCH
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.model.sighting import Sighting, first_of_each_view
from lightflight.reconstruct.trials.unclaimed import unclaimed_by_path


def verdict_with_unclaimed_light(
    verdict: Verdict, fit: JointFit, sightings: list[Sighting], setting: Setting
) -> Verdict:
    """The verdict, "check" where much of the light is on no leg of the path.

    Parameters
    ----------
    verdict : Verdict
        On the path; only one of "trust" can change, or of counts that were not examined.
    fit : JointFit
        The path.
    sightings : list of Sighting
        The recordings as they were found.
    setting : Setting
        Camera, source, medium and waypoints.

    Returns
    -------
    Verdict
    """
    names = {one.name for one in verdict.findings}
    is_silent = verdict.level is Level.TRUST or FindingName.NOT_EXAMINED in names
    if verdict.level is Level.CONTRADICTED or not is_silent:
        return verdict
    # Elsewhere tests of counts look, where they are made.
    near = "" if FindingName.NOT_EXAMINED in names else ", near its corners or ends"
    for one in first_of_each_view(sightings):
        if not one.histograms.poisson:
            continue
        photons, left = one.arrivals.photons, unclaimed_by_path(one, fit, setting)
        share = float(np.sum(photons[left])) / max(float(np.sum(photons[one.usable_pulses])), 1.0)
        if share > MUCH:
            finding = noted(
                FindingName.UNEXPLAINED_LIGHT,
                f"{len(left)} pulses with {share:.2g} of the light come when no leg of the path is "
                f"there{near}",
                "say how many legs there are (n_legs, --n-legs), or try method photon",
            )
            return replace(verdict, level=Level.CHECK, findings=(*verdict.findings, finding))
    return verdict

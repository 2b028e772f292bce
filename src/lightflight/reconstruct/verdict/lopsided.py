"""Legs that are lopsided in the picture: light lies to one side of their line.

Across a leg counts follow the spot, which is even: its skewness is the first thing that is held at
nothing. A second beam beside the first (of a mirror silvered behind its glass, of a plate's other
face) or the coma of a lens moves the middle of the light, and with it line and times.
"""

from __future__ import annotations

import numpy as np

from lightflight.path.verdict import BlindSpot, FindingName
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.model.sizes import PLAUSIBLE
from lightflight.reconstruct.verdict.blind import Vertices, farthest
from lightflight.reconstruct.verdict.evidence import LIGHT, SEEN_AT, Evidence

_TOLD = 0.3
"""Skewness is asked for where it is known to this. Of a spot that hardly two rows of pixels see it
is known to one and more: there what pixels make of a spot stands for it."""

_OF_NO_ACCOUNT = 0.01
"""Skewness that pixels and lenses may have: it moves a line by less than a hundredth of the spot.
Of 58,000 photons on pixels that are active all over, along a column, an even spot shows 0.016."""

SECOND_BEAM = PLAUSIBLE["halo beside a leg"]
_PARTED = 2.0
"""Spots between two beams that are seen as two: where skewness is known to worse than 0.16, no
limit below that is told by it."""


def evidence_of_lopsided_legs(fit: JointFit) -> tuple[Evidence, ...]:
    """Whether the light of any leg lies to one side of its line, in any picture of it.

    Parameters
    ----------
    fit : JointFit
        The path, with its lines measured finely.

    Returns
    -------
    tuple of Evidence
        A symptom; () where no picture tells.

    Notes
    -----
    For each leg the score of a spot 1 + g He_3(u) / 6 times as bright at u of its standard
    deviations from the line, all else of the lines free (`LineFit.skewness`).
    """
    found = [
        (leg, line.skewness, line.skewness_std, float(np.hypot(line.skewness_std, _OF_NO_ACCOUNT)))
        for picture in fit.pictures
        for leg, line in enumerate(picture.fits)
        if line.skewness_std < _TOLD
    ]
    if not found:
        return ()
    deviates = [skewness / std for _, skewness, _, std in found]
    leg, skewness, _, std = found[int(np.argmax(np.abs(deviates)))]
    chi2, dof = float(np.sum(np.square(deviates))), len(deviates)
    return (
        Evidence(
            FindingName.HALO,
            chi2,
            dof,
            chi2 - dof,
            f"light lies beside leg {leg + 1}, to the {'right' if skewness > 0 else 'left'} of its "
            f"line as it flies (skewness {abs(skewness):.2g} ± {std:.2g}): line and times are of "
            "both together",
            "look for a second beam beside the leg, as from the front of a mirror silvered behind "
            "its glass, or focus the lens",
            symptom=True,
            data=LIGHT,
            widened=min(std / by_chance for _, _, by_chance, std in found),
            blind=blind_to_second_beams(fit),
        ),
    )


def blind_to_second_beams(fit: JointFit) -> tuple[BlindSpot, ...]:
    """The second beam beside a leg that moves the path most and makes it lopsided unseen.

    Parameters
    ----------
    fit : JointFit
        The path, with its lines measured finely.

    Returns
    -------
    tuple of BlindSpot
        () where none moves a vertex by more than is stated.

    Notes
    -----
    A share s of the light at d moves the middle of a spot by s d, and makes its skewness
    s (1 - s) (1 - 2 s) (d / spot)^3: half way into the spot nothing is seen of it.
    """
    lines, vertices = fit.lines, Vertices.of(fit, fit.solution, fit.solution.medium)
    gain = fit.solution.line_gain[: vertices.by_free.shape[1]]
    spots = []
    for (view, leg), away_px in _unseen_beams(fit).items():
        own = (lines.leg == leg) & (lines.view == view)
        offsets = lines.whitening[:, own].sum(axis=1) * SECOND_BEAM.size * away_px
        unit = f"{SECOND_BEAM.unit} of leg {leg + 1}, {away_px:.2g} px beside it"
        moved_mm = vertices.moved_mm(gain @ offsets)
        spots.append(vertices.spot(FindingName.HALO, SECOND_BEAM.size, unit, moved_mm))
    return farthest(spots)


def _unseen_beams(fit: JointFit) -> dict[tuple[int, int], float]:
    """By camera and leg, how far beside it a second beam is seen in half of all recordings, px."""
    share, found = SECOND_BEAM.size, dict[tuple[int, int], float]()
    for sighting, picture in zip(fit.sightings, fit.pictures, strict=True):
        for leg, line in enumerate(picture.fits):
            if np.isfinite(line.skewness_std):
                least = SEEN_AT * np.hypot(line.skewness_std, _OF_NO_ACCOUNT)
                parted = (least / (share * (1.0 - share) * (1.0 - 2.0 * share))) ** (1.0 / 3.0)
                away_px = line.spot_std_px * float(min(parted, _PARTED))
                found[sighting.view, leg] = min(away_px, found.get((sighting.view, leg), np.inf))
    return found

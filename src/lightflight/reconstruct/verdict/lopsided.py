"""Legs that are lopsided in the picture: light lies to one side of their line.

Across a leg counts follow the spot, which is even: its skewness is the first thing that is held at
nothing. A second beam beside the first (of a mirror silvered behind its glass, of a plate's other
face) or the coma of a lens moves the middle of the light, and with it line and times.
"""

from __future__ import annotations

import numpy as np

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.fit.joint import JointFit
from lightflight.reconstruct.verdict.evidence import LIGHT, Evidence

_TOLD = 0.3
"""Skewness is asked for where it is known to this. Of a spot that hardly two rows of pixels see it
is known to one and more: there what pixels make of a spot stands for it."""

_OF_NO_ACCOUNT = 0.01
"""Skewness that pixels and lenses may have: it moves a line by less than a hundredth of the spot.
Of 58,000 photons on pixels that are active all over, along a column, an even spot shows 0.016."""


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
        (leg, line.skewness, float(np.hypot(line.skewness_std, _OF_NO_ACCOUNT)))
        for picture in fit.pictures
        for leg, line in enumerate(picture.fits)
        if line.skewness_std < _TOLD
    ]
    if not found:
        return ()
    deviates = [skewness / std for _, skewness, std in found]
    leg, skewness, std = found[int(np.argmax(np.abs(deviates)))]
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
            np.empty((0, dof)),
            symptom=True,
            data=LIGHT,
        ),
    )

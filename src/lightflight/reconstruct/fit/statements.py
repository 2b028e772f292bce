"""What a fit's covariance means, in words a physicist uses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_CONFOUNDED = 0.99
"""Two quantities correlated more than this cannot be told apart by the data: one must be given."""
_LOOSE_MM = 20.0
"""A place with a larger error than this is hardly fixed, mm: the size of the scene's details."""
_LOOSE_PS = 60.0
"""A time with a larger error than this is hardly fixed, ps: what light needs for 20 mm."""


def statements_from_covariance(covariance: Floats, labels: tuple[str, ...]) -> tuple[str, ...]:
    """What the data fix badly: confounded pairs, and quantities they leave nearly free.

    Parameters
    ----------
    covariance : array of float, shape (p, p)
        Of the parameters named by `labels`, mm and ps.
    """
    std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    said: list[str] = []
    for label, error in zip(labels, std, strict=True):
        is_time = "time" in label
        if error > (_LOOSE_PS if is_time else _LOOSE_MM):
            unit = "ps" if is_time else "mm"
            said.append(f"The {label} is hardly fixed by these data (± {error:.0f} {unit}).")
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = covariance / (std[:, np.newaxis] * std)
    pairs = [
        (abs(float(correlation[i, j])), labels[i], labels[j])
        for i in range(len(labels))
        for j in range(i)
        if np.isfinite(correlation[i, j]) and abs(correlation[i, j]) > _CONFOUNDED
    ]
    for strength, one, other in sorted(pairs, reverse=True)[:3]:
        said.append(
            f"{other.capitalize()} and {one} are confounded (ρ = {strength:.3f}): give one of them."
        )
    return tuple(said)

"""Score tests on the counts: is there light that a plain flight has no place for?

Counts about the arrival of the path's light (`count_cells`) are held against what each pixel takes
up by itself (`count_pixels`). A cause adds columns C to the expected counts (`count_causes`). With
W the inverse variance of the counts (Poisson, and what the clock leaves unknown of its codes) and
C' what the pixels cannot take up of C, the score S = C'^T W (counts - expected) has the covariance
I = C'^T W C' where all is well, and S^T I^-1 S is what freeing the cause would gain.

Few counts make S skew. Its skewness is known, so deviates are those of a gamma variable of the same
skewness (Wilson and Hilferty, PNAS 17, 684 (1931)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.verdict.count_pixels import Pixels
from lightflight.reconstruct.verdict.evidence import LIGHT, Evidence

Floats = NDArray[np.float64]

_LEAST_SIGNAL = 1.0
"""A direction in which plausible sizes make no more than this, sigma, is not asked for."""


@dataclass(frozen=True, eq=False)
class Sums:
    """What all pixels say of K columns.

    Attributes
    ----------
    score : array of float, shape (K,)
    information : array of float, shape (K, K)
    left : tuple of (Floats, Floats)
        Of each group of pixels: what the pixels leave of the columns (cells, K), and the weights
        and means (2, cells), for the skewness.
    """

    score: Floats
    information: Floats
    left: tuple[tuple[Floats, Floats], ...]

    def skewness(self, columns: Floats) -> Floats:
        """(k,), of unit-variance sums along `columns` (K, k)."""
        third = np.zeros(columns.shape[1])
        for left, (weight, mean) in self.left:
            along = weight[:, np.newaxis] * (left @ columns)
            third += mean @ along**3
        return third


@dataclass(frozen=True)
class Cause:
    """Columns that belong to one cause.

    Attributes
    ----------
    name : FindingName
        The cause.
    columns : tuple of int
        Which of the K.
    plausible : float
        Size that each may plausibly have, in the columns' unit.
    sentence : str
        What was seen; `{size}` stands for the sum of the sizes, `{each}` for the largest's place.
    remedy : str
        What to do.
    symptom : bool
        True for what several causes bring.
    labels : tuple of str
        What each column is, for the sentence.
    """

    name: FindingName
    columns: tuple[int, ...]
    plausible: float
    sentence: str
    remedy: str
    symptom: bool = False
    labels: tuple[str, ...] = ()


def summed(groups: Sequence[tuple[Pixels, Floats]]) -> Sums:
    """Score and information of all groups of pixels; each with its columns (n, m, K)."""
    size = groups[0][1].shape[2]
    score, information = np.zeros(size), np.zeros((size, size))
    kept = []
    for pixels, columns in groups:
        used = np.flatnonzero(columns.any(axis=(0, 1)))
        left, own = pixels.left_of(columns[:, :, used])
        flat = left.reshape(-1, len(used))
        weight = pixels.weight.ravel()
        score[used] += own
        information[np.ix_(used, used)] += flat.T @ (
            weight[:, np.newaxis] * columns[:, :, used].reshape(flat.shape)
        )
        whole = np.zeros((len(flat), size))
        whole[:, used] = flat
        kept.append((whole, np.stack((weight, pixels.mean.ravel()))))
    return Sums(score, 0.5 * (information + information.T), tuple(kept))


def evidence_from_sums(sums: Sums, causes: Sequence[Cause]) -> list[tuple[Evidence, Floats]]:
    """The test of each cause that would leave a trace, and the sizes (K,) that it asks for."""
    values, vectors = np.linalg.eigh(sums.information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    tests = [_directions(sums, cause) for cause in causes]
    kept = [(cause, *test) for cause, test in zip(causes, tests, strict=True) if test is not None]
    if not kept:
        return []
    along = np.concatenate([columns for _, columns, _, _ in kept], axis=1)
    raw = sums.score @ along
    z = from_skewed(raw, sums.skewness(along))
    found, first = [], 0
    for cause, columns, signal, mixing in kept:
        own = slice(first, first + columns.shape[1])
        one = _evidence(cause, raw[own], z[own], root.T @ columns, signal, mixing)
        found.append((one, columns @ raw[own]))
        first = own.stop
    return found


def _directions(sums: Sums, cause: Cause) -> tuple[Floats, Floats, Floats] | None:
    """Columns (K, k) of independent unit-variance sums, their signal (k,) and mixing (c, k)."""
    own = list(cause.columns)
    information = cause.plausible**2 * sums.information[np.ix_(own, own)]
    values, mixing = np.linalg.eigh(information)
    kept = values > max(_LEAST_SIGNAL**2, 1e-9 * float(values[-1]))
    if not kept.any():
        return None
    signal, mixing = np.sqrt(values[kept]), mixing[:, kept]
    columns = np.zeros((len(sums.score), len(signal)))
    columns[own] = cause.plausible * mixing / signal
    return columns, signal, mixing


def _evidence(
    cause: Cause, raw: Floats, z: Floats, directions: Floats, signal: Floats, mixing: Floats
) -> Evidence:
    shrunk = signal**2 / (1.0 + signal**2)
    sizes = cause.plausible * (mixing @ (raw * shrunk / signal))
    chi2, dof = float(z @ z), len(z)
    gain = float(raw @ (shrunk * raw)) - len(cause.columns)
    # Light can be added, not taken away: less than none explains nothing.
    if sizes.sum() <= 0.0 and not cause.symptom:
        gain = min(gain, 0.0)
    largest = int(np.argmax(sizes))
    label = cause.labels[largest] if cause.labels else ""
    return Evidence(
        cause.name,
        chi2,
        dof,
        gain,
        cause.sentence.format(size=max(float(sizes.sum()), 0.0), each=label),
        cause.remedy,
        directions,
        z,
        cause.symptom,
        data=LIGHT,
    )


def from_skewed(z: Floats, skewness: Floats) -> Floats:
    """Normal deviates of sums that are as improbable as `z` of gamma variables of that skewness."""
    size = np.maximum(np.abs(skewness), 1e-6)
    root = 2.0 / size
    turned = np.sign(skewness + 1e-300) * z
    inner = np.maximum(1.0 + turned / root, 1e-6)
    # The mean of a cube root: 1 - 1 / 9k, k the shape of the gamma variable.
    straight = 3.0 * root * (np.cbrt(inner) - 1.0 + 1.0 / (9.0 * root**2))
    # Beyond some ten deviations cube roots and squares tell the same, and sizes should stay.
    far = (np.abs(z) > 10.0) & (size < 0.1)
    return np.where((size < 1e-4) | far, z, np.sign(skewness + 1e-300) * straight)

"""Score tests on the counts: is there light that a plain flight has no place for?

Counts about the arrival of the path's light (`model.cells`) are held against what each pixel takes
up by itself (`model.counted`). A cause adds columns C to the expected counts (`model.light`). With
W the inverse variance of the counts (Poisson, and what the clock leaves unknown of its codes) and
C' what the pixels cannot take up of C, the score S = C'^T W (counts - expected) has the covariance
I = C'^T W C' where all is well, and S^T I^-1 S is what freeing the cause would gain.

Few counts make S skew. Its skewness is known, so deviates are those of a gamma variable of the same
skewness (Wilson and Hilferty, PNAS 17, 684 (1931)).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from lightflight.path.verdict import FindingName
from lightflight.reconstruct.model.counted import Pixels
from lightflight.reconstruct.verdict.evidence import LIGHT, SELDOM, Evidence

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

ASK_THE_PIXELS = "look at the counts of single pixels (lightflight plot --what pixel)"
_LEAST_SIGNAL = 1.0
"""A direction in which plausible sizes make no more than this, sigma, is not asked for."""
_CLEAR_STDS = 6.0
"""Other light is looked for at this distance from a leg's pulse, in standard deviations."""


@dataclass(frozen=True, eq=False)
class Left:
    """What the pixels of one group leave of the columns.

    Attributes
    ----------
    pixels : Pixels
        Of the group.
    added : Columns
        The columns as causes have them.
    taken : array of float, shape (n, q, k)
        What the pixels' unknowns take up of them.
    """

    pixels: Pixels
    added: Columns
    taken: Floats

    @property
    def used(self) -> Indices:
        """(k,), the columns that are not zero in this group."""
        return self.added.used

    @property
    def weight(self) -> Floats:
        """(cells,), inverse variance of the counts."""
        return self.pixels.weight.ravel()

    @property
    def mean(self) -> Floats:
        """(cells,), expected counts."""
        return self.pixels.mean.ravel()

    @cached_property
    def columns(self) -> Floats:
        """(k, cells), what is left of them."""
        left = self.added.values - self.pixels.slopes @ self.taken
        return np.ascontiguousarray(left.reshape(-1, len(self.used)).T)

    def along(self, own: Sequence[int], mixing: Floats) -> Floats:
        """(j, cells): sums of the columns `own` (c,), each by its row of `mixing` (c, j)."""
        at = np.searchsorted(self.used, own)
        here = (at < len(self.used)) & (self.used[np.minimum(at, len(self.used) - 1)] == own)
        sums: Floats = mixing[here].T @ self.columns[at[here]]
        return sums


@dataclass(frozen=True, eq=False)
class Sums:
    """What all pixels say of K columns.

    Attributes
    ----------
    score : array of float, shape (K,)
    information : array of float, shape (K, K)
    groups : tuple of Left
        What each group of pixels leaves of the columns.
    """

    score: Floats
    information: Floats
    groups: tuple[Left, ...]

    @cached_property
    def root(self) -> Floats:
        """(K, K), of which the information is the square."""
        values, vectors = np.linalg.eigh(self.information)
        root: Floats = vectors * np.sqrt(np.maximum(values, 0.0))
        return root

    def skewness(self, own: Sequence[int], mixing: Floats) -> Floats:
        """(j,), of unit-variance sums of the columns `own` (c,) by `mixing` (c, j)."""
        if len(own) == 1:
            alone: Floats = self._third[own[0]] * mixing[0] ** 3
            return alone
        third = np.zeros(mixing.shape[1])
        for left in self.groups:
            along = left.weight * left.along(own, mixing)
            third += (along * along * along) @ left.mean
        return third

    @cached_property
    def _third(self) -> Floats:
        """(K,), third moment of the score of each column."""
        third = np.zeros(len(self.score))
        for left in self.groups:
            along = left.weight * left.columns
            third[left.used] += (along * along * along) @ left.mean
        return third


@dataclass(frozen=True, eq=False)
class Columns:
    """Counts per unit of size that causes add to a group of pixels.

    Attributes
    ----------
    values : array of float, shape (n, m, k)
        In n pixels of m cells each.
    used : array of int, shape (k,)
        Which of all columns they are, ascending; all others add nothing here.
    size : int
        Number of all columns.
    """

    values: Floats
    used: Indices
    size: int


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


def summed(groups: Sequence[tuple[Pixels, Columns]]) -> Sums:
    """Score and information of all groups of pixels, each with its columns."""
    size = groups[0][1].size
    score, information = np.zeros(size), np.zeros((size, size))
    kept = []
    for pixels, columns in groups:
        here, own, taken = pixels.said_of(columns.values)
        score[columns.used] += here
        information[np.ix_(columns.used, columns.used)] += own
        kept.append(Left(pixels, columns, taken))
    return Sums(score, information, tuple(kept))


def clear_of_pulses(pixels: Pixels) -> NDArray[np.bool_]:
    """(n, m), cells in which a path leaves so little light that one of them says something."""
    cells = pixels.cells
    middle = 0.5 * (cells.edges_ps[:, 1:] + cells.edges_ps[:, :-1])
    clear: NDArray[np.bool_] = cells.live & (pixels.weight > 0.0)
    for k in range(pixels.late_ps.shape[1]):
        away = np.abs(middle - pixels.late_ps[:, k : k + 1])
        lit = pixels.photons[:, k : k + 1] > 0.0
        clear &= (away > _CLEAR_STDS * pixels.drawn_out_ps[:, k : k + 1]) | ~lit
    return clear


def evidence_from_sums(
    sums: Sums, causes: Sequence[Cause], *, least_size: float = 0.0
) -> list[tuple[Evidence, Floats]]:
    """The test of each cause that would leave a trace, and the sizes (K,) that it asks for.

    Tests are silent up to the chi-square that `least_size` of their clearest column would bring.
    """
    found: list[tuple[Evidence, Floats]] = []
    for cause in causes:
        own = list(cause.columns)
        signal, mixing = _signal(cause.plausible**2 * sums.information[np.ix_(own, own)])
        if not len(signal):
            continue
        along = cause.plausible * mixing / signal
        z = raw = sums.score[own] @ along
        silent_below = least_size**2 * float(sums.information[own, own].max())
        directions = np.empty((0, len(raw)))
        if raw @ raw >= silent_below:
            z = from_skewed(raw, sums.skewness(own, along))
        if raw @ raw >= silent_below or chdtrc(len(raw), silent_below) > SELDOM:
            directions = sums.root[own].T @ along
        sizes = np.zeros(len(sums.score))
        sizes[own] = along @ raw
        one = _evidence(cause, raw, z, directions, signal, mixing, silent_below)
        found.append((one, sizes))
    return found


def _signal(information: Floats) -> tuple[Floats, Floats]:
    """Signal (k,) of the independent directions that plausible sizes show, and mixing (c, k)."""
    if len(information) == 1:
        kept = information[0] > _LEAST_SIGNAL**2
        return np.sqrt(information[0, kept]), np.ones((1, 1))[:, kept]
    values, mixing = np.linalg.eigh(information)
    kept = values > max(_LEAST_SIGNAL**2, 1e-9 * float(values[-1]))
    return np.sqrt(values[kept]), mixing[:, kept]


def _evidence(
    cause: Cause,
    raw: Floats,
    z: Floats,
    directions: Floats,
    signal: Floats,
    mixing: Floats,
    silent_below: float,
) -> Evidence:
    shrunk = signal**2 / (1.0 + signal**2)
    sizes = cause.plausible * (mixing @ (raw * shrunk / signal))
    chi2, dof = float(z @ z), len(z)
    gain = float(raw @ (shrunk * raw)) - len(cause.columns)
    gain = min(gain, 0.0) if chi2 < silent_below else gain
    # Light can be added, not taken away: less than none is no cause, but counts are not as they
    # should be.
    missing = sizes.sum() <= 0.0 and not cause.symptom
    label = cause.labels[int(np.argmax(sizes))] if cause.labels else ""
    sentence = cause.sentence.format(size=float(sizes.sum()), each=label)
    return Evidence(
        FindingName.UNEXPLAINED_LIGHT if missing else cause.name,
        chi2,
        dof,
        gain,
        f"counts are too low where {_words(cause)} would add to them" if missing else sentence,
        ASK_THE_PIXELS if missing else cause.remedy,
        directions,
        z,
        symptom=missing or cause.symptom,
        data=LIGHT,
        silent_below=silent_below,
    )


def _words(cause: Cause) -> str:
    return cause.name.replace("_", " ")


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

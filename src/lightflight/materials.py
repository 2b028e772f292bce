"""Materials that light crosses: a phase index that bends it and a group index that times it.

`Material` holds both, because an interface needs both and neither stands for the other. Named
materials take them from a dispersion formula at the laser's wavelength; each names its source.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from lightflight.arguments import finite_number, one_of
from lightflight.units import AIR_GROUP_INDEX

_MUST = "lie between 1 and 10"
_STEP_UM = 1e-4
"""Step of the central difference for n', um: exact to 1e-10 for formulas as smooth as these."""


class _Dispersion(NamedTuple):
    """n of a wavelength in um, and the range it was measured over, um."""

    index_at: Callable[[float], float]
    range_um: tuple[float, float]


def _sellmeier(*terms: tuple[float, float]) -> Callable[[float], float]:
    """n(wavelength in um) of n^2 = 1 + sum B w^2 / (w^2 - C), terms (B, C in um^2)."""

    def index(wavelength_um: float) -> float:
        square = wavelength_um**2
        return float(np.sqrt(1.0 + sum(b * square / (square - c) for b, c in terms)))

    return index


def _ciddor(wavelength_um: float) -> float:
    """Dry air of 15 deg C, 101,325 Pa and 450 ppm CO2."""
    wavenumber = wavelength_um**-2
    return 1.0 + 0.05792105 / (238.0185 - wavenumber) + 0.00167917 / (57.362 - wavenumber)


_DISPERSIONS = {
    # P. E. Ciddor, Applied Optics 35, 1566 (1996).
    "air": _Dispersion(_ciddor, (0.23, 1.69)),
    # M. Daimon, A. Masumura, Applied Optics 46, 3811 (2007), distilled, 20 deg C.
    "water": _Dispersion(
        _sellmeier(
            (0.5684027565, 0.005101829712),
            (0.1726177391, 0.01821153936),
            (0.02086189578, 0.02620722293),
            (0.1130748688, 10.69792721),
        ),
        (0.182, 1.129),
    ),
    # I. H. Malitson, J. Opt. Soc. Am. 55, 1205 (1965), 20 deg C.
    "fused silica": _Dispersion(
        _sellmeier((0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)),
        (0.21, 6.7),
    ),
    # SCHOTT, data sheet of N-BK7, 20 deg C.
    "BK7": _Dispersion(
        _sellmeier(
            (1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)
        ),
        (0.31, 2.5),
    ),
}

MATERIALS = tuple(_DISPERSIONS)
"""Names that `Material.named` knows."""


@dataclass(frozen=True)
class Material:
    """What light crosses: how it bends there and how fast its pulses fly.

    Raises ValueError for an index that is not between 1 and 10.

    Attributes
    ----------
    phase_index : float
        n, which bends rays (Snell's law).
    group_index : float
        n_g, which times pulses: they fly at c / n_g.
    name : str
        In what is printed.

    Examples
    --------
    >>> water = Material.named("water", wavelength_nm=532.0)
    >>> round(water.phase_index, 4), round(water.group_index, 4)
    (1.3354, 1.357)
    """

    phase_index: float

    group_index: float

    name: str = ""

    def __post_init__(self) -> None:
        for field in ("phase_index", "group_index"):
            number = finite_number(field, getattr(self, field), _MUST, low=1.0, high=10.0)
            object.__setattr__(self, field, number)

    @classmethod
    def named(cls, name: str, *, wavelength_nm: float) -> Material:
        """A material by its name, at the wavelength of the laser.

        Parameters
        ----------
        name : str
            One of `MATERIALS`: "air", "water", "fused silica", "BK7"; at 20 deg C, air at 15.
        wavelength_nm : float
            In vacuum, nm.

        Returns
        -------
        Material
            n_g = n - wavelength dn / d(wavelength).

        Raises
        ------
        ValueError
            For another name, or a wavelength that its formula was not measured at.
        """
        one_of("material", name, MATERIALS)
        dispersion = _DISPERSIONS[name]
        low, high = (1000.0 * end for end in dispersion.range_um)
        must = f"lie between {low:g} and {high:g} nm, where the index of {name} was measured"
        um = finite_number("wavelength_nm", wavelength_nm, must, low=low, high=high) / 1000.0
        n = dispersion.index_at
        slope = (n(um + _STEP_UM) - n(um - _STEP_UM)) / (2.0 * _STEP_UM)
        return cls(n(um), n(um) - um * slope, name)


AIR = Material(AIR_GROUP_INDEX, AIR_GROUP_INDEX, "air")
"""Air as the rest of the package counts it where nobody says more."""

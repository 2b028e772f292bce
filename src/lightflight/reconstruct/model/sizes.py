"""How far off a thing may be before it is no explanation: one table for verdict and `free=`.

The page of the verdict shows it. A cause that would need a larger size is ranked later, by the
square of what it needs; a thing that is freed has this size as its prior.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plausible:
    """One-sigma size that nobody would be surprised by, and its unit.

    Attributes
    ----------
    size : float
        In that unit.
    unit : str
        As it is shown.
    """

    size: float
    unit: str


_LIGHT = Plausible(0.3, "of the light")

PLAUSIBLE: dict[str, Plausible] = {
    # A ruler slips by centimetres, a number is typed for another bench.
    "source": Plausible(30.0, "mm"),
    # Ten centimetres of cable.
    "source time": Plausible(500.0, "ps"),
    "pose shift": Plausible(20.0, "mm"),
    "pose turn": Plausible(0.1, "rad"),
    # A field of view read off a screen, a zoom ring that moved.
    "focal_length": Plausible(0.1, "of itself"),
    # Pixels that are not square, a width and a height measured by themselves.
    "aspect": Plausible(0.02, "of itself one way"),
    # An array glued by hand behind its lens.
    "axis": Plausible(2.0, "px"),
    # A lens that sits askew, a tilted array.
    "decentering": Plausible(0.5, "px at the corner"),
    # A wide-angle lens that nobody calibrated: some px at the corner.
    "distortion": Plausible(3.0, "px at the corner"),
    # The wrong face of a pane, a tank that was moved.
    "window": Plausible(5.0, "mm"),
    # Twenty millimetres of glass are 36 ps.
    "block": Plausible(100.0, "ps"),
    # Air told for water (0.33) or fibre (0.47), or the other way round.
    "index": Plausible(0.5, ""),
    # Cables and triggers; another cable is 500 ps for 10 cm.
    "clock_offset": Plausible(500.0, "ps"),
    # Another temperature, another supply voltage; a nominal code width is off by a few percent.
    "clock_scale": Plausible(0.02, "of itself"),
    "clock_drift": Plausible(200.0, "ps"),
    # A warmer edge of the chip; a flat's screen that stood askew or a centimetre off.
    "calibration": Plausible(30.0, "ps at the picture's edge"),
    # Light that was too bright for the code density, another supply voltage.
    "codes": Plausible(20.0, "ps over the codes that were counted"),
    # Halves of an array with buffers of their own; a stage of a delay line that is one code longer.
    "jump": Plausible(50.0, "ps in a jump"),
    # What comparators of single-photon detectors are known for between dark and bright.
    "walk": Plausible(50.0, "ps"),
    # A beam that a lens of air (a heat haze, a jet) or a bent fibre turns.
    "curved_leg": Plausible(20.0, "mm sagitta"),
    # A fibre that was moved after it was measured.
    "drawn_curve": Plausible(20.0, "mm"),
    # A ruler laid to the mount and not to the mirror.
    "prior": Plausible(20.0, "mm"),
    # A mirror outside the picture.
    "unseen_leg": Plausible(200.0, "mm"),
    "unseen_leg time": Plausible(1000.0, "ps"),
    "trend": Plausible(200.0, "ps"),
    # More would be seen by eye.
    "haze": _LIGHT,
    "halo": _LIGHT,
    # The front of a mirror silvered behind its glass, at a slant.
    "halo beside a leg": Plausible(0.1, "of the light"),
    "glare": _LIGHT,
    "other_pulse": _LIGHT,
    "pile_up": Plausible(0.3, "of the brightest pixel's photons"),
}

"""Clocks drawn at random: are times of arrival where they are, within the errors stated?

    python benchmarks/random_clocks.py                     # 12 cameras of each kind
    python benchmarks/random_clocks.py --first 100 --cameras 20 --only folded table

The forward model is one of its own: edges of the codes of each pixel, Poisson counts of light that
ignores the laser, of a flat, and of flats at other times, which are found as a recording's pulses
are. Drawn: 16 x 16 or 24 x 24 pixels, how unequal codes are (to 8 %, and to 1 % by each pixel),
delays of pixels (60 to 300 ps rms), pulse (half with a tail), photons a pixel of the code density
(20,000 to 1,000,000), of the flat (3,000 to 200,000) and of the recordings (300 to 100,000). Kinds:

folded   codes of widths that all pixels share, made from the laser period
board    the same, going on beyond the period, reversed or not
array    a pattern that repeats, of each pixel's own; gains; dead codes, absorbed; a TDC's
table    each code of each pixel by itself, made from the period
gated    the same as `folded`, for a part of the period; gains that nobody can see

Printed per kind: error of a pixel against all others in its stated errors (rms, 95 % interval over
cameras), and the same of the mean of all pixels in those that pixels share: the error is that of a
time against the flat's. `--all`: every camera.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import lightflight as lf
from lightflight.errors import CalibrationError, NothingFoundError

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from benchmarks.refraction import interval
from tests.oracles.brute_force import gaussian_share, tailed_share

Floats = NDArray[np.float64]

KINDS = ("folded", "board", "array", "table", "gated")
PLACES = (0.2, 0.45, 0.6, 0.85)
"""Of the time that codes cover: where recordings' pulses are; the flat is at 0.4 of it."""
TURNS = (-1, 0, 1)
"""Light of the period before and after."""


@dataclass(frozen=True)
class Clock:
    """All that was drawn for one seed."""

    kind: str
    seed: int
    shape: tuple[int, int]
    edges_ps: Floats
    """(n, codes + 1), ps after the sync."""
    period_ps: float
    told_ps: float
    """Width of a code as the maker says it."""
    reversed_codes: bool
    no_photon_code: int | None
    pulse_ps: float
    tail_ps: float
    delays_ps: Floats
    density: float
    flat: float
    photons: float

    @property
    def covered_ps(self) -> tuple[float, float]:
        """From when to when every pixel counts."""
        return float(self.edges_ps[:, 0].max()), float(self.edges_ps[:, -1].min())

    def come(self, late_ps: Floats) -> Floats:
        """Share of a pulse that has come."""
        if not self.tail_ps:
            return gaussian_share(late_ps, self.pulse_ps)
        tailed: Floats = 0.6 * gaussian_share(late_ps, self.pulse_ps)
        return tailed + 0.4 * tailed_share(late_ps, self.pulse_ps, self.tail_ps)

    def histograms(self, counts: NDArray[np.integer]) -> lf.Histograms:
        """As the user describes them."""
        if self.reversed_codes:
            counts = counts[:, ::-1]
        return lf.Histograms(
            counts.reshape(*self.shape, -1).astype(np.uint32),
            bin_width_ps=self.told_ps,
            laser_period_ps=self.period_ps,
            reversed_codes=self.reversed_codes,
            no_photon_code=self.no_photon_code,
        )

    def pulse(self, rng: np.random.Generator, arrival_ps: float, photons: float) -> lf.Histograms:
        """Light that comes to all pixels at once."""
        late = self.edges_ps - arrival_ps - self.delays_ps[:, np.newaxis]
        before = sum(self.come(late + turn * self.period_ps) for turn in TURNS)
        level = 0.1 * photons / self.period_ps
        mean = photons * np.diff(before, axis=1) + level * np.diff(self.edges_ps, axis=1)
        return self.histograms(rng.poisson(mean))

    def words(self) -> str:
        """What kind of clock this is."""
        return (
            f"{self.kind} {self.seed}: {self.edges_ps.shape[1] - 1} codes of {self.told_ps:.1f} ps"
            f"{' reversed' if self.reversed_codes else ''}, pulse {self.pulse_ps:.0f}"
            f"{f' + {self.tail_ps:.0f}' if self.tail_ps else ''} ps, density {self.density:.0f}, "
            f"flat {self.flat:.0f}, photons {self.photons:.0f}"
        )


def drawn_clock(kind: str, seed: int) -> Clock:
    """The clock of a seed."""
    rng = np.random.default_rng([91, KINDS.index(kind), seed])
    shape = (16, 16) if rng.random() < 0.5 else (24, 24)
    n, told = shape[0] * shape[1], float(rng.uniform(20, 80))
    n_codes = int(rng.integers(120, 700))
    period = told * n_codes
    uneven, own = rng.uniform(0.0, 0.08), rng.choice([0.0, rng.uniform(0.0, 0.01)])
    widths = np.ones((n, n_codes)) * (1.0 + uneven * rng.normal(size=n_codes))
    widths = widths * (1.0 + own * rng.normal(size=widths.shape))
    flips, dead = bool(rng.random() < 0.5), None
    if kind == "array":
        pattern = 1.0 + 0.05 * rng.normal(size=int(rng.choice([4, 8, 16])))
        phases = pattern + 0.03 * rng.normal(size=(n, len(pattern)))
        phases /= phases.mean(axis=1, keepdims=True)
        n_codes = int(n_codes * rng.uniform(1.05, 1.3))
        gains = 1.0 + 0.006 * rng.normal(size=(n, 1))
        widths = phases[:, np.arange(n_codes) % len(pattern)] * gains
        start = int(rng.integers(0, 9))
        # The first live code takes up the time of the dead ones.
        widths[:, start] += widths[:, :start].sum(axis=1)
        widths[:, :start] = 0.0
        dead = 0 if start else None
    elif kind == "table":
        widths = np.maximum(1.0 + rng.uniform(0.1, 0.5) * rng.normal(size=(n, n_codes)), 0.0)
    elif kind == "board":
        n_codes = int(n_codes * rng.uniform(1.05, 1.3))
        shared = 1.0 + uneven * rng.normal(size=n_codes)
        widths = np.ones((n, n_codes)) * shared * (1.0 + own * rng.normal(size=(n, n_codes)))
        widths /= shared.mean()
    if kind in ("folded", "table"):
        widths *= n_codes / widths.sum(axis=1, keepdims=True)
    if kind == "gated":
        widths *= 1.0 + 0.003 * rng.normal() + 0.005 * rng.normal(size=(n, 1))
        period = told * n_codes * rng.uniform(1.2, 3.0)
        flips = False
    edges = np.concatenate((np.zeros((n, 1)), np.cumsum(told * widths, axis=1)), axis=1)
    edges = np.minimum(edges, period)
    if flips:
        # A counter that runs from the photon to the end of the period.
        edges = (period - edges)[:, ::-1]
    return Clock(
        kind, seed, shape, edges, period, told, flips, dead,
        pulse_ps=float(rng.uniform(max(40.0, 0.8 * told), 120)),
        tail_ps=float(rng.uniform(60, 200)) if rng.random() < 0.5 else 0.0,
        delays_ps=rng.normal(0, rng.uniform(60, 300), size=n),
        density=float(10 ** rng.uniform(4.3, 6)), flat=float(10 ** rng.uniform(3.5, 5.3)),
        photons=float(10 ** rng.uniform(2.5, 5)),
    )  # fmt: skip


def outcome(clock: Clock) -> tuple[Floats, Floats, float]:
    """Per recording: rms pull of pixels, pull of their mean; largest stated shared error, ps."""
    rng = np.random.default_rng([92, KINDS.index(clock.kind), clock.seed])
    even = clock.density * np.diff(clock.edges_ps, axis=1) / clock.period_ps
    first, last = clock.covered_ps
    at = first + 0.4 * (last - first)
    timing = lf.calibrate_timing(
        clock.histograms(rng.poisson(even)), flat=clock.pulse(rng, at, clock.flat),
        flat_arrival_ps=at, dead_codes="absorbed",
    )  # fmt: skip
    of_pixels, of_mean, most = [], [], 0.0
    for place in PLACES:
        arrival = first + place * (last - first)
        found = lf.find_arrivals(clock.pulse(rng, arrival, clock.photons), timing=timing)
        used = found.usable & (found.photons > 0.3 * clock.photons)
        error = (found.arrival_ps - arrival)[used]
        error -= clock.period_ps * np.round(error / clock.period_ps)
        own = found.independent_std_ps[used]
        weight = own**-2 / np.sum(own**-2)
        shared = (weight @ found.shared_modes_ps[used]) if found.shared_modes_ps.size else 0.0
        mean_std = float(np.sqrt(np.sum(np.square(shared)) + 1.0 / np.sum(own**-2)))
        mean = float(weight @ error)
        of_pixels.append(np.sqrt(np.mean(((error - mean) / own) ** 2)))
        of_mean.append(mean / mean_std)
        most = max(most, mean_std)
        used_share = used.mean()
        if used_share < 0.8:
            print(f"  {clock.words()}: {used_share:.0%} of pixels used")
    return np.array(of_pixels), np.array(of_mean), most


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cameras", type=int, default=12)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--only", nargs="+", choices=KINDS, default=KINDS)
    parser.add_argument("--all", action="store_true", help="print every camera")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    for kind in args.only:
        pixels, means, none = [], [], 0
        for seed in range(args.first, args.first + args.cameras):
            clock = drawn_clock(kind, seed)
            try:
                own, mean, most = outcome(clock)
            except (CalibrationError, NothingFoundError) as problem:
                none += 1
                print(f"  {clock.words()}: {problem}", flush=True)
                continue
            pixels.append(np.mean(own**2))
            means.append(np.mean(mean**2))
            if args.all or own.max() > 1.5 or np.abs(mean).max() > 4.0:
                print(
                    f"  {clock.words()}: pixels {np.round(own, 2)}, mean {np.round(mean, 1)} of up "
                    f"to {most:.2f} ps",
                    flush=True,
                )
        if pixels:
            print(
                f"{kind}: pull of pixels {interval(np.array(pixels), 1.0)}, of their mean "
                f"{interval(np.array(means), 1.0)}, refused {none}",
                flush=True,
            )


if __name__ == "__main__":
    main()

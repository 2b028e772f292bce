"""Pulses of a board without a flat: how far from a plane, by several ways to find them.

    python benchmarks/boards.py                  # all boards, one recording each
    python benchmarks/boards.py --runs 10 --first 50
    python benchmarks/boards.py --no-period      # as files that do not say how long the laser's is

32 x 32 pixels, codes of 16 ps in a period of 8.2 ns, a laser and detector of 30 ps (standard
deviation) of whose light a share is late by an exponential delay (SciPy's `exponnorm`), pixels lit
unequally (lognormal, 0.5), each with a delay of its own that a plane and a bowl make. "own": each
pixel has late light of its own besides, 5 % of it in mean, 100 to 600 ps late, as a board that lets
light in. No clock is told, no flat.

Printed: rms of the times about the truth, ps, but for a common shift: of the fullest code, of a
Gaussian through the five codes about it, of Gaussians by likelihood, of `find_arrivals` as it
comes, and of the shape that was put in; the rms pull of `find_arrivals`, and its CPU.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeWarning, curve_fit
from scipy.stats import exponnorm, norm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import lightflight as lf
from lightflight.timing.clock.response import Response

Floats = NDArray[np.float64]

SIZE, CODES, CODE_PS, STD_PS = 32, 512, 16.0, 30.0
BOARDS = (
    (0.0, 150.0, 2000.0, False), (0.0, 150.0, 2000.0, True), (0.1, 150.0, 300.0, False),
    (0.3, 150.0, 2000.0, False), (0.3, 150.0, 2000.0, True), (0.3, 400.0, 200.0, False),
    (0.2, 300.0, 20_000.0, True), (0.6, 80.0, 2000.0, False),
)  # fmt: skip
"""Share that is late, its mean delay in ps, photons of a typical pixel, light of its own."""
WAYS = ("fullest", "five codes", "Gaussians", "as it comes", "known shape")
EDGES_PS = CODE_PS * np.arange(CODES + 1)


def delays_ps() -> Floats:
    rows, cols = np.mgrid[:SIZE, :SIZE]
    bowl = 0.1 * ((cols - SIZE / 2) ** 2 + (rows - SIZE / 2) ** 2)
    return np.asarray(2500.0 + 3.1 * cols + 1.7 * rows + bowl)


def recording(
    share: float, tail_ps: float, photons: float, own: bool, seed: int, period_ps: float | None
) -> lf.Histograms:
    rng, at = np.random.default_rng([31, seed]), EDGES_PS - delays_ps()[..., np.newaxis]
    late = exponnorm.cdf(at, tail_ps / STD_PS, 0.0, STD_PS)
    came = np.diff((1.0 - share) * norm.cdf(at, 0.0, STD_PS) + share * late)
    if own:
        part, by = rng.exponential(0.05, at.shape[:2]), rng.uniform(100.0, 600.0, at.shape[:2])
        more = np.diff(norm.cdf(at, by[..., np.newaxis], 60.0))
        came = came + part[..., np.newaxis] * more
    bright = photons * rng.lognormal(0.0, 0.5, at.shape[:2])
    counts = rng.poisson(bright[..., np.newaxis] * came + 2e-5 * photons)
    return lf.Histograms(counts.astype(np.uint32), bin_width_ps=CODE_PS, laser_period_ps=period_ps)


def through_five_codes(counts: NDArray[np.integer], at: int) -> float:
    """Middle of a Gaussian through the codes about one, ps."""
    own = slice(max(at - 2, 0), at + 3)
    middle = 0.5 * (EDGES_PS[1:] + EDGES_PS[:-1])

    def bell(t: Floats, high: float, place: float, std: float) -> Floats:
        return np.asarray(high * np.exp(-0.5 * ((t - place) / std) ** 2))

    try:
        start = (float(counts[at]), float(middle[at]), STD_PS)
        place = float(curve_fit(bell, middle[own], counts[own], start)[0][1])
    except RuntimeError:
        return float("nan")
    return place if abs(place - middle[at]) < 3.0 * CODE_PS else float("nan")


def strongest(arrivals: lf.Arrivals) -> tuple[Floats, Floats]:
    """Time and error (rows, cols) of the strongest pulse of each pixel, ps."""
    return arrivals.image("arrival_ps"), arrivals.image("photon_std_ps")


def times_by(way: str, hist: lf.Histograms, shape: Response) -> tuple[Floats, Floats]:
    """Times (rows, cols), ps, and what is stated of them."""
    counts = np.asarray(hist.counts)
    fullest = np.argmax(counts, axis=2)
    if way == "fullest":
        return CODE_PS * (fullest + 0.5), np.ones(fullest.shape)
    if way == "five codes":
        found = [
            through_five_codes(own, int(at))
            for own, at in zip(counts.reshape(-1, CODES), fullest.ravel(), strict=True)
        ]
        return np.reshape(found, fullest.shape), np.ones(fullest.shape)
    if way == "Gaussians":
        return strongest(lf.find_arrivals(hist, response="clock"))
    return strongest(lf.find_arrivals(hist, response=shape if way == "known shape" else None))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=1, help="recordings of each board")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--no-period", action="store_true", help="do not tell the laser's period")
    options = parser.parse_args()
    period_ps = None if options.no_period else CODES * CODE_PS
    warnings.simplefilter("ignore", OptimizeWarning)
    print(f"{'late by, photons':26s} " + " ".join(f"{way:>11s}" for way in WAYS) + "   pull  cpu s")
    for share, tail_ps, photons, own in BOARDS:
        squares: dict[str, list[float]] = {way: [] for way in WAYS}
        pulls, spent = [], 0.0
        shape = Response.with_tail(std_ps=STD_PS, tail_ps=tail_ps, tail_share=share).anchored()
        for seed in range(options.first, options.first + options.runs):
            hist = recording(share, tail_ps, photons, own, seed, period_ps)
            for way in WAYS:
                began = time.process_time()
                found, stated = times_by(way, hist, shape)
                off = found - delays_ps()
                off -= np.nanmedian(off)
                squares[way].append(float(np.nanmean(off**2)))
                if way == "as it comes":
                    spent += time.process_time() - began
                    pulls.append(float(np.nanmean((off / stated) ** 2)))
        name = f"{share:.0%} {tail_ps:.0f} ps, {photons:.0f}{', own' if own else ''}"
        errors = " ".join(f"{np.sqrt(np.mean(squares[way])):11.2f}" for way in WAYS)
        print(
            f"{name:26s} {errors} {np.sqrt(np.mean(pulls)):6.2f} {spent / options.runs:6.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()

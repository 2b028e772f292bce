"""Draw what can go wrong, and write what the verdict says to it: docs/what-can-go-wrong.md.

    .venv/bin/python tools/update_troubles.py            # every name, some minutes
    .venv/bin/python tools/update_troubles.py haze walk  # these

One world of the oracle (`tests/oracles/worlds`, three legs, 20,000 photons in the brightest pixel,
all told as exact) is disturbed in one way for each name of a finding; the picture and the lines
between the page's marks are of that recording.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import lightflight as lf  # noqa: E402  # the checkout's
from lightflight.camera.refraction import interface_moved  # noqa: E402
from lightflight.path.on_bends import drawn  # noqa: E402
from lightflight.view import style  # noqa: E402
from tests.oracles import refracted_border  # noqa: E402
from tests.oracles.bent import arc_scene, measured_places  # noqa: E402
from tests.oracles.refracted import (  # noqa: E402
    AIR,
    RefractedScene,
    block_world,
    paper_scene,
    tank_world,
)
from tests.oracles.refracted_border import histograms  # noqa: E402
from tests.oracles.worlds.border import record, what_the_user_tells  # noqa: E402
from tests.oracles.worlds.defects import DEFECTS  # noqa: E402
from tests.oracles.worlds.mistakes import with_pf32  # noqa: E402
from tests.oracles.worlds.random_worlds import random_world  # noqa: E402
from tests.oracles.worlds.world import World  # noqa: E402
from tools.update_pictures import keep  # noqa: E402

PAGE = ROOT / "docs" / "what-can-go-wrong.md"
PHOTONS = 20_000.0
MOST_FINDINGS = 3
GREY = "#b9bfc8"
BEFORE_PS, AFTER_PS = -700.0, 4200.0


class Trouble(NamedTuple):
    """What is done to the world for a name."""

    defect: str
    strength: float
    words: str
    base: Callable[[World], World] = lambda world: world


def _on_pf32(world: World) -> World:
    return with_pf32(world, 0)


TROUBLES = {
    "prior": Trouble("waypoint", 4.0, "the first mirror measured 4 mm too near, told to 0.5 mm"),
    "source": Trouble("source_off_z", 10.0, "the source is told 10 mm too near"),
    "pose": Trouble("camera_rolled", 1.0, "the camera is rolled by 1°, told upright"),
    "focal_length": Trouble("focal_length_longer", 0.02, "a focal length 2 % longer than told"),
    "distortion": Trouble("barrel", -1.0, "a lens that moves the corner by 1 px, told as none"),
    "window": Trouble("window", 3.0, "a tank whose window stands 3 mm farther away than told"),
    "block": Trouble("block", 20.0, "20 mm of glass in the middle of one beam, not told"),
    "drawn_curve": Trouble("drawn_curve", 2.0, "a fibre on a circle, drawn 2 mm too far up"),
    "index": Trouble("index_to_the_camera", 0.33, "water between path and camera, told as air"),
    "units": Trouble("metres", 2.0, "the source told in metres, all else in mm"),
    "orientation": Trouble("swapped_field", 1.3, "width and height of the field swapped, 1.3 : 1"),
    "clock_offset": Trouble("clock_late", 10.0, "a trigger 10 ps later than told"),
    "clock_scale": Trouble("codes_shorter", -0.005, "codes 0.5 % shorter than calibrated"),
    "clock_drift": Trouble("drift_over_four", 20.0, "a zero that drifts by 20 ps in four repeats"),
    "walk": Trouble("walk", 10.0, "bright pulses told 10 ps earlier than dim ones"),
    "pile_up": Trouble("pile_up_misstated", 0.2, "a fifth of all frames hold a photon, not told"),
    "calibration": Trouble("stale_gains", 0.05, "gains and delays 5 % another camera's", _on_pf32),
    "haze": Trouble("haze_500ps", 0.2, "a fifth of the light 500 ps late on average"),
    "halo": Trouble("prompt_halo_8px", 0.2, "a fifth of the light spread over 8 px"),
    "glare": Trouble("veiling_glare", 0.2, "a fifth of the light all over the picture"),
    "other_pulse": Trouble(
        "second_pulse_3ns", 0.1, "a second pulse, a tenth as strong, 3 ns later"
    ),
    "unexplained_light": Trouble(
        "glint", 0.1, "a screw beside the path, lit from the first mirror"
    ),
    "shape": Trouble("response_tail", 0.1, "a tenth of the response in a tail, not calibrated"),
    "unseen_leg": Trouble("unseen_detour", 60.0, "two mirrors at the first corner, told as one"),
    "curved_leg": Trouble("bend_in_depth", 5.0, "the middle leg sags by 5 mm away from the camera"),
    "leg_count": Trouble("leg_count", -2.0, "one leg told, where there are three"),
    "trend": Trouble("uneven_codes", 0.06, "codes uneven by 6 %, told as even"),
    "scatter": Trouble("crosstalk", 0.2, "crosstalk of a fifth between neighbouring pixels"),
}
"""By name of the finding. `not_examined` is no test: see the page."""


class Case(NamedTuple):
    """A recording and its path."""

    hist: lf.Histograms
    path: lf.LightPath
    told: dict[str, Any]


def case_of(world: World) -> Case:
    """The world recorded, and reconstructed from what is told of it."""
    told = what_the_user_tells(world)
    made = record(world, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = lf.reconstruct(made, **told)
    return Case(made[0] if isinstance(made, list) else made, path, told)


def case_of_tank(farther_mm: float) -> Case:
    """Three legs in a tank, reconstructed with its window told so much too near."""
    return case_of_scene(tank_world(3), lambda camera: interface_moved(camera, 0, -farther_mm))


def case_of_beam(*, with_block: bool) -> Case:
    """One beam, with or without a block of glass in its middle, told as a beam in air."""
    block = block_world()
    return case_of_scene(block if with_block else replace(block, path_group_index=AIR))


def case_of_fibre(up_mm: float) -> Case:
    """A fibre on a circle, whose drawn places stand so much too far up."""
    scene = arc_scene(sagitta_mm=20.0, way="depth", index=1.47, photons=PHOTONS)
    places = measured_places(scene, 0, 1, std_mm=0.3) + np.array([0.0, up_mm, 0.0])
    curve = lf.DrawnCurve(places, point_std_mm=0.3)
    return case_of_scene(scene, source=lf.Source(), curves=[curve])


def case_of_waypoint(nearer_mm: float) -> Case:
    """Three legs, the place of whose first mirror is told so much too near the camera."""
    scene = paper_scene()
    told_mm = scene.vertices_mm[1] + np.array([0.0, 0.0, nearer_mm])
    return case_of_scene(scene, waypoints=[(1, told_mm, 0.5)])


def case_of_scene(
    scene: RefractedScene,
    mistaken: Callable[[lf.Camera], lf.Camera] = lambda camera: camera,
    **more: Any,
) -> Case:
    """A scene of the refracting oracle, reconstructed with what is mistaken of its camera."""
    scene = replace(scene, photons=PHOTONS)
    hist = histograms(scene, 1)
    told = refracted_border.what_the_user_tells(scene, hist)
    told |= {"camera": mistaken(told["camera"]), **more}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = lf.reconstruct(hist, **told)
    return Case(hist, path, told)


def cases_of(trouble: Trouble, start: World, plain: dict[str, Case]) -> tuple[Case, Case]:
    """A recording with nothing wrong, made once for all troubles of its camera, and the other."""
    if trouble.defect == "window":
        return case_of_tank(0.0), case_of_tank(trouble.strength)
    if trouble.defect == "block":
        return case_of_beam(with_block=False), case_of_beam(with_block=True)
    if trouble.defect == "waypoint":
        return case_of_waypoint(0.0), case_of_waypoint(trouble.strength)
    if trouble.defect == "drawn_curve":
        return case_of_fibre(0.0), case_of_fibre(trouble.strength)
    base = trouble.base(start)
    key = base.clock.__class__.__name__ + str(base.clock.edges_ps is None)
    plain.setdefault(key, case_of(base))
    return plain[key], case_of(DEFECTS[trouble.defect].applied(start, trouble.strength))


def draw_light(case: Case, ax: Axes) -> None:
    """Light of every pixel, and the path where the camera would see it."""
    photons = np.asarray(case.hist.photons, dtype=float)
    dark = max(1.0, 0.8 * float(np.median(photons)))
    ax.imshow(np.maximum(photons, dark), cmap="Greys", norm=LogNorm(dark, None))
    ends = drawn(case.path)[0]
    line = np.concatenate([np.linspace(a, b, 60) for a, b in pairwise(ends)])
    line = line[case.told["camera"].sees(line)]
    row, col = case.told["camera"].pixels_from_points(line)
    ax.plot(col, row, ".", color=style.EVENT, ms=1.2)
    ax.set(title="light and path", xticks=(), yticks=())


def draw_residuals(plain: Case, case: Case, ax: Axes) -> None:
    """Arrival minus model of every pulse, and those of the recording with nothing wrong."""
    for one, color, size in ((plain, GREY, 2.6), (case, style.EVENT, 1.8)):
        table = one.path.residuals
        since = table["event_time_ps"] - one.path.vertex_times_ps[0]
        ax.plot(since, table["residual_ps"], ".", color=color, ms=size)
    table = case.path.residuals
    reach = 1.3 * np.quantile(np.abs(table["residual_ps"]), 0.97)
    ax.set(title="residuals (ps)", xlabel="event time (ps)", ylim=(-reach, reach))


def profile_of(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Time since the path's pulse, ps, and the counts of its pixels at that time."""
    table, hist = case.path.residuals, case.hist
    places = (table["row"], table["col"])
    edges = np.arange(BEFORE_PS, AFTER_PS, hist.bin_width_ps)
    codes = np.arange(hist.n_codes)
    times = hist.bin_width_ps * (codes + 0.5)
    if hist.reversed_codes:
        times = hist.laser_period_ps - times
    timing = case.told["timing"]
    arrival = table["model_ps"] + np.nan_to_num(timing.skew_ps[places])
    late = times - arrival[:, np.newaxis] - BEFORE_PS
    late = np.mod(late, hist.laser_period_ps) + BEFORE_PS
    counts, _ = np.histogram(late, edges, weights=hist.counts[places])
    return (edges[1:] + edges[:-1]) / 2, counts


def draw_profile(plain: Case, case: Case, ax: Axes) -> None:
    """All pulses laid upon each other, by the path's times."""
    for one, color in ((plain, GREY), (case, style.EVENT)):
        late, counts = profile_of(one)
        ax.semilogy(late / 1000.0, counts + 0.8, drawstyle="steps-mid", color=color, lw=1.0)
    ax.set(title="all pulses, by the path's time", xlabel="late by (ns)")


@style.styled
def figure_of(plain: Case, case: Case) -> Figure:
    """Picture, residuals and pulses of a recording beside those of one with nothing wrong."""
    figure = style.new_figure(178, 46)
    axes = figure.subplots(1, 3, width_ratios=(0.8, 1.2, 1.2))
    figure.subplots_adjust(0.02, 0.22, 0.99, 0.86, 0.22)
    draw_light(case, axes[0])
    draw_residuals(plain, case, axes[1])
    draw_profile(plain, case, axes[2])
    return figure


def words_of(trouble: Trouble, case: Case) -> str:
    """What was done, and what the verdict said."""
    verdict = case.path.verdict
    lines = [f"{k}. {one}" for k, one in enumerate(verdict.findings[:MOST_FINDINGS], start=1)]
    more = len(verdict.findings) - MOST_FINDINGS
    lines += [f"... and {more} more"] if more > 0 else []
    return "\n".join([f"Here: {trouble.words}.", "", "```text", str(verdict.level), *lines, "```"])


def put(name: str, text: str) -> None:
    """Put lines between a name's marks on the page."""
    page = PAGE.read_text(encoding="utf-8")
    marks = re.compile(f"(<!-- {name}:begin -->\n).*?(<!-- {name}:end -->)", re.DOTALL)
    page, n = marks.subn(lambda m: f"{m[1]}{text}\n{m[2]}", page)
    if n != 1:
        raise SystemExit(f"{PAGE.name} has no marks for {name}: write its section first")
    PAGE.write_text(page, encoding="utf-8")


def main() -> None:
    """Draw and write all names, or some."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", choices=[*TROUBLES, []], metavar="NAME")
    args = parser.parse_args()
    start = random_world(0, 3, PHOTONS, "known", uneven=0.0)
    plain: dict[str, Case] = {}
    for name in args.names or TROUBLES:
        trouble = TROUBLES[name]
        right, case = cases_of(trouble, start, plain)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "wrong.png"
            figure_of(right, case).savefig(file, dpi=200)
            keep(file, f"wrong-{name}.png")
        if PAGE.exists():
            put(name, words_of(trouble, case))
        print(f"{name}: {case.path.verdict}", flush=True)


if __name__ == "__main__":
    main()

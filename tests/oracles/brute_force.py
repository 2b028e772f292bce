"""A second forward model, derived apart from the package and sharing no line with it.

It exists so that a sign or factor wrong in `lightflight` cannot cancel against itself. Nothing
is solved or integrated in closed form: the pulse is marched along the polyline in small steps,
the light scattered at each step is marched back to the camera, its image is spread over the
pixels by quadrature over their square active areas, and each pixel collects it in fine time
bins before the clock's codes are filled.

Words: `forward`, `right`, `down` are the camera's axes as unit vectors in the world; a pixel is
(row, col) with its centre at whole numbers. mm and ps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import erf, erfcx

C = 299_792_458.0 * 1e3 / 1e12
"""Speed of light, mm/ps: metres per second, times mm per metre, per ps per second."""


@dataclass(frozen=True)
class BruteCamera:
    """A pinhole: where it stands, how it is turned, how large a unit of slope is in pixels."""

    center: np.ndarray
    right: np.ndarray
    down: np.ndarray
    forward: np.ndarray
    px_per_slope_row: float
    px_per_slope_col: float
    row_of_axis: float
    col_of_axis: float
    rows: int
    cols: int
    radial: tuple[float, float] = (0.0, 0.0)

    def image(self, point: np.ndarray) -> tuple[float, float]:
        """(row, col) of one point by similar triangles: slope against depth."""
        x, y, z = (float(v) for v in np.asarray(point, dtype=float) - self.center)
        depth = x * self.forward[0] + y * self.forward[1] + z * self.forward[2]
        if depth <= 0.0:
            return math.nan, math.nan
        to_right = (x * self.right[0] + y * self.right[1] + z * self.right[2]) / depth
        to_down = (x * self.down[0] + y * self.down[1] + z * self.down[2]) / depth
        radius2 = to_right**2 + to_down**2
        stretch = 1.0 + self.radial[0] * radius2 + self.radial[1] * radius2**2
        return (
            self.row_of_axis + self.px_per_slope_row * to_down * stretch,
            self.col_of_axis + self.px_per_slope_col * to_right * stretch,
        )


def camera_over_plane(
    *,
    rows: int = 32,
    cols: int = 32,
    distance: float = 535.0,
    width: float = 245.0,
    height: float = 245.0,
    center: tuple[float, float] = (0.0, 0.0),
) -> BruteCamera:
    """The paper's camera: `distance` above z = 0, which it sees from edge to edge, y up."""
    return BruteCamera(
        center=np.array([center[0], center[1], distance]),
        right=np.array([1.0, 0.0, 0.0]),
        down=np.array([0.0, -1.0, 0.0]),
        forward=np.array([0.0, 0.0, -1.0]),
        # `width` fills `cols` pixels from outer edge to outer edge.
        px_per_slope_row=rows / (height / distance),
        px_per_slope_col=cols / (width / distance),
        row_of_axis=rows / 2 - 0.5,
        col_of_axis=cols / 2 - 0.5,
        rows=rows,
        cols=cols,
    )


def camera_looking_at(
    place: Sequence[float],
    target: Sequence[float],
    *,
    roll: float = 0.0,
    px_per_slope: float = 70.0,
    rows: int = 32,
    cols: int = 32,
    radial: tuple[float, float] = (0.0, 0.0),
) -> BruteCamera:
    """A camera anywhere, aimed at a point; at zero roll the world's y is up in the picture."""
    forward = np.asarray(target, dtype=float) - np.asarray(place, dtype=float)
    forward /= math.sqrt(float(forward @ forward))
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= math.sqrt(float(right @ right))
    down = np.cross(forward, right)
    turned_right = math.cos(roll) * right + math.sin(roll) * down
    turned_down = math.cos(roll) * down - math.sin(roll) * right
    return BruteCamera(
        center=np.asarray(place, dtype=float),
        right=turned_right,
        down=turned_down,
        forward=forward,
        px_per_slope_row=px_per_slope,
        px_per_slope_col=px_per_slope,
        row_of_axis=rows / 2 - 0.5,
        col_of_axis=cols / 2 - 0.5,
        rows=rows,
        cols=cols,
        radial=radial,
    )


@dataclass(frozen=True)
class BruteClock:
    """Codes of the time-to-digital converter: equal, forward or reversed, modulo a period."""

    n_codes: int
    width: float
    period: float
    reversed: bool = False
    first_edge: float = 0.0
    no_photon_code: int | None = None
    ends_with_period: bool = False
    """True: the next sync stops the clock, so that codes beyond the period stay empty."""

    def interval(self, code: int) -> tuple[float, float]:
        """Delays that give one code, before folding into the period."""
        near = self.first_edge + code * self.width
        far = self.first_edge + (code + 1) * self.width
        if self.ends_with_period:
            near, far = min(near, self.period), min(far, self.period)
        return (self.period - far, self.period - near) if self.reversed else (near, far)


def march_back(point: np.ndarray, center: np.ndarray, index: float, steps: int = 64) -> float:
    """Time light needs from a point to the camera, step by step."""
    stride = (np.asarray(center, dtype=float) - np.asarray(point, dtype=float)) / steps
    step_time = index * math.hypot(*stride) / C
    return math.fsum([step_time] * steps)


def march_out(
    vertices: np.ndarray, lengths: Sequence[float], index: float, stride: float = 1.0
) -> list[tuple[np.ndarray, float]]:
    """(place, time since emission) of the pulse after each path length, by walking there."""
    found: list[tuple[np.ndarray, float]] = []
    for wanted in lengths:
        left, times, at, leg = float(wanted), [], np.array(vertices[0], dtype=float), 0
        while left > 0.0:
            to_corner = np.asarray(vertices[leg + 1], dtype=float) - at
            room = math.hypot(*to_corner)
            if room == 0.0:
                if leg + 2 == len(vertices):
                    break
                leg += 1
                continue
            stretch = min(stride, left, room)
            at = at + to_corner * (stretch / room) if stretch < room else at + to_corner
            times.append(index * stretch / C)
            left -= stretch
        found.append((at, math.fsum(times)))
    return found


def gaussian_share(delay: np.ndarray, std: float) -> np.ndarray:
    """Part of a Gaussian pulse that has arrived by `delay` after its centre."""
    return np.asarray(0.5 * (1.0 + erf(delay / (std * math.sqrt(2.0)))))


def tailed_share(delay: np.ndarray, std: float, tail: float) -> np.ndarray:
    """The same for a Gaussian whose photons wait a further exponential time of mean `tail`."""
    z = (std / tail - delay / std) / math.sqrt(2.0)
    exponent = 0.5 * (std / tail) ** 2 - delay / tail
    # exp(exponent) erfc(z), written so that no factor overflows on either side of z = 0.
    early = np.exp(-0.5 * (delay / std) ** 2) * erfcx(np.maximum(z, 0.0))
    late = np.exp(np.where(z < 0.0, exponent, 0.0)) * (1.0 - erf(np.minimum(z, 0.0)))
    return np.asarray(gaussian_share(delay, std) - 0.5 * np.where(z < 0.0, late, early))


@dataclass(frozen=True)
class BruteScene:
    """Everything that decides how many photons each code of each pixel expects."""

    vertices: np.ndarray
    camera: BruteCamera
    clock: BruteClock
    emission_time: float = 2000.0
    path_index: float = 1.00027
    return_index: float = 1.00027
    pulse_std: float = 80.0
    """Laser and detector together, ps."""
    tail: float = 0.0
    """Mean of the exponential tail of the response, ps; 0: none. The pulse's centre is the
    Gaussian's, not the mean."""
    blur_std_px: float = 0.3
    active_side_px: float = 0.122
    background_per_ps: float = 0.0
    brightness: Callable[[float], float] | None = None
    """Light per mm as a function of the path length from the source."""
    inverse_square: bool = True


def _stations(scene: BruteScene, stride: float) -> list[tuple[np.ndarray, float, float, float]]:
    """(middle of the step, its time since emission, its light, length walked so far)."""
    out = []
    walked = 0.0
    for a, b in zip(scene.vertices[:-1], scene.vertices[1:], strict=True):
        leg = np.asarray(b, dtype=float) - np.asarray(a, dtype=float)
        length = math.hypot(*leg)
        n = max(math.ceil(length / stride), 1)
        for k in range(n):
            share = (k + 0.5) / n
            middle = np.asarray(a, dtype=float) + share * leg
            so_far = walked + share * length
            light = length / n * (1.0 if scene.brightness is None else scene.brightness(so_far))
            if scene.inverse_square:
                light /= float((scene.camera.center - middle) @ (scene.camera.center - middle))
            out.append((middle, scene.path_index * so_far / C, light, so_far))
        walked += length
    return out


def collect(
    scene: BruteScene, *, stride: float = 0.25, fine: float = 0.5, nodes: int = 5
) -> tuple[np.ndarray, float]:
    """Light per pixel and fine time bin: ((rows, cols, bins), time of the first bin's centre).

    A step's light is shared between the two nearest bins so that its mean time is kept.
    """
    stations = _stations(scene, stride)
    arrivals = [
        scene.emission_time + t + march_back(x, scene.camera.center, scene.return_index, 8)
        for x, t, _, _ in stations
    ]
    first = math.floor(min(arrivals) / fine) * fine
    n_bins = int((max(arrivals) - first) / fine) + 3
    rows, cols = scene.camera.rows, scene.camera.cols
    cube = np.zeros((rows, cols, n_bins))
    reach = 7.0 * scene.blur_std_px + scene.active_side_px + 1.0
    # Midpoints of the squares into which an active area is cut.
    cuts = ((np.arange(nodes) + 0.5) / nodes - 0.5) * scene.active_side_px
    cell = (scene.active_side_px / nodes) ** 2 / (2.0 * math.pi * scene.blur_std_px**2)
    for (point, _, light, _), arrival in zip(stations, arrivals, strict=True):
        row, col = scene.camera.image(point)
        if not (-reach < row < rows - 1 + reach and -reach < col < cols - 1 + reach):
            continue
        r = np.arange(max(0, math.ceil(row - reach)), min(rows, math.floor(row + reach) + 1))
        c = np.arange(max(0, math.ceil(col - reach)), min(cols, math.floor(col + reach) + 1))
        if not (r.size and c.size):
            continue
        down = (r[:, None] + cuts[None, :] - row)[:, None, :, None]
        across = (c[:, None] + cuts[None, :] - col)[None, :, None, :]
        spot = np.exp(-(down**2 + across**2) / (2.0 * scene.blur_std_px**2))
        caught = light * cell * spot.sum(axis=(2, 3))
        place = (arrival - first) / fine
        low = int(place)
        part = place - low
        window = (slice(r[0], r[-1] + 1), slice(c[0], c[-1] + 1))
        cube[(*window, low)] += caught * (1.0 - part)
        cube[(*window, low + 1)] += caught * part
    return cube, first


def expected_counts(
    scene: BruteScene,
    *,
    brightest: float,
    stride: float = 0.25,
    fine: float = 0.5,
    nodes: int = 5,
    pixel_delays: np.ndarray | None = None,
) -> np.ndarray:
    """(rows, cols, codes) expected counts; the brightest pixel expects `brightest` of signal.

    `pixel_delays` (rows, cols), ps, is what each pixel's electronics add.
    """
    cube, first = collect(scene, stride=stride, fine=fine, nodes=nodes)
    total = cube.sum(axis=2)
    if not total.max() > 0.0:
        raise ValueError("no light of this scene reaches a pixel")
    clock = scene.clock
    counts = np.zeros((*total.shape, clock.n_codes))
    intervals = np.array([clock.interval(code) for code in range(clock.n_codes)])
    spread = 9.0 * scene.pulse_std + 40.0 * scene.tail
    # Expecting 1e-7 photons in all is expecting none: such pixels are skipped.
    for row, col in np.argwhere(total * brightest / total.max() > 1e-7):
        used = np.flatnonzero(cube[row, col])
        light = cube[row, col, used] * brightest / total.max()
        when = first + fine * used
        if pixel_delays is not None:
            when = when + pixel_delays[row, col]
        earliest, latest = when.min() - 9.0 * scene.pulse_std, when.max() + spread
        periods = range(
            math.floor((earliest - intervals.max()) / clock.period),
            math.ceil((latest - intervals.min()) / clock.period) + 1,
        )
        for turn in periods:
            lower, upper = (intervals + turn * clock.period).T
            near = np.flatnonzero((upper > earliest) & (lower < latest))
            if near.size:
                # Codes meet: where one ends, which costs as much to work out, the next begins.
                edges, place = np.unique([lower[near], upper[near]], return_inverse=True)
                starts, ends = _share(scene, edges[:, None] - when)[place.reshape(2, -1)]
                counts[row, col, near] += (ends - starts) @ light
    counts += scene.background_per_ps * (intervals[:, 1] - intervals[:, 0])
    if clock.no_photon_code is not None:
        counts[..., clock.no_photon_code] = 0.0
    return counts


def _share(scene: BruteScene, delay: np.ndarray) -> np.ndarray:
    if scene.tail > 0.0:
        return tailed_share(delay, scene.pulse_std, scene.tail)
    return gaussian_share(delay, scene.pulse_std)


def mean_arrivals(cube: np.ndarray, first: float, fine: float) -> np.ndarray:
    """(rows, cols) light-weighted arrival time of what `collect` gave; NaN where dark."""
    total = cube.sum(axis=2)
    times = first + fine * np.arange(cube.shape[2])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 0.0, cube @ times / total, np.nan)

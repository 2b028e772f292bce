"""Light seen through plane interfaces, by shooting: a forward model apart from the package's.

Light goes where the *phase* indices bend it and takes as long as the *group* indices say. A point's
ray is found by firing rays from the camera, each bent at every plane by Snell's law for vectors,
until one no longer misses the point. Along a leg some 200 such rays are found; in between, place
in the picture and optical length are splines. The light is spread over pixels by error functions,
over codes by others, and nothing is binned in between.

mm, ps, pixel, counts; a pixel is (row, col) with its centre at whole numbers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import erf

from tests.oracles.brute_force import (
    BruteCamera,
    BruteClock,
    C,
    camera_over_plane,
    gaussian_share,
)

AIR = 1.00027
BK7 = (1.5195, 1.5396)
"""Phase and group index near 532 nm."""
WATER = (1.334, 1.3606)
STD_PER_FWHM = 1.0 / math.sqrt(8.0 * math.log(2.0))


# --- rays ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane face between two media; a stack is a tuple of them from the camera to the scene."""

    point_mm: np.ndarray
    """(3,), any point of it."""
    normal: np.ndarray
    """(3,), of any length, either way."""
    phase_beyond: float
    """Refractive index of the medium on the far side as seen from the camera."""
    group_beyond: float

    def away_from(self, camera_center_mm: np.ndarray) -> np.ndarray:
        """(3,) unit normal that points from the camera's side to the other."""
        unit = np.asarray(self.normal, dtype=float) / np.linalg.norm(self.normal)
        height = float((np.asarray(self.point_mm, dtype=float) - camera_center_mm) @ unit)
        if height == 0.0:
            raise ValueError("the camera stands in the plane: on which side is not said")
        return unit if height > 0.0 else -unit


def shot(
    camera_center_mm: np.ndarray,
    directions: np.ndarray,
    planes: Sequence[Plane],
    phase_front: float = AIR,
) -> tuple[np.ndarray, np.ndarray]:
    """Rays from a point through all planes: (k + 1, n, 3) start and hits, (n, 3) last direction.

    Directions (n, 3) need not be unit; complex ones carry a derivative in their imaginary part.
    NaN where a ray is totally reflected or comes to the planes in another order.
    """
    center = np.asarray(camera_center_mm, dtype=float)
    hits, phase = [np.broadcast_to(center, directions.shape)], phase_front
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = directions / np.sqrt((directions * directions).sum(axis=1))[:, None]
        for plane in planes:
            normal = plane.away_from(center)
            cosine = ahead @ normal
            way = (np.asarray(plane.point_mm, dtype=float) - hits[-1]) @ normal / cosine
            ratio = phase / plane.phase_beyond
            square = 1.0 - ratio**2 * (1.0 - cosine**2)
            goes_on = (cosine.real > 0.0) & (way.real >= 0.0) & (square.real > 0.0)
            bent = np.sqrt(np.where(goes_on, square, np.nan))
            hits.append(hits[-1] + way[:, None] * ahead)
            ahead = ratio * ahead + (bent - ratio * cosine)[:, None] * normal
            phase = plane.phase_beyond
    return np.stack(hits), ahead


@dataclass(frozen=True, eq=False)
class Sights:
    """How points are seen; NaN where no ray comes from them to the camera."""

    direction: np.ndarray
    """(n, 3), unit, at the camera, outwards."""
    group_mm: np.ndarray
    """(n,), sum of group index times length: the time times c."""
    spreading_mm2: np.ndarray
    """(n,), area square to the ray at the point per solid angle at the camera; the square of the
    distance where nothing bends."""
    phase_at_point: np.ndarray
    """(n,), phase index where the point is."""


def sights(
    points_mm: np.ndarray,
    camera_center_mm: np.ndarray,
    planes: Sequence[Plane],
    phase_front: float = AIR,
    group_front: float = AIR,
    group_scene: float | None = None,
) -> Sights:
    """Rays from points (n, 3) to the camera; each goes through those planes that it lies beyond.

    `group_scene` is the group index where the points are; None: as the last plane before says.
    """
    points = np.asarray(points_mm, dtype=float).reshape(-1, 3)
    center = np.asarray(camera_center_mm, dtype=float)
    n_crossed = _planes_before(points, center, planes)
    direction = np.full(points.shape, np.nan)
    group, spreading, phase = np.full((3, len(points)), np.nan)
    for n in np.unique(n_crossed):
        own, crossed = n_crossed == n, planes[:n]
        direction[own], spreading[own] = _aimed(points[own], center, crossed, phase_front)
        groups = [group_front, *(plane.group_beyond for plane in crossed)]
        if group_scene is not None:
            groups[-1] = group_scene
        corners = np.concatenate(
            [shot(center, direction[own], crossed, phase_front)[0], points[own][None]]
        )
        group[own] = groups @ np.linalg.norm(np.diff(corners, axis=0), axis=2)
        phase[own] = crossed[-1].phase_beyond if crossed else phase_front
    return Sights(direction, group, spreading, phase)


def seen_through(
    points_mm: np.ndarray,
    camera_center_mm: np.ndarray,
    planes: Sequence[Plane],
    phase_front: float = AIR,
    group_front: float = AIR,
    group_scene: float | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) unit directions at the camera, outwards, and (n,) optical group lengths in mm."""
    seen = sights(points_mm, camera_center_mm, planes, phase_front, group_front, group_scene)
    return seen.direction, seen.group_mm


def _planes_before(points: np.ndarray, center: np.ndarray, planes: Sequence[Plane]) -> np.ndarray:
    """(n,) how many planes lie between the camera and each point."""
    if not planes:
        return np.zeros(len(points), dtype=int)
    beyond = np.array([(points - plane.point_mm) @ plane.away_from(center) > 0 for plane in planes])
    count = beyond.sum(axis=0)
    if (beyond != (np.arange(len(planes))[:, None] < count)).any():
        raise ValueError("planes must be ordered from the camera on and not cross before a point")
    return np.asarray(count)


def _aimed(
    points: np.ndarray, center: np.ndarray, planes: Sequence[Plane], phase_front: float
) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n, 3) and spreading (n,) of rays that hit points beyond all these planes.

    Directions are the straight one plus two slopes across it. A ray's miss is the part of the gap
    to the point that is square to its last direction; its derivative by the slopes is exact
    by a complex step (1e-30 has no difference that could cancel). Steps that miss by more are
    halved.
    """
    gap = points - center
    distance = np.linalg.norm(gap, axis=1)
    straight = gap / distance[:, None]
    # The world's axis that is least along the ray gives two directions across it.
    helper = np.eye(3)[np.abs(straight).argmin(axis=1)]
    right = np.cross(straight, helper)
    right /= np.linalg.norm(right, axis=1)[:, None]
    across = np.stack([right, np.cross(straight, right)], axis=1)

    def fired(slopes: np.ndarray) -> np.ndarray:
        """(n, 3)."""
        return np.asarray(straight + (slopes[:, None, :] @ across)[:, 0])

    def miss(slopes: np.ndarray) -> np.ndarray:
        """(n, 3)."""
        hits, last = shot(center, fired(slopes), planes, phase_front)
        left = points - hits[-1]
        return np.asarray(left - (left * last).sum(axis=1)[:, None] * last)

    def miss_per_slope(slopes: np.ndarray) -> np.ndarray:
        """(n, 2, 3)."""
        return np.stack([miss(slopes + 1e-30j * one).imag / 1e-30 for one in np.eye(2)], axis=1)

    def off(slopes: np.ndarray) -> np.ndarray:
        """(n,), infinite where a ray does not come through."""
        size = np.linalg.norm(miss(slopes), axis=1)
        return np.where(np.isfinite(size), size, np.inf)

    slopes = _start(off, straight, across, planes, center)
    best = off(slopes)
    for _ in range(100):
        sides = miss_per_slope(slopes)
        wanted = sides @ miss(slopes)[:, :, None]
        step = np.linalg.solve(sides @ sides.transpose(0, 2, 1), wanted)[:, :, 0]
        share = np.ones(len(points))
        for _ in range(40):
            trial = slopes - share[:, None] * step
            left = off(trial)
            worse = ~(left < best) & (best > 1e-14 * distance)
            if not worse.any():
                break
            share[worse] /= 2.0
        gained = left < best
        if not gained.any():
            break
        slopes, best = np.where(gained[:, None], trial, slopes), np.where(gained, left, best)
    hit = best <= 1e-11 * distance
    found = np.where(hit[:, None], slopes, np.nan)
    ahead = fired(found)
    length = np.linalg.norm(ahead, axis=1)
    sides = miss_per_slope(found)
    # A solid angle is the product of two slopes over the cube of the length they make.
    spreading = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) * length**3
    return ahead / length[:, None], spreading


def _start(
    off: Callable[[np.ndarray], np.ndarray],
    straight: np.ndarray,
    across: np.ndarray,
    planes: Sequence[Plane],
    center: np.ndarray,
) -> np.ndarray:
    """(n, 2) slopes of rays that come through: the straight one, else one nearer the normal."""
    slopes = np.zeros((len(straight), 2))
    if not planes:
        return slopes
    normal = planes[0].away_from(center)
    upright = (across @ normal) / (straight @ normal)[:, None]
    for k in range(1, 30):
        blind = ~np.isfinite(off(slopes))
        if not blind.any():
            break
        slopes[blind] = (1.0 - 0.5**k) * upright[blind]
    return slopes


# --- scenes -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RefractedScene:
    """A pulse's way, what it is seen through, and the camera that sees it."""

    vertices_mm: np.ndarray
    """(m, 3)."""
    camera: BruteCamera
    planes: tuple[Plane, ...] = ()
    clock: BruteClock = field(default_factory=lambda: BruteClock(909, 55.0, 50_000.0))
    emission_time_ps: float = 2000.0
    path_group_index: float | tuple[float, ...] = AIR
    """Of the medium that the beam is in, one for all legs or one for each."""
    phase_front: float = AIR
    group_front: float = AIR
    group_scene: float | None = None
    """Group index where the points are; None: as the last plane before them says."""
    pulse_std_ps: float = 150.0 * STD_PER_FWHM
    """Laser and detector together."""
    spot_std_px: float = 0.35
    active_side_px: float = 0.122
    background_per_ps: float = 0.02 / 55.0
    brightness: tuple[float | Callable[[np.ndarray], np.ndarray], ...] = ()
    """Light per mm of each leg, a number or a function of the mm from the leg's start; (): even."""
    photons: float = 40_000.0
    """Signal that the brightest pixel expects."""

    @property
    def n_legs(self) -> int:
        """Straight pieces of the path."""
        return len(self.vertices_mm) - 1

    @property
    def leg_lengths_mm(self) -> np.ndarray:
        """(legs,)."""
        return np.asarray(np.linalg.norm(np.diff(self.vertices_mm, axis=0), axis=1))

    def points_on(self, leg: int, shares: np.ndarray) -> np.ndarray:
        """(n, 3) places of a leg at shares of it: straight from its start to its end."""
        start, end = np.asarray(self.vertices_mm[leg : leg + 2], dtype=float)
        return np.asarray(start + shares[:, None] * (end - start))

    def walked_mm(self, leg: int, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,) each: way from the leg's start to those places, and way per share there."""
        length = float(self.leg_lengths_mm[leg])
        return shares * length, np.full(len(shares), length)

    def shares_at(self, leg: int, passed: np.ndarray) -> np.ndarray:
        """(n,) shares of a leg where so much of its time has passed."""
        return passed

    @property
    def vertex_times_ps(self) -> np.ndarray:
        """(m,) event times."""
        indices = np.broadcast_to(self.path_group_index, self.n_legs)
        steps = self.leg_lengths_mm * indices / C
        return self.emission_time_ps + np.append(0.0, np.cumsum(steps))

    def light_per_mm(self, leg: int, walked_mm: np.ndarray) -> np.ndarray:
        """(n,) of a leg, `walked_mm` (n,) from its start."""
        own = self.brightness[leg] if self.brightness else 1.0
        value = own(walked_mm) if callable(own) else own
        return np.asarray(value * np.ones_like(walked_mm))


def positions_at(scene: RefractedScene, times_ps: np.ndarray) -> np.ndarray:
    """(n, 3) places of the pulse at event times; the outer legs go on for ever."""
    corners = scene.vertex_times_ps
    leg = np.clip(np.searchsorted(corners, times_ps, side="right") - 1, 0, scene.n_legs - 1)
    passed = (times_ps - corners[leg]) / (corners[leg + 1] - corners[leg])
    places = np.empty((len(passed), 3))
    for k in np.unique(leg):
        places[leg == k] = scene.points_on(k, scene.shares_at(k, passed[leg == k]))
    return places


def images(scene: RefractedScene, points_mm: np.ndarray) -> tuple[np.ndarray, Sights]:
    """(n, 2) row and column of points seen through the planes, and the rays themselves."""
    seen = sights(
        points_mm, scene.camera.center, scene.planes, scene.phase_front, scene.group_front,
        scene.group_scene,
    )  # fmt: skip
    places = [scene.camera.image(scene.camera.center + ahead) for ahead in seen.direction]
    return np.array(places).reshape(-1, 2), seen


def in_picture(scene: RefractedScene, points_mm: np.ndarray, margin_px: float = 0.0) -> np.ndarray:
    """(n,) whether points are seen within the picture's outer edges, or so far beyond them."""
    image, _ = images(scene, points_mm)
    size = np.array([scene.camera.rows, scene.camera.cols])
    return np.asarray((np.abs(image - (size - 1) / 2) < size / 2 + margin_px).all(axis=1))


@dataclass(frozen=True, eq=False)
class Curve:
    """A leg as the camera sees it: splines over the share of the leg walked."""

    low: float
    high: float
    """The stretch of the leg (0 to 1) that sends light to the picture."""
    seen: CubicSpline
    """Row and column (px), optical group length (mm), log of light per mm of an even leg."""


def curve_of_leg(scene: RefractedScene, leg: int, n_exact: int = 201) -> Curve | None:
    """A leg's curve through exactly solved points; None where no light meets the picture."""

    def points(shares: np.ndarray) -> np.ndarray:
        return scene.points_on(leg, shares)

    coarse = np.linspace(0.0, 1.0, 101)
    # Light farther out than this is no photon in any pixel (1e-13 of the light).
    near = in_picture(scene, points(coarse), 8.0 * scene.spot_std_px + 0.5)
    if not near.any():
        return None
    inside = np.flatnonzero(near)
    low, high = coarse[max(inside[0] - 1, 0)], coarse[min(inside[-1] + 1, coarse.size - 1)]
    shares = np.linspace(low, high, n_exact)
    # The ends of a leg may lie in a face; what is between them is on one side of it.
    if np.ptp(_planes_before(points(shares[1:-1]), scene.camera.center, scene.planes)):
        raise ValueError(f"leg {leg} goes through a plane: put a vertex there")
    image, seen = images(scene, points(shares))
    dilution = (seen.phase_at_point / scene.phase_front) ** 2 * seen.spreading_mm2
    return Curve(
        float(low),
        float(high),
        CubicSpline(shares, np.column_stack([image, seen.group_mm, -np.log(dilution)])),
    )


@dataclass(frozen=True, eq=False)
class Stations:
    """Where a leg's light is summed, each (n,): picture place, time on the clock, light, leg."""

    row: np.ndarray
    col: np.ndarray
    arrival_ps: np.ndarray
    light: np.ndarray
    """Not yet scaled to photons."""
    leg: np.ndarray


def stations_of_leg(scene: RefractedScene, leg: int, nodes: int = 8) -> Stations:
    """Gauss's nodes in panels of at most two spots' and two pulses' widths."""
    empty = np.zeros(0)
    curve = curve_of_leg(scene, leg)
    if curve is None:
        return Stations(empty, empty, empty, empty, empty.astype(int))
    index = float(np.broadcast_to(scene.path_group_index, scene.n_legs)[leg])
    trial = np.linspace(curve.low, curve.high, 201)
    steps = np.abs(np.diff(curve.seen(trial)[:, :3], axis=0))
    px = np.hypot(steps[:, 0], steps[:, 1])
    ps = (steps[:, 2] + np.diff(scene.walked_mm(leg, trial)[0]) * index) / C
    n_panels = max(math.ceil(px.sum() / (2.0 * scene.spot_std_px)),
                   math.ceil(ps.sum() / (2.0 * scene.pulse_std_ps)), 4)  # fmt: skip
    at, weight = np.polynomial.legendre.leggauss(nodes)
    panel = (curve.high - curve.low) / n_panels
    middles = curve.low + (np.arange(n_panels) + 0.5) * panel
    share = (middles[:, None] + 0.5 * panel * at).ravel()
    row, col, group, log_light = curve.seen(share).T
    walked, per_share = scene.walked_mm(leg, share)
    light = np.exp(log_light) * scene.light_per_mm(leg, walked)
    event = scene.vertex_times_ps[leg] + walked * index / C
    return Stations(
        row, col, event + group / C, light * np.tile(0.5 * panel * weight, n_panels) * per_share,
        np.full(share.size, leg),
    )  # fmt: skip


def stations(scene: RefractedScene) -> Stations:
    """All legs'."""
    legs = [stations_of_leg(scene, leg) for leg in range(scene.n_legs)]
    parts = ([getattr(leg, name) for leg in legs] for name in Stations.__dataclass_fields__)
    return Stations(*(np.concatenate(part) for part in parts))


# --- counts -------------------------------------------------------------------------------


def _overlap(at: np.ndarray, n: int, std: float, side: float) -> np.ndarray:
    """(stations, n) part of a spot at `at` that falls into active areas of that side."""
    gap = (np.arange(n)[None, :] - at[:, None]) / (math.sqrt(2.0) * std)
    half = side / 2.0 / (math.sqrt(2.0) * std)
    return np.asarray(0.5 * (erf(gap + half) - erf(gap - half)))


@dataclass(frozen=True, eq=False)
class Caught:
    """Light of stations that pixels catch, each (pairs,)."""

    pixel: np.ndarray
    station: np.ndarray
    arrival_ps: np.ndarray
    light: np.ndarray


def caught(scene: RefractedScene, beam: Stations) -> Caught:
    """Which pixel gets how much of each station's light."""
    rows, cols = scene.camera.rows, scene.camera.cols
    down = _overlap(beam.row, rows, scene.spot_std_px, scene.active_side_px)
    across = _overlap(beam.col, cols, scene.spot_std_px, scene.active_side_px)
    light = ((beam.light[:, None] * down)[:, :, None] * across[:, None, :]).reshape(-1, rows * cols)
    station, pixel = np.nonzero(light > 1e-13 * light.max(initial=0.0))
    return Caught(pixel, station, beam.arrival_ps[station], light[station, pixel])


def light_scale(scene: RefractedScene, pairs: Caught | None = None) -> float:
    """Photons per unit of light at which the brightest pixel expects what the scene says.

    `pairs` is what its pixels catch, where that is known already.
    """
    pairs = caught(scene, stations(scene)) if pairs is None else pairs
    if not pairs.light.size:
        raise ValueError("no light of this scene reaches a pixel")
    return scene.photons / float(np.bincount(pairs.pixel, pairs.light).max())


def code_edges_ps(clock: BruteClock) -> np.ndarray:
    """(codes + 1,) from where counting starts: delay, or what is left of the period after it."""
    edges = clock.first_edge + clock.width * np.arange(clock.n_codes + 1)
    return np.minimum(edges, clock.period) if clock.ends_with_period else edges


def signal_counts(scene: RefractedScene, pairs: Caught, scale: float) -> np.ndarray:
    """(pixels, codes) expected of the beam, from what pixels caught."""
    clock, edges = scene.clock, code_edges_ps(scene.clock)
    n_pixels, n_codes = scene.camera.rows * scene.camera.cols, clock.n_codes
    counts = np.zeros(n_pixels * n_codes)
    reach = 8.5 * scene.pulse_std_ps
    # A symmetric pulse looks the same to codes that run backwards.
    delay = clock.period - pairs.arrival_ps if clock.reversed else pairs.arrival_ps
    delay = np.mod(delay, clock.period)
    window = np.arange(math.ceil(2.0 * reach / clock.width) + 2)
    first_turn = math.floor((edges[0] - reach) / clock.period) - 1
    for turn in range(first_turn, math.ceil((edges[-1] + reach) / clock.period) + 1):
        when = delay + turn * clock.period
        met = np.flatnonzero((when + reach > edges[0]) & (when - reach < edges[-1]))
        if not met.size:
            continue
        first = np.floor((when[met] - reach - clock.first_edge) / clock.width).astype(np.int64)
        code = first[:, None] + window
        late = edges[np.clip(code, 0, n_codes)] - when[met, None]
        share = np.diff(gaussian_share(late, scene.pulse_std_ps), axis=1)
        code, light = code[:, :-1], scale * pairs.light[met, None] * share
        # Beyond the clock both edges of a code are clipped to the same: its share is none.
        place = pairs.pixel[met, None] * n_codes + np.clip(code, 0, n_codes - 1)
        counts += np.bincount(place.ravel(), light.ravel(), minlength=counts.size)
    return counts.reshape(n_pixels, n_codes)


def expected_counts(scene: RefractedScene, scale: float | None = None) -> np.ndarray:
    """(rows, cols, codes) free of noise; `scale` as `light_scale` gives it, its default."""
    pairs = caught(scene, stations(scene))
    scale = light_scale(scene, pairs) if scale is None else scale
    counts = signal_counts(scene, pairs, scale)
    counts += scene.background_per_ps * np.diff(code_edges_ps(scene.clock))
    if scene.clock.no_photon_code is not None:
        counts[:, scene.clock.no_photon_code] = 0.0
    return counts.reshape(scene.camera.rows, scene.camera.cols, -1)


def recording(scene: RefractedScene, seed: int) -> np.ndarray:
    """(rows, cols, codes) Poisson counts, uint32."""
    rng = np.random.default_rng([seed, 17])
    return rng.poisson(expected_counts(scene)).astype(np.uint32)


# --- worlds -------------------------------------------------------------------------------


def paper_scene() -> RefractedScene:
    """The paper's three legs in air, seen from 535 mm: 245 mm of the plane z = 0 fill 32 px."""
    return RefractedScene(
        np.array([[0, 0, 0], [375, 25, 50], [0, 50, 10], [375, 75, 50]], dtype=float),
        camera_over_plane(distance=535.0, width=245.0, height=245.0, center=(187.5, 37.5)),
    )


def window(
    middle_mm: Sequence[float],
    thickness_mm: float,
    behind: tuple[float, float],
    *,
    tilt_deg: float = 0.0,
) -> tuple[Plane, Plane]:
    """Front and back of a pane of BK7 that a camera above looks down through.

    `middle_mm` is a point of the front, `behind` the phase and group index beyond the back; the
    pane is turned by `tilt_deg` about y, in its front's point.
    """
    tilt = math.radians(tilt_deg)
    normal = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    front = np.asarray(middle_mm, dtype=float)
    return Plane(front, normal, *BK7), Plane(front - thickness_mm * normal, normal, *behind)


def window_world(tilt_deg: float = 0.0) -> RefractedScene:
    """The paper's scene through 10 mm of BK7 between z = 310 and 300 mm, air on both sides."""
    pane = window((187.5, 37.5, 310.0), 10.0, (AIR, AIR), tilt_deg=tilt_deg)
    return replace(paper_scene(), planes=pane)


TANK_VERTICES_MM = np.array(
    [[-140, -45, -260], [140, -5, -150], [-140, 15, -270], [140, 55, -180]], dtype=float
)


def tank_world(n_legs: int = 1, tilt_deg: float = 0.0) -> RefractedScene:
    """One to three legs in water, 140 to 260 mm behind a window of 10 mm of BK7 that a camera
    200 mm before it looks through.

    The front of the window is z = 0 and 100 mm of it fill 32 px; behind lie about 180 mm of water.
    All legs cross the picture from side to side and all corners are beyond its edges.
    """
    return RefractedScene(
        TANK_VERTICES_MM[: n_legs + 1].copy(),
        camera_over_plane(distance=200.0, width=100.0, height=100.0),
        window((0.0, 0.0, 0.0), 10.0, WATER, tilt_deg=tilt_deg),
        path_group_index=WATER[1],
    )


BLOCK_END_MM = np.array([375.0, 40.0, 30.0])
"""Where the beam of `block_world` would end without its block; it begins at the origin."""


def block_faces(tilt_deg: float = 0.0) -> tuple[Plane, Plane]:
    """Faces of 20 mm of BK7 in air, about the middle between the ends of `block_world`.

    Square to the beam, or turned by `tilt_deg` about an axis across it that is neither in the
    picture nor in depth.
    """
    ahead = BLOCK_END_MM / np.linalg.norm(BLOCK_END_MM)
    aside = np.array([0.0, 0.6, 0.8])
    aside -= (aside @ ahead) * ahead
    tilt = math.radians(tilt_deg)
    normal = math.cos(tilt) * ahead + math.sin(tilt) * aside / np.linalg.norm(aside)
    middle = BLOCK_END_MM / 2
    return Plane(middle - 10.0 * normal, normal, *BK7), Plane(
        middle + 10.0 * normal, normal, AIR, AIR
    )


def block_vertices_mm(
    tilt_deg: float = 0.0, turned: tuple[float, float] = (0.0, 0.0)
) -> np.ndarray:
    """(4, 3) source, both faces, exit of light that is shot through the block, bent at each face.

    `turned` are slopes of its direction at the source off that of `block_world`, in y and in z.
    """
    start = np.zeros(3)
    ahead = BLOCK_END_MM + BLOCK_END_MM[0] * np.array([0.0, *turned])
    hits, last = shot(start, ahead[None], block_faces(tilt_deg))
    # As far on as the straight way would have gone.
    left = (BLOCK_END_MM[0] - hits[-1, 0, 0]) / last[0, 0]
    return np.concatenate([hits[:, 0], hits[-1] + left * last])


def block_world(light_in_glass: float = 1.0, tilt_deg: float = 0.0) -> RefractedScene:
    """One beam in air through the middle of 20 mm of BK7 in view, square to both faces or not.

    The light per mm in the glass is `light_in_glass` times that in air. How the block bends the
    view of the light in it is left out (0: none is seen).
    """
    return replace(
        paper_scene(),
        vertices_mm=block_vertices_mm(tilt_deg),
        path_group_index=(AIR, BK7[1], AIR),
        brightness=(1.0, light_in_glass, 1.0),
    )

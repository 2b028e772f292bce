"""The forward model of all counts: its derivatives, and the integral that it collapses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.special import ndtr

from lightflight.camera.model import Camera
from lightflight.flight import Medium
from lightflight.reconstruct.model.forward import (
    CodeCounts,
    LightModes,
    Local,
    Pixels,
    local_variables,
)
from lightflight.reconstruct.model.geometry import PathState
from lightflight.reconstruct.model.image_plane import undistorted_px
from lightflight.reconstruct.model.leg_in_picture import leg_in_picture
from lightflight.reconstruct.model.likelihood import likelihood
from lightflight.reconstruct.model.strength import SpotAlong
from lightflight.reconstruct.model.unknowns import Layout, Light, layout_of, moved_light

CAMERA = Camera.facing_plane((12, 16), distance_mm=535.0, field_of_view_mm=(122.5, 91.9))
AIR = Medium()
PERIOD, WIDTH, CODES = 50_000.0, 55.0, 64
CORNER = PathState(np.array([[-90.0, -21, -10], [31, -12, 15], [-90, 33, 5]]), 2000.0)
ASIDE = PathState(np.array([[-90.0, -21, -10], [90, -12, 15], [-90, 33, 5]]), 2000.0)
STEEP = PathState(np.array([[-75.0, 6, -130.0], [75, 6, 130]]), 2000.0)


def straight(coefficients_of, leg, spacing: float = 3.0):
    """Spline knots over a leg's span, and coefficients of a given log-strength."""
    low, high = leg.span_px
    inner = np.linspace(low, high, max(2, int(np.ceil((high - low) / spacing)) + 1))
    knots = np.concatenate((np.full(3, low), inner, np.full(3, high)))
    grid = np.linspace(low, high, 20 * len(inner))
    design = BSpline.design_matrix(grid, knots, 3).toarray()
    return knots, np.linalg.lstsq(design, coefficients_of(grid), rcond=None)[0]


def scene_of(
    state: PathState,
    *,
    photons: float = 300.0,
    slope: float = 0.0,
    spot: float = 0.4,
    std: float = 75.0,
    pixel_std: float = 0.0,
    scatter: float = 0.0,
    n_modes: int = 0,
    n_uneven: int = 0,
    camera: Camera = CAMERA,
) -> tuple[Light, Pixels]:
    lines = tuple(leg_in_picture(state, k, camera) for k in range(state.n_legs))
    splines = [straight(lambda s: np.log(photons) + slope * s, line) for line in lines]
    light = Light(
        lines,
        tuple(knots for knots, _ in splines),
        tuple(coefficients for _, coefficients in splines),
        float(np.log(spot)),
        float(np.log(std)),
        (scatter,) * state.n_legs,
    )
    rows, cols = (index.ravel() for index in np.indices(camera.shape))
    points = undistorted_px(camera, rows, cols)
    near = np.zeros((len(rows), len(lines)), dtype=bool)
    for k, line in enumerate(lines):
        along, across = line.along_across(points)
        low, high = line.span_px
        near[:, k] = (along > low - 1.5) & (along < high + 1.5) & (np.abs(across) < 2.5)
    keep = near.any(axis=1)
    n = int(keep.sum())
    rng = np.random.default_rng(0)
    modes = rng.normal(0.0, 3.0, (n, len(lines), n_modes))
    sizes = 0.2, 3.0, 200.0
    uneven = LightModes(*(rng.normal(0.0, std, (n, len(lines), n_uneven)) for std in sizes))
    return light, Pixels(
        rows=rows[keep],
        cols=cols[keep],
        near=near[keep],
        points_px=points[keep],
        skew_ps=np.zeros(n),
        pixel_var=np.full(n, pixel_std**2),
        modes_ps=modes,
        uneven=uneven if n_uneven else None,
    )


def codes_from(counts: np.ndarray, first: float) -> CodeCounts:
    edges = first + WIDTH * np.arange(CODES + 1)
    n = len(counts)
    return CodeCounts(
        counts=counts.astype(float),
        lower_ps=np.broadcast_to(edges[:-1], (n, CODES)).copy(),
        upper_ps=np.broadcast_to(edges[1:], (n, CODES)).copy(),
        period_ps=PERIOD,
        use_outside=np.ones(n, dtype=bool),
    )


def expected_counts(local: Local, log_background, shift, first: float, uneven=0.0) -> np.ndarray:
    """(n, codes), written out: pulses of all legs and an even background."""
    log_photons = local.log_photons + uneven
    edges = first + WIDTH * np.arange(CODES + 1)
    mean = np.exp(log_background)[:, np.newaxis] * np.full(CODES, WIDTH)
    for k in range(local.log_photons.shape[1]):
        here = np.isfinite(local.arrival_ps[:, k])
        center = (local.arrival_ps[:, k] + shift)[here, np.newaxis]
        share = np.diff(ndtr((edges - center) / local.std_ps[here, k][:, np.newaxis]), axis=1)
        mean[here] += np.exp(log_photons[here, k])[:, np.newaxis] * share
    return np.asarray(mean)


class Model:
    """The likelihood as a function of one vector of all shared parameters."""

    def __init__(self, state, light, pixels, *, seed, background=0.002):
        self.rng = np.random.default_rng(seed)
        self.state, self.light, self.pixels = state, light, pixels
        self.layout: Layout = layout_of(3 * len(state.vertices_mm) + 1, pixels.n_modes, light)
        self.basis = np.eye(3 * len(state.vertices_mm) + 1)
        self.log_background = np.full(len(pixels.rows), np.log(background))
        self.shift = np.sqrt(pixels.pixel_var) * self.rng.normal(size=len(pixels.rows))
        self.uneven = light.log_scatter * self.rng.normal(size=pixels.near.shape)
        self.first = 3200.0
        local = self.local(np.zeros(self.layout.size))
        self.mean = expected_counts(local, self.log_background, self.shift, self.first, self.uneven)
        self.codes = codes_from(self.rng.poisson(self.mean), self.first)

    def local(self, step) -> Local:
        n = self.layout.n_free
        return local_variables(
            self.state.moved(step[:n]),
            moved_light(self.light, step, self.layout),
            self.pixels,
            self.layout,
            basis=self.basis,
            modes=step[n : n + self.layout.n_modes],
            camera=CAMERA,
            medium=AIR,
        )

    def at(self, step=None, *, background=None, shift=None, uneven=None, codes=None):
        return likelihood(
            self.local(np.zeros(self.layout.size) if step is None else step),
            self.pixels,
            self.codes if codes is None else codes,
            log_background=self.log_background if background is None else background,
            delay_shift_ps=self.shift if shift is None else shift,
            log_photons_shift=self.uneven if uneven is None else uneven,
            log_scatter=self.light.log_scatter,
        )


class TestShared:
    """Derivatives by the path, the light and the clock, through the pixels' own nuisances."""

    @pytest.mark.parametrize(
        ("state", "slope", "growing", "active", "beam", "own", "n_uneven"),
        [
            (CORNER, 0.03, 0.0, 0.0, None, (), 0),
            pytest.param(CORNER, 0.2, 0.0, 0.0, None, (), 0, marks=pytest.mark.long),
            (STEEP, 0.03, 0.0, 0.0, None, (), 0),
            (ASIDE, 0.2, 0.0, 0.0, None, (), 0),
            pytest.param(CORNER, 0.1, 0.3, 0.0, None, (), 0, marks=pytest.mark.long),
            pytest.param(CORNER, 0.1, 0.0, 1.0, None, (), 0, marks=pytest.mark.long),
            (ASIDE, 0.1, 0.3, 0.9, None, (), 0),
            pytest.param(CORNER, 0.1, 0.0, 0.0, 0.5, (), 0, marks=pytest.mark.long),
            (ASIDE, 0.1, 0.3, 0.9, 0.0, (), 0),
            (CORNER, 0.1, 0.3, 0.0, 0.3, ((0.5, 0.9), (0.8, 0.2)), 0),
            (ASIDE, 0.1, 0.3, 0.9, None, ((0.5, 0.1), (0.3, 1.2)), 0),
            pytest.param(CORNER, 0.1, 0.0, 0.0, None, (), 3, marks=pytest.mark.long),
            (ASIDE, 0.1, 0.3, 0.9, 0.0, (), 3),
        ],
    )
    def test_score_is_the_slope_of_the_value(
        self, state, slope, growing, active, beam, own, n_uneven
    ):
        """Pixels' nuisances follow a step as `nuisance_gain` says; the slope along that way is the
        efficient score. In standard errors of each parameter alone; corners in view included."""
        light, pixels = scene_of(
            state, slope=slope, pixel_std=2.0, scatter=0.1, n_modes=2, n_uneven=n_uneven
        )
        if growing:
            varies = np.array([-growing, growing, 0.3 * growing])
            spots = tuple(SpotAlong(np.array([-6.0, 6.0]), varies) for _ in light.lines)
            light = replace(light, spots=spots)
        light = replace(light, active_px=active, beam_share=beam)
        light = replace(light, own_shares=own, lens_var_px2=0.3**2)
        model = Model(state, light, pixels, seed=1)
        found = model.at()
        error = 1.0 / np.sqrt(np.diag(found.information) + 1e-12)
        differences = []
        for k in range(model.layout.size):
            step = np.zeros(model.layout.size)
            step[k] = 0.02 * error[k]
            follow = found.nuisance_gain[:, :, k] * step[k]
            up, down = (
                model.at(
                    side * step,
                    background=model.log_background + side * follow[:, 0],
                    shift=model.shift + side * follow[:, 1],
                    uneven=model.uneven + side * follow[:, 2:],
                ).value
                for side in (1, -1)
            )
            differences.append((up - down) / (2 * step[k]) * error[k] - found.score[k] * error[k])
        assert np.abs(differences).max() < 0.06

    def test_information_is_the_scores_covariance(self):
        """Delays and departures from even light are drawn anew with the counts. 300
        draws of some 30 whitened scores: the mean square is 1 within 1.5 %, five of these 8 %."""
        light, pixels = scene_of(CORNER, pixel_std=3.0, scatter=0.03)
        model = Model(CORNER, light, pixels, seed=3)
        even = np.zeros(pixels.near.shape)
        base = model.at(shift=np.zeros(len(pixels.rows)), uneven=even)
        n, size, draws = len(pixels.rows), model.layout.size, 300
        local = model.local(np.zeros(size))
        scores = np.empty((draws, size))
        for i in range(draws):
            shift = 3.0 * model.rng.normal(size=n)
            uneven = 0.03 * model.rng.normal(size=even.shape)
            mean = expected_counts(local, model.log_background, shift, model.first, uneven)
            codes = codes_from(model.rng.poisson(mean), model.first)
            scores[i] = model.at(codes=codes, shift=np.zeros(n), uneven=even).score
        values, vectors = np.linalg.eigh(base.information)
        firm = values > 1e-8 * values.max()
        whitened = scores @ vectors[:, firm] / np.sqrt(values[firm])
        squares = np.mean(whitened**2)
        assert squares == pytest.approx(1.0, abs=0.08)

    def test_unknown_delays_and_backgrounds_cost_information(self):
        light, pixels = scene_of(CORNER)
        clean = Model(CORNER, light, pixels, seed=4)
        doubtful = replace(pixels, pixel_var=np.full(len(pixels.rows), 5.0**2))
        loose = likelihood(
            clean.local(np.zeros(clean.layout.size)), doubtful, clean.codes,
            log_background=clean.log_background, delay_shift_ps=np.zeros(len(pixels.rows)),
            log_scatter=(0.1, 0.1),
        )  # fmt: skip
        firm = clean.at(shift=np.zeros(len(pixels.rows)))
        lost = np.linalg.eigvalsh(firm.information - loose.information)
        assert lost.min() > -1e-6 * lost.max()
        assert lost.max() > 0.1 * np.linalg.eigvalsh(firm.information).max() * 1e-3


class TestCollapse:
    """Three moments of the footprint stand for the integral along the leg (design 3.7)."""

    @staticmethod
    def integrated(state, light, slope, first, row, col, leg):
        """(codes,), counts of one pixel by walking along one leg in 8,000 steps."""
        f = (np.arange(8000)[:, np.newaxis] + 0.5) / 8000
        a, b = state.vertices_mm[leg : leg + 2]
        points = (1 - f) * a + f * b
        r, c = CAMERA.pixels_from_points(points)
        near = np.hypot(r - row, c - col) < 3.0
        f, points, r, c = f[near], points[near], r[near], c[near]
        uv = undistorted_px(CAMERA, r, c)
        along, _ = light.lines[leg].along_across(uv)
        spot = np.exp(light.log_spot_px)
        # Strength whose smoothing by the spot is the spline's exp(k s): exp(k s - k^2 v / 2).
        strength = 300.0 * np.exp(slope * along - 0.5 * (slope * spot) ** 2)
        away2 = (r - row) ** 2 + (c - col) ** 2
        weight = strength * np.exp(-0.5 * away2 / spot**2) / (np.sqrt(2 * np.pi) * spot)
        weight = weight * np.gradient(along)
        times = state.vertex_times_ps(AIR)
        arrival = times[leg] + f[:, 0] * (times[leg + 1] - times[leg])
        arrival = arrival + 1.00027 / 0.299792458 * np.linalg.norm(
            points - CAMERA.center_mm, axis=1
        )
        edges = first + WIDTH * np.arange(CODES + 1)
        share = np.diff(ndtr((edges[:, np.newaxis] - arrival) / np.exp(light.log_std_ps)), axis=0)
        return share @ weight

    @pytest.mark.parametrize(
        ("state", "slope", "most"), [(CORNER, 0.0, 2e-3), (CORNER, 0.25, 4e-3), (STEEP, 0.1, 4e-3)]
    )
    def test_against_the_integral(self, state, slope, most):
        light, pixels = scene_of(state, slope=slope)
        layout = layout_of(3 * len(state.vertices_mm) + 1, 0, light)
        local = local_variables(
            state, light, pixels, layout,
            basis=np.eye(layout.n_free), modes=np.zeros(0), camera=CAMERA, medium=AIR,
        )  # fmt: skip
        first, checked = 3200.0, 0
        for p in range(len(pixels.rows)):
            for k in range(state.n_legs):
                photons = np.exp(local.log_photons[p, k])
                along = light.lines[k].along_across(pixels.points_px[p : p + 1])[0][0]
                low, high = light.lines[k].span_px
                if not pixels.near[p, k] or photons < 3.0 or not low + 1 < along < high - 1:
                    continue
                alone = Local(
                    local.log_photons[p : p + 1, k : k + 1], local.arrival_ps[p : p + 1, k : k + 1],
                    local.std_ps[p : p + 1, k : k + 1], local.third_ps3[p : p + 1, k : k + 1],
                    local.jacobian[p : p + 1],
                )  # fmt: skip
                found = expected_counts(alone, np.full(1, -99.0), np.zeros(1), first)[0]
                true = self.integrated(
                    state, light, slope, first, pixels.rows[p], pixels.cols[p], k
                )
                assert np.abs(found - true).sum() < most * max(true.sum(), 3.0) + 0.05, (p, k)
                checked += 1
        assert checked > 15

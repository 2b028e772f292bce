"""Light that comes twice, by way of a mirror or in a second pulse, beside what is diffuse.

Both are held against the same cells where they are looked for: about a path that is off a mirror
may look like a second pulse, and a pulse like a mirror, and both like what is wrong with it. What
was found stays while the path does and it explains more than none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from lightflight.reconstruct.model import light
from lightflight.reconstruct.model.cells import Cells, cells_about, lag_edges
from lightflight.reconstruct.model.expected_counts import Pulses
from lightflight.reconstruct.model.second_path import Places, SecondPath
from lightflight.reconstruct.model.second_pulse import Echo
from lightflight.reconstruct.model.sighting import Sighting
from lightflight.reconstruct.model.spread import Beam
from lightflight.reconstruct.other_light.around import (
    FINE_GROWTH,
    FINE_STDS,
    Group,
    Seen,
    lags_about_legs,
)
from lightflight.reconstruct.other_light.second_path import LEAST_GAIN, second_paths_in
from lightflight.reconstruct.other_light.second_pulse import lags_with, second_pulse_in
from lightflight.reconstruct.other_light.strengths import (
    MOST_ROUNDS,
    Beside,
    Known,
    Second,
    beside_dark,
    beside_in,
    scatter_of,
    strengths_of,
)

if TYPE_CHECKING:
    from lightflight.camera.model import Camera

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Asked:
    """The pixels of one camera and clock whose light is asked for its strengths.

    Attributes
    ----------
    whole : Sighting
        All recordings of that camera as one.
    seen : Seen
        The pixels that the legs light.
    pulses : Pulses
        Where their light is expected there.
    beam : Beam
        The light that halo and glare spread.
    dark : Group or None
        Pixels that no leg lights.
    std_ps : float
        Typical standard deviation of a pulse.
    nominal : bool
        Whether the widths of the codes were never measured.
    """

    whole: Sighting
    seen: Seen
    pulses: Pulses
    beam: Beam
    dark: Group | None
    std_ps: float
    nominal: bool

    def strengths(
        self,
        second: Second | None = None,
        *,
        lags_ps: Floats | None = None,
        dispersion: float = 1.0,
        most_misfit: float = np.inf,
        most_rounds: int = MOST_ROUNDS,
        to_the_end: bool = False,
    ) -> Known:
        """Strengths, with light that comes a second time if there is any."""
        if lags_ps is None:
            lags_ps = self.lags_ps(second) if isinstance(second, Echo) else None
        known = strengths_of(
            self.pulses,
            *self._beside(second, lags_ps),
            second,
            dispersion=dispersion,
            most_misfit=most_misfit,
            most_rounds=most_rounds,
            to_the_end=to_the_end,
        )
        # A second pulse moves as it is fitted, its cells do not.
        return replace(known, lags_ps=lags_ps)

    def _beside(
        self, second: Second | None, lags_ps: Floats | None
    ) -> tuple[Beside, Group | None, Beside | None]:
        if lags_ps is None and not isinstance(second, Echo):
            return self._plain
        beam, cells = self.lit_by(second), self.cells(self.whole, second, lags_ps)
        lit = beside_in(self.whole, self.seen, cells, beam)
        return lit, self.dark, beside_dark(self.whole, self.dark, beam)

    @cached_property
    def _plain(self) -> tuple[Beside, Group | None, Beside | None]:
        lit = beside_in(self.whole, self.seen, self.cells(self.whole, None), self.beam)
        return lit, self.dark, beside_dark(self.whole, self.dark, self.beam)

    def lit_by(self, second: Second | None) -> Beam:
        """The light that is spread, that of a second pulse included."""
        return self.beam.with_second(second) if isinstance(second, Echo) else self.beam

    def lags_ps(self, second: Second | None) -> Floats:
        """(m + 1,), edges of the cells about the light of the nearest leg."""
        std, period = self.std_ps, self.whole.histograms.laser_period_ps
        fine = lag_edges(std, FINE_STDS * std, FINE_GROWTH, period)
        if isinstance(second, Echo):
            fine = lags_with(fine, second.delay_ps, std, std)
        return fine

    def cells(
        self, sighting: Sighting, second: Second | None, lags_ps: Floats | None = None
    ) -> Cells:
        """Counts of one recording, or of all, in the pixels about the times of their legs."""
        fine = self.lags_ps(second) if lags_ps is None else lags_ps
        lags, own = lags_about_legs(self.seen, fine, self.std_ps), self.seen
        return cells_about(
            sighting, own.rows, own.cols, own.arrival_ps[:, 0], lags, nominal=self.nominal
        )


def scattered(asked: Asked) -> Known:
    """Strengths with counts that scatter as their pixels say, where they are no photons."""
    known = asked.strengths()
    if asked.whole.histograms.poisson:
        return known
    return asked.strengths(dispersion=scatter_of(known.pixels))


def with_second(
    asked: Asked,
    places: Callable[[float], Places],
    so_far: light.Diffuse | None,
    camera: Camera,
    *,
    stands: bool,
) -> Known:
    """Strengths with what comes twice, where the counts show it: of pulse and mirror the likelier.

    Parameters
    ----------
    asked : Asked
        The pixels.
    places : callable
        Of the path, by the typical standard deviation of a pulse, ps.
    so_far : Diffuse or None
        As it was found about the path before.
    camera : Camera
        Who sees it.
    stands : bool
        Whether the path is where it was then, nearly: what was found stays, also that there is
        none. About another one light that comes twice is asked for anew: it may have been for what
        was wrong with that path.

    Returns
    -------
    Known
    """
    if stands and so_far is not None:
        second = so_far.second
        if second is None:
            return asked.strengths()
        if isinstance(second, Echo):
            kept = _with_pulse_as_before(asked, second)
        else:
            here = places(float(np.median(so_far.std_ps[:, 0])))
            kept = _with_mirror_as_before(asked, replace(second, places=here, camera=camera))
        if kept is not None:
            return kept
    known = asked.strengths()
    # Strengths that run off take up what comes twice: it is looked for before they do.
    first = known if known.settled else asked.strengths(most_rounds=1)
    repeated = _with_second_pulse(asked, first)
    mirrored = _with_mirror(asked, known, first, repeated, places, camera)
    return next(one for one in (mirrored, repeated, known) if one is not None)


def _with_mirror_as_before(asked: Asked, mirror: SecondPath) -> Known | None:
    """Strengths with a mirror that was found; None: it explains too little now.

    Those without one are not fitted to their end, only as far as they cannot do as well.
    """
    # A leg may have left the picture since, and with it its share.
    if mirror.places.n_legs != len(mirror.mirror.share):
        return None
    mirrored = asked.strengths(mirror)
    if not (mirrored.settled and _possible(mirrored)):
        return None
    return mirrored if _explains(mirrored, asked) else None


def _with_pulse_as_before(asked: Asked, second: Echo) -> Known | None:
    """Strengths with a second pulse that was found; None: it explains too little now."""
    repeated = asked.strengths(second)
    if not (repeated.settled and _is_share(repeated)):
        return None
    return repeated if _explains(repeated, asked) else None


def _explains(known: Known, asked: Asked, plain: Known | None = None) -> bool:
    """Whether counts ask for what comes twice: without it they are worse, however well fitted.

    `plain` is what was fitted without it: where that never settled it was fitted to its end.
    """
    enough = known.misfit() + LEAST_GAIN
    if plain is not None and not plain.settled and plain.lags_ps is known.lags_ps:
        return plain.misfit() > enough
    without = asked.strengths(lags_ps=known.lags_ps, most_misfit=enough, to_the_end=True)
    return without.misfit() > enough


def _is_share(known: Known) -> bool:
    assert isinstance(known.second, Echo)
    return known.second.share > light.LEAST_SHARE


def _with_mirror(
    asked: Asked,
    known: Known,
    first: Known,
    repeated: Known | None,
    places: Callable[[float], Places],
    camera: Camera,
) -> Known | None:
    """Strengths with a mirror that is looked for; None: none explains as much.

    `known` are those without, `first` the pixels where it is looked for, `repeated` those with a
    second pulse if there is one.
    """
    here = places(float(np.median(first.pixels.std_ps[:, 0])))
    if not here.n_legs:
        return None
    # What strengths alone still gain is no mirror's.
    without = known.misfit() - known.ahead - LEAST_GAIN
    enough = without if repeated is None else repeated.misfit()
    lags_ps = None if repeated is None else repeated.lags_ps
    for second in second_paths_in(asked.seen, first.pixels, first.dark, here, camera):
        more = asked.strengths(second, lags_ps=lags_ps, most_misfit=enough)
        if more.misfit() < enough and not more.settled:
            # Its rounds went by on the way there: it goes on from where it is.
            more = asked.strengths(more.second, lags_ps=lags_ps, most_misfit=enough)
        explains = more.misfit() < enough
        if explains and more.settled and _possible(more):
            return more if _explains(more, asked, known) else None
        # The best one explains too little: so do the others.
        if not explains:
            return None
    return None


def _possible(known: Known) -> bool:
    """About a wrong path a mirror may help that no light would come from."""
    assert isinstance(known.second, SecondPath)
    share = known.second.mirror.share
    std = np.sqrt(np.diagonal(known.strengths.covariance))[-len(share) :]
    return bool(np.all((share > -3.0 * std) & (share < 1.0)))


def _with_second_pulse(asked: Asked, known: Known) -> Known | None:
    """Strengths with a second pulse; None: there is none. `known` is where it is looked for."""
    lags, period = asked.lags_ps(None), asked.whole.histograms.laser_period_ps or 0.0
    rough = second_pulse_in(known, lags, asked.std_ps, period)
    if rough is None or rough[1] < LEAST_GAIN:
        return None
    # Far from the pulse cells are wide: there they are cut anew.
    cell = np.searchsorted(lags, rough[0].delay_ps)
    lags = lags_with(lags, rough[0].delay_ps, 0.5 * (lags[cell] - lags[cell - 1]), asked.std_ps)
    known = asked.strengths(lags_ps=lags)
    found = second_pulse_in(known, lags, asked.std_ps, period)
    if found is None:
        return None
    enough = known.misfit() - LEAST_GAIN
    more = asked.strengths(found[0], lags_ps=lags, most_misfit=enough)
    found_one = more.settled and _is_share(more) and more.misfit() < enough
    return more if found_one and _explains(more, asked, known) else None

"""The light of a second pulse: every leg once more, earlier or later by one delay, with one share.

A laser's satellite, or the pulse that went to and fro once in a window before the scene, flies as
the first did. So each pixel's light L(t) comes as L(t) + s L(t - d), in all of them alike.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SHARE_STD = 1.0
"""What would surprise nobody: of two pulses the first is that of the path, often the brighter."""
_DELAY_STD_PS = 1e5
"""Any delay is as likely as any other, ps."""
_LONGEST_SHARE, _LONGEST_STDS = 0.3, 0.3
"""Most that share and delay, in standard deviations of a pulse, move in a round."""


@dataclass(frozen=True, eq=False)
class Echo:
    """The same light once more.

    Attributes
    ----------
    share : float
        Of the first pulse's light.
    delay_ps : float
        After the first pulse; negative: before it.
    std_ps : float
        Standard deviation of a pulse, ps.
    period_ps : float
        Of the laser, after which all comes again; 0: it does not.
    covariance : array of float, shape (2, 2)
        Of share and delay, once they are found.
    """

    share: float
    delay_ps: float
    std_ps: float
    period_ps: float = 0.0
    covariance: Floats = field(default_factory=lambda: np.zeros((2, 2)))

    size = 2
    """Unknowns: share and delay."""

    @property
    def value(self) -> Floats:
        """(2,), what priors hold; of the delay they hold nothing."""
        return np.array([self.share, 0.0])

    @property
    def precision(self) -> Floats:
        """(2,), of what is known of them beforehand."""
        return np.array([_SHARE_STD, _DELAY_STD_PS]) ** -2.0

    @property
    def longest(self) -> Floats:
        """(2,), most that they move in a round."""
        return np.array([_LONGEST_SHARE, _LONGEST_STDS * self.std_ps])

    def moved(self, step: Floats) -> Echo:
        """After a step of share and delay."""
        return replace(
            self, share=self.share + float(step[0]), delay_ps=self.delay_ps + float(step[1])
        )

    def of_width(self, std_ps: float) -> Echo:
        """The same of pulses of this standard deviation, ps."""
        return replace(self, std_ps=std_ps)

    def times(self, factor: float) -> Echo:
        """The same of a recording `factor` times as long."""
        return self

    def later(self, edges_ps: Floats, late_ps: Floats) -> Floats:
        """(n, 1), ps from each pulse (n, 1) to its second one, on the lap that cells (n, m) are."""
        shift = np.full(late_ps.shape, self.delay_ps)
        if self.period_ps > 0.0:
            middle = 0.5 * (edges_ps[:, :1] + edges_ps[:, -1:])
            shift -= self.period_ps * np.rint((late_ps + shift - middle) / self.period_ps)
        return shift

"""Recordings and the histograms they add up to.

- the records: `recording` (`Recording`: frames or photon events), `histograms` (`Histograms`);
  what both know of the clock: `clock_fields`
- from one to the other, streamed: `counting` (`histogram`)
- what a recording is, in numbers and sentences: `description`

Files are read and written one room further up, in `formats`.
"""

from typing import TYPE_CHECKING

from lightflight._lazy import lazy_names

if TYPE_CHECKING:
    from lightflight.recording.counting import histogram as histogram
    from lightflight.recording.histograms import Histograms as Histograms
    from lightflight.recording.recording import Recording as Recording


__getattr__, __dir__, __all__ = lazy_names(
    __name__,
    {
        "lightflight.recording.counting": ("histogram",),
        "lightflight.recording.histograms": ("Histograms",),
        "lightflight.recording.recording": ("Recording",),
    },
    moved={"read": "lightflight.formats.registry", "write": "lightflight.formats.registry"},
)

"""One fit of a path: from legs in the picture to its numbers, their errors and what they mean.

- a first path: `start`; with bent legs: `bent`; along curves that are told: `along`; through
  blocks of glass: `through_glass`
- which pulse is whose: `membership`; where the path ends: `ends`; what each camera shows:
  `pictures`, with clocks that are apart: `clocks`
- `joint`, on the solver `least_squares` and, where pulses may be wrong, `robust`
- the last fit: `fine`, with light that changes within three pixels (`uneven`) and the areas that
  pixels see with (`active_area`)
- the record: `result`, in words: `statements`; what was taken as exact costs: `prices`
- the baseline: `paper`, on `paper_projection`
"""

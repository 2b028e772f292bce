"""From legs and a model to a path: start, membership, the joint and the photon fit, revision.

- `start`: a first path; `membership`: which pulse is whose; `ends`: where the path ends
- estimators: `joint` (on `least_squares`), `photon` (on `climb`), `paper`
- `around`: the pixels about a path, and which legs light them
- `uneven`: times in light that changes within three pixels; `active_area`: how large the areas
  are that pixels see with
- `pooled`: a start in starved light
- second thoughts on the number of legs: `revise`, `unclaimed`; trials that fail: `outcome`
- from Fisher information to steps and covariances: `information`
- the record and what it means: `result`, `statements`
"""

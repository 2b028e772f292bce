"""The ways from sightings to a path, one file for each estimator of `reconstruct.estimators`.

- `request`: what an estimator is asked
- `joint`, `photon` (from where `joint` comes), `paper`
"""

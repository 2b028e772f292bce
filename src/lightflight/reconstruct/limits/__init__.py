"""What the photons allow: Cramér-Rao bounds of a path, and planning an experiment by them.

- `bounds`: the least covariance any unbiased estimator can have, under the model of `photon`
- `conditions`: how it is recorded, and the light that follows
- `planning`: light, time, pixels and places of the camera for a wanted error
"""

"""What every pixel should have counted: geometry, freedom of the path, light, footprints.

- what a fit is told and given: `setting`, `sighting` (one recording on the clock)
- a path in a fit, in numbers: `state`; blocks of glass on it: `glass`
- where pixels look along a path, and when: `geometry`; on the picture's plane: `image_plane`
- what may move, and the priors on it: `freedom`
- lines, brightness and spot of legs as the counts show them: `picture`, `lateral`; the brightness
  along a leg as a spline: `strength`; what a pixel sees of a line through lens and active area:
  `spot`
- expected counts with derivatives: `forward`, `footing`
- counts of single pixels about a pulse, whatever the path: `cells`, `counted`; what light beside
  a plain flight adds to them: `light`
- errors that all pixels share, of camera and medium: `shared`; how large is plausible: `sizes`
"""

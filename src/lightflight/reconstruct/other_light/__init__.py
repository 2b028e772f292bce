"""Light that is no leg's, and what it does to the times of the pulses.

- `around`: the pixels about a path, and which legs light them
- `diffuse`: haze, halo and glare, with their `strengths`; `tail`: what all pulses share
- light that comes twice: `second_path` (a mirror), `second_pulse`
"""

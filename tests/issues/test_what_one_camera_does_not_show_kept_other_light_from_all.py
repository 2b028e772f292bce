"""Of two cameras one showed a single leg of two: more than half of the path's pixels there were of
no use, so haze, halos and the shapes of drawn-out pulses were asked about in neither picture.

Light that took 100 ps through a pixel, behind a tail, then came 6 ps early, that of the other
camera 1 ps: right paths were contradicted, "clock of camera 2 off by 3.9 ps", and 7 to 9 stated
errors off (`benchmarks/piece_labs.py --only cameras --first 4000`, all of four recordings).
"""

from benchmarks.piece_labs import drawn_scene, path_of, pulls_of


def test_drawn_out_pulses_are_asked_about_where_they_are_seen():
    """Farthest of four places below 4.5 stated errors (false alarm 5e-5)."""
    scene = drawn_scene("cameras", 4000)
    path = path_of(scene)
    assert path.n_legs == 2
    assert path.verdict.level == "trust"
    assert pulls_of(scene, path)[:, 1].max() < 4.5

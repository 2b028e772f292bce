"""A search that parts a leg in two, nearly in line, may lose pulses which the whole leg has.

Scene 1000219 of the blind ones: three legs came out as four, contradicted, with ten pulses on none
of them; told that there are three, all 151 lay on the path, and it was trusted.
"""

from __future__ import annotations

from tests.reconstruct.test_unclaimed import verdict_on


def test_a_leg_parted_in_line_lost_its_pulses():
    outcome = verdict_on(1000219)
    assert outcome.failure == ""
    assert outcome.level == "trust"

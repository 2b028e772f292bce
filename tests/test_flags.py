"""Flags: one registry, one bit each, and nothing beside it."""

import numpy as np
import pytest

from lightflight import flags


def test_every_flag_is_one_bit_of_its_own():
    values = [flag.value for flag in flags.REGISTRY]
    assert values == [1 << i for i in range(len(values))]
    assert max(values) < 2**32


def test_names_and_meanings_are_distinct():
    assert len({flag.name for flag in flags.REGISTRY}) == len(flags.REGISTRY)
    assert len({flag.meaning for flag in flags.REGISTRY}) == len(flags.REGISTRY)


@pytest.mark.parametrize("flag", flags.REGISTRY, ids=lambda flag: flag.name)
def test_constant_of_each_flag_is_its_name_in_capitals(flag):
    # Constants are unpacked from slices of the registry: one entry too many would shift them.
    assert getattr(flags, flag.name.upper()) == flag.value


@pytest.mark.parametrize("flag", flags.REGISTRY, ids=lambda flag: flag.name)
def test_a_flag_excludes_if_it_says_so(flag):
    assert bool(flags.is_usable(flag.value)) is not flag.excludes
    assert bool(flags.EXCLUDING & flag.value) is flag.excludes


def test_unflagged_is_usable_and_one_bad_bit_is_enough():
    words = np.array(
        [[0, flags.MULTIPLE_PULSES], [flags.SCREAMING, flags.SCREAMING | flags.POOR_FIT]],
        dtype=np.uint32,
    )
    np.testing.assert_array_equal(flags.is_usable(words), [[True, True], [False, False]])


def test_names_from_flags_reads_a_word():
    word = np.uint32(flags.TOO_FEW | flags.OUTLIER)
    assert flags.names_from_flags(word) == ("too_few", "outlier")
    assert flags.names_from_flags(0) == ()


def test_counting_leaves_out_what_nobody_carries():
    words = [0, flags.DEAD, flags.DEAD | flags.MASKED, flags.MASKED]
    assert flags.count_flags(words) == {"dead": 2, "masked": 2}
    assert flags.count_flags(np.zeros((3, 4), dtype=np.uint32)) == {}
    assert flags.count_flags([]) == {}

"""Histograms: what it takes, what it refuses, and which delays its codes stand for."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, strategies as st

from lightflight.errors import CalibrationError
from lightflight.recording.histograms import Histograms


def cube(dtype=np.uint32, shape=(2, 3, 5)):
    return np.arange(np.prod(shape)).reshape(shape).astype(dtype)


class TestCounts:
    @pytest.mark.parametrize("dtype", [np.int64, np.float32, np.float64, np.int8, bool])
    def test_whole_numbers_of_any_type_become_unsigned(self, dtype):
        counts = cube(dtype)
        hist = Histograms(counts)
        assert hist.counts.dtype == np.uint32
        np.testing.assert_array_equal(hist.counts, counts)

    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.uint64])
    def test_unsigned_keeps_its_type(self, dtype):
        assert Histograms(cube(dtype)).counts.dtype == dtype

    def test_counts_beyond_32_bits_are_kept_whole(self):
        counts = np.full((1, 1, 2), 2**32 + 5, dtype=np.int64)
        np.testing.assert_array_equal(Histograms(counts).counts, counts)

    def test_nested_lists_will_do(self):
        assert Histograms([[[1, 2, 3]]]).counts.shape == (1, 1, 3)

    def test_read_only_and_apart_from_the_caller(self):
        mine = cube()
        hist = Histograms(mine)
        with pytest.raises(ValueError, match="read-only"):
            hist.counts[0, 0, 0] = 1
        mine[0, 0, 0] = 77
        assert hist.counts[0, 0, 0] == 0
        assert mine.flags.writeable

    def test_a_read_only_view_of_writable_memory_is_copied(self):
        mine = cube()
        view = mine.view()
        view.setflags(write=False)
        hist = Histograms(view)
        mine[0, 0, 0] = 77
        assert hist.counts[0, 0, 0] == 0

    def test_an_array_nobody_can_write_to_is_not_copied(self):
        mine = cube()
        mine.setflags(write=False)
        assert np.shares_memory(Histograms(mine).counts, mine)

    def test_non_contiguous_counts_keep_their_place(self):
        counts = cube(shape=(4, 6, 5))[::2, ::-1, 1:]
        np.testing.assert_array_equal(Histograms(counts).counts, counts)

    @pytest.mark.parametrize(
        ("counts", "error", "sentence"),
        [
            (np.zeros((4, 4)), ValueError, r"shape \(rows, cols, codes\), got shape \(4, 4\)"),
            (np.zeros((2, 2, 2, 2)), ValueError, "reorder or reshape"),
            (np.zeros((0, 4, 4)), ValueError, "counts is empty"),
            (np.zeros((4, 4, 0)), ValueError, "counts is empty"),
            (np.full((1, 2, 2), "a"), TypeError, "must be numbers"),
            (np.full((1, 2, 2), 1j), TypeError, "must be numbers, got dtype complex128"),
            (np.array([[[0, np.nan]]]), ValueError, r"counts\[0, 0, 1\] is not finite"),
            (np.array([[[np.inf, 0]]]), ValueError, "is not finite"),
            (np.array([[[0, -2]]]), ValueError, r"counts\[0, 0, 1\] = -2 is negative"),
            (np.array([[[0, -2.0]]]), ValueError, "do not subtract a background"),
            (np.array([[[1.5, 0]]]), ValueError, r"= 1.5 is fractional.*poisson=False"),
        ],
    )
    def test_what_cannot_be_counts_is_refused_in_a_sentence(self, counts, error, sentence):
        with pytest.raises(error, match=sentence):
            Histograms(counts)

    def test_scaled_intensities_may_be_fractional_and_negative_but_not_nan(self):
        values = np.array([[[1.5, -0.25, 3.0]]], dtype=np.float32)
        hist = Histograms(values, poisson=False)
        assert hist.counts.dtype == np.float64
        np.testing.assert_array_equal(hist.counts, values)
        assert not hist.counts.flags.writeable
        with pytest.raises(ValueError, match="not finite"):
            Histograms(np.array([[[np.nan]]]), poisson=False)


class TestMetadata:
    def test_defaults_are_one_sweep_of_unknown_width(self):
        hist = Histograms(cube())
        assert (hist.shape, hist.n_codes) == ((2, 3), 5)
        assert hist.bin_width_ps is None
        assert hist.laser_period_ps is None
        assert hist.occupancy is None
        assert hist.poisson
        assert not hist.reversed_codes

    def test_frozen_and_keyword_only(self):
        with pytest.raises(dataclasses.FrozenInstanceError):
            Histograms(cube()).bin_width_ps = 1.0  # type: ignore[misc]
        with pytest.raises(TypeError):
            Histograms(cube(), 55.0)  # type: ignore[call-arg]

    @pytest.mark.parametrize(
        "name", ["bin_width_ps", "laser_period_ps", "n_frames", "periods_per_frame"]
    )
    @pytest.mark.parametrize("value", [0, -1.0, np.nan, np.inf])
    def test_what_must_be_positive(self, name, value):
        with pytest.raises(ValueError, match=f"{name} must be positive and finite"):
            Histograms(cube(), **{name: value})

    @pytest.mark.parametrize(("name", "value"), [("n_frames", 2.5), ("periods_per_frame", 0.5)])
    def test_what_must_be_whole(self, name, value):
        with pytest.raises(ValueError, match=f"{name} must be a whole number, got {value}"):
            Histograms(cube(), **{name: value})

    def test_first_edge_must_be_finite(self):
        with pytest.raises(ValueError, match="first_edge_ps must be finite, got nan"):
            Histograms(cube(), first_edge_ps=np.nan)

    @pytest.mark.parametrize("code", [-1, 5, 0.5])
    def test_no_photon_code_is_one_of_the_codes(self, code):
        with pytest.raises(
            ValueError,
            match=f"no_photon_code = {code} is not one of the 5 codes|whole number, got {code}",
        ):
            Histograms(cube(), no_photon_code=code)

    def test_reversed_codes_need_the_next_laser_pulse(self):
        with pytest.raises(ValueError, match="needs laser_period_ps"):
            Histograms(cube(), reversed_codes=True)


class TestPhotons:
    def test_empty_frames_are_no_photons(self):
        counts = np.array([[[100, 1, 2], [50, 0, 7]]])
        hist = Histograms(counts, no_photon_code=0, n_frames=110)
        np.testing.assert_array_equal(hist.photons, [[3, 7]])
        np.testing.assert_array_equal(hist.photon_codes, [False, True, True])
        np.testing.assert_allclose(hist.occupancy, [[3 / 110, 7 / 110]])

    def test_without_such_a_code_all_count(self):
        hist = Histograms(np.array([[[100, 1, 2]]]))
        np.testing.assert_array_equal(hist.photons, [[103]])
        assert hist.photon_codes.all()

    def test_sums_do_not_wrap(self):
        full = np.full((1, 1, 300), 255, dtype=np.uint8)
        assert Histograms(full).photons[0, 0] == 300 * 255
        full32 = np.full((1, 1, 3), 2**32 - 1, dtype=np.uint32)
        assert Histograms(full32, no_photon_code=1).photons[0, 0] == 2 * (2**32 - 1)

    def test_intensities_sum_as_they_are(self):
        hist = Histograms(np.array([[[1.5, -0.5, 2.0]]]), poisson=False, no_photon_code=2)
        np.testing.assert_array_equal(hist.photons, [[1.0]])


class TestCodeIntervals:
    """Forward code k: [f + k w, f + (k+1) w); reversed: (P - f - (k+1) w, P - f - k w]."""

    def test_forward(self):
        hist = Histograms(cube(), bin_width_ps=55.0, first_edge_ps=10.0)
        lower, upper = hist.code_intervals_ps()
        np.testing.assert_allclose(lower, [10, 65, 120, 175, 230])
        np.testing.assert_allclose(upper, [65, 120, 175, 230, 285])

    def test_reversed_counts_back_from_the_next_sync(self):
        hist = Histograms(
            cube(),
            bin_width_ps=55.0,
            laser_period_ps=50_000.0,
            first_edge_ps=10.0,
            reversed_codes=True,
        )
        lower, upper = hist.code_intervals_ps()
        np.testing.assert_allclose(lower, 50_000 - 10 - 55.0 * np.array([1, 2, 3, 4, 5]))
        np.testing.assert_allclose(upper - lower, 55.0)

    def test_codes_past_the_period_are_negative_delays_of_the_same_photon(self):
        hist = Histograms(
            cube(shape=(1, 1, 11)), bin_width_ps=10.0, laser_period_ps=100.0, reversed_codes=True
        )
        lower, _ = hist.code_intervals_ps()
        assert lower[-1] == -10.0
        assert np.mod(lower[-1], 100.0) == lower[0]

    def test_no_photon_code_has_no_width(self):
        for backwards in (False, True):
            hist = Histograms(
                cube(),
                bin_width_ps=55.0,
                laser_period_ps=1000.0,
                reversed_codes=backwards,
                no_photon_code=2,
            )
            lower, upper = hist.code_intervals_ps()
            np.testing.assert_allclose(upper - lower, [55, 55, 0, 55, 55])

    def test_without_a_width_there_are_no_times(self):
        with pytest.raises(CalibrationError, match="give bin_width_ps"):
            Histograms(cube()).code_intervals_ps()

    @given(
        width=st.floats(0.5, 200.0),
        first=st.floats(-500.0, 500.0),
        n_codes=st.integers(1, 40),
        backwards=st.booleans(),
    )
    def test_codes_tile_the_delays_without_gap(self, width, first, n_codes, backwards):
        hist = Histograms(
            np.zeros((1, 1, n_codes), dtype=np.uint8),
            bin_width_ps=width,
            laser_period_ps=20_000.0,
            first_edge_ps=first,
            reversed_codes=backwards,
        )
        lower, upper = hist.code_intervals_ps()
        assert (upper > lower).all()
        if backwards:
            np.testing.assert_array_equal(lower[:-1], upper[1:])
        else:
            np.testing.assert_array_equal(upper[:-1], lower[1:])
        assert upper.max() - lower.min() == pytest.approx(n_codes * width, rel=1e-9)

"""Counting kernels: dense frames of TDC codes, or photon events, into counts per pixel and code.

Of sparse frames the pixels that hold a photon are listed first, at the speed of memory, and only
these are counted. No kernel checks its input: codes and pixels must lie within `counts`, or
within `slot` and the TDC.

`counts` may have more columns than codes. Rows of 1,024 uint32 are one page long, and a pulse
that every pixel has at the same code then falls on a few cache sets: counting is four times
slower than with `padded_columns`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic
from numpy.typing import NDArray

from lightflight._kernels.jit import jit, piece

if TYPE_CHECKING:
    from numba.core.base import BaseContext as Target
    from numba.core.typing.context import BaseContext as Typing
    from numba.core.typing.templates import Signature

    Build = Callable[[Target, ir.IRBuilder, Signature, list[ir.Value]], ir.Value]
    """What Numba asks to write the machine language of one call."""
    BitsOf = Callable[[np.uint64], int]
    Fetch = Callable[[NDArray[np.generic], int], None]

Whole = NDArray[np.integer]

# --- five words of machine language that Numba has no name for: 64 codes at a time, and ahead --
#
# `lanes_other_than` compiles to vector loads and compares on every machine LLVM knows; it is what
# lets sparse frames be scanned at nearly the speed of memory. It checks nothing: 64 codes must
# follow `start` in the row. `fetch_ahead` asks for memory before it is needed: rows of 1,024
# counts are each a page of memory, and what the processor fetches by itself stops at the end of a
# page. `fetch_far_ahead` keeps it out of the nearest cache until then.

LANES = 64
"""Codes looked at together; one bit each in a 64-bit word."""

_BYTE, _CODE, _WORD, _LONG = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_CODES = ir.VectorType(_CODE, LANES)


def _lanes_other_than(
    typing_context: Typing, row: types.Type, start: types.Type, code: types.Type
) -> tuple[Signature, Build]:
    """uint64 whose bit j tells whether row[start + j] != code; row is a contiguous uint16."""

    def build(
        context: Target, builder: ir.IRBuilder, signature: Signature, arguments: list[ir.Value]
    ) -> ir.Value:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        place = builder.bitcast(builder.gep(array.data, [arguments[1]]), _CODES.as_pointer())
        codes = builder.load(place)
        codes.align = 2
        nothing = ir.Constant(_CODES, ir.Undefined)
        first = builder.insert_element(nothing, arguments[2], ir.Constant(_WORD, 0))
        all_first = ir.Constant(ir.VectorType(_WORD, LANES), [0] * LANES)
        same = builder.shuffle_vector(first, nothing, all_first)
        return builder.bitcast(builder.icmp_unsigned("!=", codes, same), _LONG)

    return types.uint64(row, types.intp, types.uint16), build


lanes_other_than = cast(
    "Callable[[NDArray[np.uint16], int, np.uint16], np.uint64]", intrinsic(_lanes_other_than)
)


def _count_of_bits(typing_context: Typing, word: types.Type) -> tuple[Signature, Build]:
    """How many bits of a uint64 are set."""

    def build(
        context: Target, builder: ir.IRBuilder, signature: Signature, arguments: list[ir.Value]
    ) -> ir.Value:
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), build


count_of_bits = cast("BitsOf", intrinsic(_count_of_bits))


def _lowest_bit(typing_context: Typing, word: types.Type) -> tuple[Signature, Build]:
    """Place of the lowest bit of a uint64 that is set; 64 where none is."""

    def build(
        context: Target, builder: ir.IRBuilder, signature: Signature, arguments: list[ir.Value]
    ) -> ir.Value:
        zero_is_defined = ir.Constant(ir.IntType(1), 0)
        return builder.cttz(arguments[0], zero_is_defined)

    return types.int64(types.uint64), build


lowest_bit = cast("BitsOf", intrinsic(_lowest_bit))


def _fetch(keep: int) -> Fetch:
    """Intrinsic (values, place) that asks memory for a line; `keep`: 3 in all caches, 2 not in L1.

    The line is the one that holds values[place]; harmless wherever that is.
    """

    def fetch(
        typing_context: Typing, values: types.Type, place: types.Type
    ) -> tuple[Signature, Build]:
        def build(
            context: Target, builder: ir.IRBuilder, signature: Signature, arguments: list[ir.Value]
        ) -> ir.Value:
            array = context.make_array(signature.args[0])(context, builder, arguments[0])
            address = builder.gep(array.data, [arguments[1]])
            address = builder.bitcast(address, _BYTE.as_pointer())
            kind = ir.FunctionType(ir.VoidType(), [_BYTE.as_pointer(), _WORD, _WORD, _WORD])
            prefetch = get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            read, how, data = (ir.Constant(_WORD, i) for i in (0, keep, 1))
            builder.call(prefetch, [address, read, how, data])
            return context.get_dummy_value()

        return types.void(values, types.intp), build

    return cast("Fetch", intrinsic(fetch))


fetch_ahead = _fetch(3)
fetch_far_ahead = _fetch(2)

# --- counting ----------------------------------------------------------------------------------

SPARE = 5
"""Places beyond the last photon that the lists have room for."""

PIECE = 1024
"""Pixels of a frame that are listed, then counted: their lists stay in the nearest cache."""

CHECKED_TOGETHER = 1 << 14
"""Photons that are checked before they are counted."""

_AHEAD = 2048
"""Codes between what is looked at and what is asked of memory; without, scanning takes twice as
long and more."""

_FAR_AHEAD = 4096
"""Codes between a piece whose photons are placed and what is asked of memory meanwhile."""

_PHOTONS_AHEAD = 64
"""Photons between the one that is counted and the one whose count is asked of memory."""

_PAGE_BYTES = 4096
_LINE_BYTES = 64
_LINE_CODES = 32


def padded_columns(n_codes: int, item_bytes: int) -> int:
    """Columns that keep the rows of `counts` from lying whole pages apart."""
    is_page = n_codes * item_bytes % _PAGE_BYTES == 0
    return n_codes + _LINE_BYTES // item_bytes if is_page else n_codes


@piece
def list_lit(row: NDArray[np.uint16], absent: np.uint16, lit: Whole) -> int:
    """List the pixels of a row of codes that hold a photon, in order; returns how many.

    `absent` (uint16) is the code that means no photon. The list has room for every pixel and
    `SPARE` more: of 64 pixels so many are written without asking whether they hold a photon,
    since at usual occupancies a branch for each would be guessed wrong.
    """
    whole = row.size // LANES * LANES
    n = 0
    for start in range(0, whole, LANES):
        fetch_ahead(row, start + _AHEAD)
        fetch_ahead(row, start + _AHEAD + _LINE_CODES)
        bits = lanes_other_than(row, start, absent)
        end = n + count_of_bits(bits)
        for j in range(SPARE):
            lit[n + j] = start + lowest_bit(bits)
            bits &= bits - np.uint64(1)
        n += SPARE
        while n < end:
            lit[n] = start + lowest_bit(bits)
            bits &= bits - np.uint64(1)
            n += 1
        n = end
    for pixel in range(whole, row.size):
        if row[pixel] != absent:
            lit[n] = pixel
            n += 1
    return n


@jit
def list_photons(
    frames: NDArray[np.uint16],
    absent: np.uint16,
    pixels: Whole,
    codes: NDArray[np.uint16],
    photons_per_frame: Whole,
) -> int:
    """List pixel and code of every photon of contiguous frames (n, pixels); returns how many.

    The lists have room for every pixel of every frame and `SPARE` more; see `list_lit`.
    """
    n = 0
    for i in range(frames.shape[0]):
        end = n + list_lit(frames[i], absent, pixels[n:])
        take_codes(frames[i], pixels[n:end], codes[n:end])
        photons_per_frame[i] = end - n
        n = end
    return n


@piece
def take_codes(row: NDArray[np.uint16], lit: Whole, codes: NDArray[np.uint16]) -> None:
    """Codes of some pixels of a row."""
    for k in range(lit.size):
        codes[k] = row[lit[k]]


@piece
def largest_of(values: Whole) -> np.integer:
    """Largest of at least one value."""
    largest: np.integer = values[0]
    for i in range(values.size):
        largest = max(largest, values[i])
    return largest


@piece
def add_photons(pixels: Whole, codes: Whole, counts: Whole) -> None:
    """Add photons to `counts` (pixels, codes), whose rows lie one after another."""
    flat, n_columns = counts.reshape(counts.size), counts.shape[1]
    n_told = max(0, pixels.size - _PHOTONS_AHEAD)
    for i in range(n_told):
        later = i + _PHOTONS_AHEAD
        fetch_ahead(flat, np.int64(pixels[later]) * n_columns + codes[later])
        flat[np.int64(pixels[i]) * n_columns + codes[i]] += 1
    for i in range(n_told, pixels.size):
        flat[np.int64(pixels[i]) * n_columns + codes[i]] += 1


@piece
def add_photons_in_window(
    pixels: Whole,
    codes: Whole,
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    counts: Whole,
) -> None:
    """Add photons to `counts` (slots, `n_kept` codes from `first_code`); slot -1 is left out."""
    for i in range(pixels.size):
        place = slot[pixels[i]]
        k = np.int64(codes[i]) - first_code
        if place >= 0 and 0 <= k < n_kept:
            counts[place, k] += 1


@jit
def add_all_codes(
    frames: Whole,
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    counts: Whole,
) -> None:
    """Add every code of frames (n, pixels), for cameras without a code for "no photon"."""
    n_frames, n_pixels = frames.shape
    for i in range(n_frames):
        for pixel in range(n_pixels):
            k = np.int64(frames[i, pixel]) - first_code
            if slot[pixel] >= 0 and 0 <= k < n_kept:
                counts[slot[pixel], k] += 1


@jit
def add_frames(
    frames: NDArray[np.uint16],
    absent: np.uint16,
    n_codes: int,
    lit: NDArray[np.uint16],
    places: NDArray[np.uint64],
    counts: Whole,
) -> bool:
    """Add the photons of contiguous frames (n, pixels) to `counts` (pixels, codes).

    Returns False, and stops, where a frame holds a code not below `n_codes`. `lit` (`PIECE` +
    `SPARE`,) and `places` (2, `PIECE`) are scratch. The photons of a piece are added after those
    of the next are placed: their counts have then come from memory.
    """
    n_frames, n_pixels = frames.shape
    flat, n_columns = counts.reshape(counts.size), counts.shape[1]
    n_before, turn = 0, 0
    for i in range(n_frames):
        for first in range(0, n_pixels, PIECE):
            row = frames[i, first : first + PIECE]
            n = list_lit(row, absent, lit)
            if place_photons(row, lit[:n], first, n_columns, flat, places[turn]) >= n_codes:
                return False
            turn = 1 - turn
            add_ones(places[turn, :n_before], flat)
            n_before = n
    add_ones(places[1 - turn, :n_before], flat)
    return True


@piece
def place_photons(
    row: NDArray[np.uint16],
    lit: NDArray[np.uint16],
    first_pixel: int,
    n_columns: int,
    flat: Whole,
    places: NDArray[np.uint64],
) -> np.uint16:
    """Where in `flat` the pixels of a piece of a frame are counted; returns the largest code.

    Asks memory for these counts and, for each, for a line of the frames to come: this keeps
    memory at work while no frame is looked at.
    """
    largest = np.uint16(0)
    for k in range(lit.size):
        code = row[lit[k]]
        largest = max(largest, code)
        place = (first_pixel + lit[k]) * n_columns + code
        places[k] = place
        fetch_ahead(flat, place)
        fetch_far_ahead(row, _FAR_AHEAD + _LINE_CODES * k)
    return largest


@piece
def add_ones(places: NDArray[np.uint64], flat: Whole) -> None:
    """Count one more at each place; unsigned, so that none is looked for from the end."""
    for k in range(places.size):
        flat[places[k]] += 1


@jit
def add_frames_in_window(
    frames: NDArray[np.uint16],
    absent: np.uint16,
    n_codes: int,
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    lit: NDArray[np.uint16],
    codes: NDArray[np.uint16],
    counts: Whole,
) -> bool:
    """As `add_frames`, for `counts` as in `add_photons_in_window`; `codes` is scratch, too."""
    n_frames, n_pixels = frames.shape
    for i in range(n_frames):
        for first in range(0, n_pixels, PIECE):
            row = frames[i, first : first + PIECE]
            n = list_lit(row, absent, lit)
            take_codes(row, lit[:n], codes[:n])
            if n > 0 and largest_of(codes[:n]) >= n_codes:
                return False
            some = slot[first : first + PIECE]
            add_photons_in_window(lit[:n], codes[:n], some, first_code, n_kept, counts)
    return True


@jit
def add_events(
    pixels: Whole,
    codes: Whole,
    n_codes: int,
    slot: NDArray[np.int64],
    first_code: int,
    n_kept: int,
    is_whole: bool,
    counts: Whole,
) -> bool:
    """Add photons to `counts`; False, and stops, where one is of no pixel or code there is.

    Photons are checked some thousands at a time, so that they are read from memory once.
    """
    for start in range(0, pixels.size, CHECKED_TOGETHER):
        some_pixels = pixels[start : start + CHECKED_TOGETHER]
        some_codes = codes[start : start + CHECKED_TOGETHER]
        if largest_of(some_pixels) >= slot.size or largest_of(some_codes) >= n_codes:
            return False
        if is_whole:
            add_photons(some_pixels, some_codes, counts)
        else:
            add_photons_in_window(some_pixels, some_codes, slot, first_code, n_kept, counts)
    return True

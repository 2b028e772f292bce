"""Five words of machine language that Numba has no name for: 64 codes at a time, and ahead.

`lanes_other_than` compiles to vector loads and compares on every machine LLVM knows; it is what
lets sparse frames be scanned at nearly the speed of memory. It checks nothing: 64 codes must
follow `start` in the row. `fetch_ahead` asks for memory before it is needed: rows of 1,024 counts
are each a page of memory, and what the processor fetches by itself stops at the end of a page.
`fetch_far_ahead` keeps it out of the nearest cache until then.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core.cgutils import get_or_insert_function
from numba.extending import intrinsic

LANES = 64
"""Codes looked at together; one bit each in a 64-bit word."""

_BYTE, _CODE, _WORD, _LONG = (ir.IntType(bits) for bits in (8, 16, 32, 64))
_CODES = ir.VectorType(_CODE, LANES)


def _lanes_other_than(typing_context: Any, row: Any, start: Any, code: Any) -> Any:
    """uint64 whose bit j tells whether row[start + j] != code; row is a contiguous uint16."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
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


lanes_other_than: Any = intrinsic(_lanes_other_than)


def _count_of_bits(typing_context: Any, word: Any) -> Any:
    """How many bits of a uint64 are set."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ctpop(arguments[0])

    return types.int64(types.uint64), build


count_of_bits: Any = intrinsic(_count_of_bits)


def _lowest_bit(typing_context: Any, word: Any) -> Any:
    """Place of the lowest bit of a uint64 that is set; 64 where none is."""

    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        zero_is_defined = ir.Constant(ir.IntType(1), 0)
        return builder.cttz(arguments[0], zero_is_defined)

    return types.int64(types.uint64), build


lowest_bit: Any = intrinsic(_lowest_bit)


def _fetch(keep: int) -> Any:
    """Intrinsic (values, place) that asks memory for a line; `keep`: 3 in all caches, 2 not in L1.

    The line is the one that holds values[place]; harmless wherever that is.
    """

    def fetch(typing_context: Any, values: Any, place: Any) -> Any:
        def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            array = context.make_array(signature.args[0])(context, builder, arguments[0])
            address = builder.gep(array.data, [arguments[1]])
            address = builder.bitcast(address, _BYTE.as_pointer())
            kind = ir.FunctionType(ir.VoidType(), [_BYTE.as_pointer(), _WORD, _WORD, _WORD])
            prefetch = get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
            read, how, data = (ir.Constant(_WORD, i) for i in (0, keep, 1))
            builder.call(prefetch, [address, read, how, data])
            return context.get_dummy_value()

        return types.void(values, types.intp), build

    return intrinsic(fetch)


fetch_ahead: Any = _fetch(3)
fetch_far_ahead: Any = _fetch(2)

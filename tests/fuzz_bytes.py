"""Changes of any bytes, for `fuzz_readers`: numbers that hurt, cuts, doubled stretches, noise."""

from __future__ import annotations

import re
import struct

import numpy as np

HURTFUL = (0, 1, 2, 7, 127, 128, 255, 256, 32767, 32768, 65535, 2**31 - 1, 2**31, 2**32 - 1)
HURTFUL_WIDE = (*HURTFUL, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1)
"""Integers that readers trip over, of up to four bytes and of eight."""

_HURTFUL_TEXTS = (
    b"0",
    b"-1",
    b"1e999",
    b"nan",
    b"99999999999999999999",
    b"",
    b"x",
    b"[[[[",
    b"1.5",
)


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """One to four changes of a stretch of bytes."""
    changes = (_bits, _number, _number, _number, _text_number, _cut, _doubled, _swapped, _noise)
    for _ in range(int(rng.integers(1, 5))):
        change = changes[int(rng.integers(len(changes)))]
        content = change(content, rng) if content else content
    return content


def _place(content: bytes, rng: np.random.Generator) -> int:
    """Anywhere, but half of the time in the first few hundred bytes, where headers are."""
    end = len(content) if rng.random() < 0.5 else min(len(content), 600)
    return int(rng.integers(end))


def _bits(content: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(content)
    for _ in range(int(rng.integers(1, 9))):
        out[_place(content, rng)] ^= 1 << int(rng.integers(8))
    return bytes(out)


def _number(content: bytes, rng: np.random.Generator) -> bytes:
    """A hurtful integer, or float, over what may be one, aligned most of the time."""
    width = int(rng.choice([1, 2, 4, 8]))
    at = _place(content, rng)
    if rng.random() < 0.8:
        at -= at % width
    values = HURTFUL_WIDE if width == 8 else HURTFUL
    value = values[int(rng.integers(len(values)))] & ((1 << 8 * width) - 1)
    packed = value.to_bytes(width, "little" if rng.random() < 0.8 else "big")
    if width == 8 and rng.random() < 0.2:
        packed = struct.pack("<d", rng.choice([np.nan, np.inf, -1.0, 1e308, 0.0]))
    return content[:at] + packed + content[at + width :]


def _text_number(content: bytes, rng: np.random.Generator) -> bytes:
    """Another number, or none, where a text has one."""
    found = list(re.finditer(rb"-?\d+(?:\.\d+)?", content[: 1 << 16]))
    if not found:
        return _bits(content, rng)
    one = found[int(rng.integers(len(found)))]
    new = _HURTFUL_TEXTS[int(rng.integers(len(_HURTFUL_TEXTS)))]
    return content[: one.start()] + new + content[one.end() :]


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    start = _place(content, rng)
    if rng.random() < 0.5:
        return content[:start]
    return content[:start] + content[start + int(rng.integers(1, 65)) :]


def _doubled(content: bytes, rng: np.random.Generator) -> bytes:
    start, length = _place(content, rng), int(rng.integers(1, 257))
    return content[: start + length] + content[start:]


def _swapped(content: bytes, rng: np.random.Generator) -> bytes:
    first, second = sorted((_place(content, rng), _place(content, rng)))
    length = min(int(rng.integers(1, 65)), second - first)
    return (
        content[:first]
        + content[second : second + length]
        + content[first + length : second]
        + content[first : first + length]
        + content[second + length :]
    )


def _noise(content: bytes, rng: np.random.Generator) -> bytes:
    start, length = _place(content, rng), int(rng.integers(1, 65))
    return content[:start] + rng.bytes(length) + content[start + length :]

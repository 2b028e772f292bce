"""Small files of formats that only vendors write, put together byte by byte."""

from __future__ import annotations

import struct

import numpy as np

_INT, _FLOAT, _TEXT, _EMPTY = 0x10000008, 0x20000008, 0x4001FFFF, 0xFFFF0008


def _tag(name: str, value: int | float | str | None, index: int = -1) -> bytes:
    """One header item of a .ptu: name, index, type, eight bytes, and a text if it is one."""
    if value is None:
        kind, body, extra = _EMPTY, bytes(8), b""
    elif isinstance(value, str):
        extra = value.encode().ljust(-(-(len(value) + 1) // 8) * 8, b"\0")
        kind, body = _TEXT, struct.pack("<q", len(extra))
    elif isinstance(value, float):
        kind, body, extra = _FLOAT, struct.pack("<d", value), b""
    else:
        kind, body, extra = _INT, struct.pack("<q", value), b""
    return name.encode().ljust(32, b"\0") + struct.pack("<iI", index, kind) + body + extra


def ptu_bytes(codes: np.ndarray, *, mode: int = 3, promised_records: int | None = None) -> bytes:
    """A point measurement of a PicoHarp: one photon per sync, in channel 1."""
    sync = np.arange(1, codes.size + 1) & 0xFFFF
    records = (1 << 28 | codes.astype(np.uint32) << 16 | sync.astype(np.uint32)).astype("<u4")
    items: list[tuple[str, int | float | str | None]] = [
        ("Measurement_Mode", mode),
        ("Measurement_SubMode", 0),
        ("HW_Type", "PicoHarp"),
        ("HW_InpChannels", 2),
        ("MeasDesc_GlobalResolution", 5e-8),
        ("MeasDesc_Resolution", 1.6e-11),
        ("TTResult_SyncRate", 20_000_000),
        ("TTResult_NumberOfRecords", codes.size if promised_records is None else promised_records),
        ("TTResultFormat_TTTRRecType", 0x00010303 if mode == 3 else 0x00010203),
        ("TTResultFormat_BitsPerRecord", 32),
        ("Header_End", None),
    ]
    header = b"PQTTTR\0\0" + b"1.0.00\0\0" + b"".join(_tag(*item) for item in items)
    return header + records.tobytes()


_INFO = b"*IDENTIFICATION\r\n  ID        : SPC Setup & Data File\r\n*END\r\n\r\n"
_MEASURED_BYTES = 512
_TAC_RANGE_AT, _TAC_GAIN_AT, _CODES_AT, _MODULE_AT = 64, 68, 82, 117


def sdt_bytes(decays: np.ndarray, *, tac_range_s: float = 5e-8, n_blocks: int = 1) -> bytes:
    """Uncompressed decays (curves, codes) of an SPC module: header, text, description, blocks."""
    measured = bytearray(_MEASURED_BYTES)
    struct.pack_into("<f", measured, _TAC_RANGE_AT, tac_range_s)
    struct.pack_into("<h", measured, _TAC_GAIN_AT, 1)
    struct.pack_into("<h", measured, _CODES_AT, decays.shape[1])
    struct.pack_into("<7s", measured, _MODULE_AT, b"SPC-130")
    content = decays.astype("<u2").tobytes()
    info_at = struct.calcsize("<hihiHihIihhHIHH")
    measured_at = info_at + len(_INFO)
    block_at = measured_at + _MEASURED_BYTES
    header = struct.pack(
        "<hihiHihIihhHIHH",
        0x28F,  # SPC-130, revision 15
        info_at,
        len(_INFO),
        0,
        0,  # no set-up
        block_at,
        n_blocks,
        len(content),
        measured_at,
        1,
        _MEASURED_BYTES,
        0x5555,
        1,
        0,
        0x55AA,
    )
    image = header + _INFO + bytes(measured)
    for _ in range(n_blocks):
        start = len(image) + struct.calcsize("<BBIIHhII")
        end = start + len(content)
        image += struct.pack("<BBIIHhII", 0, 0, start, end, 0x0001, 0, 0, len(content)) + content
    return image

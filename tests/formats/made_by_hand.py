"""Small files of formats that only vendors write, put together byte by byte."""

from __future__ import annotations

import io
import struct
import zipfile

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
    return _ptu_of(items, records)


def ptu_image_bytes(codes: np.ndarray) -> bytes:
    """A scanned image (rows, columns, photons of a pixel) of a PicoHarp, with marks of lines."""
    rows, columns = codes.shape[:2]
    per_pixel = 10  # syncs
    words, now = [], 0
    for row in codes:
        words.append(_mark(1, now))
        for column, pixel in enumerate(row):
            words += [1 << 28 | int(code) << 16 | now + column * per_pixel + 1 for code in pixel]
        now += columns * per_pixel
        words.append(_mark(2, now))
        now += 5
    words.append(_mark(4, now))
    items: list[tuple[str, int | float | str | None]] = [
        ("Measurement_Mode", 3),
        ("Measurement_SubMode", 3),
        ("ImgHdr_Dimensions", 3),
        ("ImgHdr_PixX", columns),
        ("ImgHdr_PixY", rows),
        ("ImgHdr_LineStart", 1),
        ("ImgHdr_LineStop", 2),
        ("ImgHdr_Frame", 3),
        ("HW_Type", "PicoHarp"),
        ("HW_InpChannels", 2),
        ("MeasDesc_GlobalResolution", 5e-8),
        ("MeasDesc_Resolution", 1.6e-11),
        ("TTResult_SyncRate", 20_000_000),
        ("TTResult_NumberOfRecords", len(words)),
        ("TTResultFormat_TTTRRecType", 0x00010303),
        ("TTResultFormat_BitsPerRecord", 32),
        ("Header_End", None),
    ]
    return _ptu_of(items, np.array(words, "<u4"))


def _mark(number: int, sync: int) -> int:
    return 0xF << 28 | number << 16 | sync


def _ptu_of(items: list[tuple[str, int | float | str | None]], records: np.ndarray) -> bytes:
    header = b"PQTTTR\0\0" + b"1.0.00\0\0" + b"".join(_tag(*item) for item in items)
    return header + records.tobytes()


def with_fewer_records(content: bytes, n_records: int) -> bytes:
    """The start of a .ptu of an instrument, whose header says so."""
    at = content.index(b"TTResult_NumberOfRecords")
    end = content.index(b"Header_End") + 48
    short = bytearray(content[: end + 4 * n_records])
    struct.pack_into("<q", short, at + 40, n_records)
    return bytes(short)


_INFO = b"*IDENTIFICATION\r\n  ID        : SPC Setup & Data File\r\n*END\r\n\r\n"
_MEASURED_BYTES = 512
_HEADER, _BLOCK = "<hihiHihIihhHIHH", "<BBIIHhII"
_IMAGE_AT = 309
_TAC_RANGE_AT, _TAC_GAIN_AT, _CODES_AT, _MODULE_AT = 64, 68, 82, 117


def sdt_bytes(
    decays: np.ndarray, *, tac_range_s: float = 5e-8, n_blocks: int = 1, packed: bool = False
) -> bytes:
    """Decays (curves, codes) of an SPC module: header, text, description, blocks."""
    measured = bytearray(_MEASURED_BYTES)
    struct.pack_into("<f", measured, _TAC_RANGE_AT, tac_range_s)
    struct.pack_into("<h", measured, _TAC_GAIN_AT, 1)
    struct.pack_into("<h", measured, _CODES_AT, decays.shape[1])
    struct.pack_into("<7s", measured, _MODULE_AT, b"SPC-130")
    content = decays.astype("<u2").tobytes()
    info_at = struct.calcsize(_HEADER)
    measured_at = info_at + len(_INFO)
    block_at = measured_at + _MEASURED_BYTES
    header = struct.pack(
        _HEADER,
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
        image += _block(len(image), content, packed=packed)
    return image


def _block(start: int, content: bytes, *, packed: bool) -> bytes:
    """Decays, or a zip of them, behind a header that says where they are."""
    stored = _zip_of(content) if packed else content
    start += struct.calcsize(_BLOCK)
    kind = 0x1001 if packed else 0x0001
    return struct.pack(_BLOCK, 0, 0, start, start + len(stored), kind, 0, 0, len(content)) + stored


def _zip_of(content: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data_block", content)
    return out.getvalue()


def with_fewer_pixels(content: bytes, counts: np.ndarray) -> bytes:
    """A .sdt of an instrument with another image, 8 x 8 pixels, in place of its own."""
    header = struct.unpack_from(_HEADER, content)
    block_at, measured_at = header[5], header[8]
    short = bytearray(content[:block_at])
    struct.pack_into("<ii", short, measured_at + _IMAGE_AT, 8, 8)
    return bytes(short) + _block(block_at, counts.astype("<u2").tobytes(), packed=True)


def spc_bytes(codes: np.ndarray, channels: np.ndarray) -> bytes:
    """Photons of an SPC-130 behind its header; now and then an overflow and a mark."""
    words, macro = [0x8000005F], 0
    for number, (code, channel) in enumerate(zip(codes.tolist(), channels.tolist(), strict=True)):
        macro += 977
        if macro > 0xFFF:
            words.append(0xC0000000 | macro >> 12)
            macro &= 0xFFF
        if number % 50 == 7:
            words.append(0x90000000 | macro)
        words.append((4095 - code) << 16 | channel << 12 | macro)
    return np.array(words, "<u4").tobytes()

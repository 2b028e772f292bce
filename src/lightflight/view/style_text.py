"""Numbers as words: significant digits, true minus signs, values with their errors.

No Matplotlib here: the page uses these too.
"""

from __future__ import annotations

import numpy as np


def number(value: float | None, digits: int = 3, *, sign: bool = False) -> str:
    """`value` with so many significant digits, a true minus sign and no exponent for 1e-4…1e6."""
    if value is None or not np.isfinite(value):
        return "\u2013"
    if value == 0:
        return "0"
    size = abs(value)
    if 1e-4 <= size < 1e7:
        places = max(0, digits - 1 - int(np.floor(np.log10(size))))
        text = f"{size:,.{places}f}" if size >= 10_000 else f"{size:.{places}f}"
        text = text.replace(",", "\u2009")
    else:
        text = f"{size:.{digits - 1}e}"
    return ("\u2212" if value < 0 else "+" if sign else "") + text


def with_error(value: float | None, error: float | None) -> str:
    """`value ± error`, the error with two significant digits; without one, six of the value."""
    if value is None or not np.isfinite(value):
        return "\u2013"
    if error is None or not np.isfinite(error) or error <= 0:
        return number(value, 6)
    places = min(9, max(0, 1 - int(np.floor(np.log10(error)))))
    text = f"{abs(value):.{places}f} \u00b1 {error:.{places}f}"
    return ("\u2212" if value < 0 else "") + text

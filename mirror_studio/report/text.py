"""Numbers and specification sections as text that a reader can read; and the templates that text goes into."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from mirror_cad.laws.words import plain

MISSING = "—"
NARROW_SPACE = "\u202f"
CLOSE_UNITS = ("°", "′", "″")
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
POINT_DECIMALS = 2  # mm: the presets' deviations at the printed points are the printed ones to their three digits
# Outside this range a number is written with a power of ten.
SMALLEST_PLAIN, LARGEST_PLAIN = 1e-3, 1e7
USUAL_DIGITS = 3
MAX_DIGITS, MAX_DECIMALS = 17, 28  # a double has no more digits; nor does a figure that is told to so many decimals


def number(value: Any, digits: int = USUAL_DIGITS, sign: bool = False) -> str:
    """A value to `digits` significant digits: 0.0123, −4.64, 68 985, 4.9·10⁻⁸; a dash where there is none."""
    if value is None or isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        return MISSING
    before = "−" if value < 0 else "+" if sign and value > 0 else ""
    size = abs(float(value))
    if math.isinf(size):
        return before + "∞"
    if size == 0.0:
        return "0"
    rounded = float(f"{size:.{digits - 1}e}")
    exponent = math.floor(math.log10(rounded))
    if SMALLEST_PLAIN <= rounded < LARGEST_PLAIN:
        return before + _grouped(size, max(0, digits - 1 - exponent))
    mantissa, power = f"{size:.{_digits_with_power(digits) - 1}e}".split("e")
    return f"{before}{mantissa}·10{str(int(power)).translate(SUPERSCRIPT)}"


def fixed(value: Any, decimals: int, sign: bool = False) -> str:
    """A value to so many decimals: 44.82; a dash where there is none."""
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        return MISSING
    text = _grouped(abs(value), decimals)
    zero = not text.strip("0.")
    return ("" if zero else "−" if value < 0 else "+" if sign else "") + text


def with_unit(value: Any, unit: str, digits: int = 3, sign: bool = False) -> str:
    """`number` with its unit, which a missing value does without."""
    return _joined(number(value, digits, sign), unit)


def fixed_with_unit(value: Any, unit: str, decimals: int) -> str:
    """`fixed` with its unit, which a missing value does without."""
    return _joined(fixed(value, decimals), unit)


def given(value: float, unit: str) -> str:
    """A value that somebody asked for, in the digits it was asked in: 3 %, 0.01 %, 10⁻⁵ mm."""
    mantissa, power = f"{value:.6e}".split("e")
    if SMALLEST_PLAIN <= abs(value) < LARGEST_PLAIN:
        return _joined(plain(value), unit)
    factor = mantissa.rstrip("0").rstrip(".")
    return _joined(f"{'' if factor == '1' else factor + '·'}10{str(int(power)).translate(SUPERSCRIPT)}", unit)


def decimals_telling(value: float, limit: float, met: bool, decimals: int) -> int:
    """Decimals, `decimals` at least, to which a value is rounded on the side of its limit on which it is.

    4.6413 beside a limit of 4.641 is not "4.64". A value that meets its limit may be rounded onto it; one that misses it may
    not.
    """
    return _telling(value, limit, met, range(decimals, MAX_DECIMALS + 1), lambda size, n: round(size, n))


def digits_telling(value: float, limit: float, met: bool, digits: int) -> int:
    """The same for `number`: significant digits, `digits` at least."""
    return _telling(value, limit, met, range(digits, MAX_DIGITS + 1), _shown)


def _telling(value: float, limit: float, met: bool, counts: range, rounded: Callable[[float, int], float]) -> int:
    if not (math.isfinite(value) and math.isfinite(limit)):
        return counts[0]
    for n in counts:
        shown = rounded(value, n)
        if ((shown > limit) == (value > limit) and (shown < limit) == (value < limit)) or (met and shown == limit):
            return n
    return counts[-1]


def count(value: Any) -> str:
    """A whole number in groups of three: 15 000 000; a dash where there is none."""
    return MISSING if value is None else _grouped(float(value), 0)


def point_in_words(xy: Sequence[float] | None) -> str:
    """A point on the mirror: “x 88.12, y −161.06”, in mm."""
    return MISSING if xy is None else ", ".join(f"{axis}{NARROW_SPACE}{fixed(value, POINT_DECIMALS)}"
                                                for axis, value in zip("xy", xy, strict=True))


def lane_in_words(lane: Mapping[str, float]) -> str:
    """The lane of a specification's scene: “Y = 2400 + 0.6·X”."""
    offset, slope = lane["x0_mm"], lane["slope"]
    across = "X" if offset == 0.0 else f"(X {'−' if offset > 0 else '+'} {plain(abs(offset))})"
    return f"Y = {plain(lane['y0_mm'])} {'−' if slope < 0 else '+'} {plain(abs(slope))}·{across}"


def css_text(text: str) -> str:
    """Text as a CSS string may hold it: all but letters and digits as escapes."""
    return "".join(letter if letter.isascii() and letter.isalnum() else f"\\{ord(letter):x} " for letter in text)


@cache
def templates() -> Environment:
    """The page templates, with the functions above as filters. User text is escaped."""
    environment = Environment(loader=FileSystemLoader(Path(__file__).parent / "templates"), autoescape=True,
                              undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"number": number, "with_unit": with_unit, "count": count, "given": given, "css_text": css_text}
    return environment


def _digits_with_power(digits: int) -> int:
    """Two digits are enough of what is only to be known as small or large, unless more than usual are asked for."""
    return digits if digits > USUAL_DIGITS else 2


def _shown(value: float, digits: int) -> float:
    """What `number` shows of a value."""
    rounded = float(f"{value:.{digits - 1}e}")
    if SMALLEST_PLAIN <= abs(rounded) < LARGEST_PLAIN:  # to a whole number at the least, whatever its digits
        return float(f"{value:.{max(0, digits - 1 - math.floor(math.log10(abs(rounded))))}f}")
    return float(f"{value:.{_digits_with_power(digits) - 1}e}")


def _joined(text: str, unit: str) -> str:
    if text == MISSING:
        return text
    return text + unit if unit in CLOSE_UNITS else f"{text}{NARROW_SPACE}{unit}"


def _grouped(size: float, decimals: int) -> str:
    text = f"{size:,.{decimals}f}"
    # Four digits before the point read well without a gap, and a radius in mm has four.
    return text.replace(",", "" if size < 9999.5 else NARROW_SPACE)

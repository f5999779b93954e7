"""Owns numbers on a command line: those that C's strtod reads, negative ones included."""

import math
import re
from argparse import ArgumentTypeError
from decimal import Decimal

__all__ = [
    "finite_number",
    "is_negative_number",
    "nanoseconds",
    "non_negative_number",
    "number",
    "positive_number",
]

# ISO C, 7.22.1.3, in the locale "C".
_NUMBER = re.compile(
    r"""[ \t\n\v\f\r]*
    (?P<sign>[+-]?)
    (?: (?P<hexadecimal> 0x (?: [0-9a-f]+ \.? [0-9a-f]* | \. [0-9a-f]+ ) (?: p [+-]? [0-9]+ )? )
      | (?P<decimal> (?: [0-9]+ \.? [0-9]* | \. [0-9]+ ) (?: e [+-]? [0-9]+ )? )
      | (?P<infinity> inf (?: inity )? )
      | nan (?: \( [0-9a-z_]* \) )? )""",
    re.VERBOSE | re.IGNORECASE | re.ASCII,
)


def number(text: str) -> float:
    """
    Read a number as C's strtod does, for argparse.

    :raises ArgumentTypeError: the text, or its end, is no number.
    """
    read = _NUMBER.fullmatch(text)
    if read is None:
        raise ArgumentTypeError(f"{text!r} is not a number")
    if read["hexadecimal"]:
        try:
            size = float.fromhex(read["hexadecimal"])
        except OverflowError:
            size = math.inf
    elif read["decimal"]:
        size = float(read["decimal"])
    else:
        size = math.inf if read["infinity"] else math.nan
    return math.copysign(size, -1.0 if read["sign"] == "-" else 1.0)


def finite_number(text: str) -> float:
    """The same; infinity and NaN are refused."""
    value = number(text)
    if not math.isfinite(value):
        raise ArgumentTypeError(f"must be finite, not {text}")
    return value


def positive_number(text: str) -> float:
    """A finite number above 0."""
    value = finite_number(text)
    if value <= 0.0:
        raise ArgumentTypeError(f"must be above 0, not {text}")
    return value


def non_negative_number(text: str) -> float:
    """A finite number that is 0 or above."""
    value = finite_number(text)
    if value < 0.0:
        raise ArgumentTypeError(f"must not be negative, it is {text}")
    return value


def nanoseconds(text: str) -> int:
    """Read seconds, as nanoseconds: exactly, where a float would not hold the digits of a stamp."""
    value = finite_number(text)
    read = _NUMBER.fullmatch(text)
    exact = Decimal(text.strip()) if read is not None and read["decimal"] else Decimal(value)
    return round(exact * 10**9)


def is_negative_number(text: str) -> bool:
    """Whether the text is a number that begins with a minus."""
    return text.startswith("-") and _NUMBER.fullmatch(text) is not None

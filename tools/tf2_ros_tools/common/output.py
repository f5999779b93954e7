# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Format texts, print lines and write files, in the same way for all tools."""

import json
import os
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from typing import Any

from tf2_py.atomic_files import whole_file
from tf2_py.printable import printable

MOST_NAMES = 5  # in a list


def show(*lines: str) -> None:
    """Print lines, without characters that could steer a terminal or begin another line."""
    print("\n".join(map(printable, lines)))


def show_json(content: Any) -> None:
    """Print an object as one line of JSON."""
    # json leaves the delete character as it is, whose usual escape is not JSON.
    print(json.dumps(content).replace("\x7f", r"\u007f"))


def three_digits(number: float) -> str:
    """Format a number with three significant digits, or from 100 on as a whole number."""
    return f"{number:.0f}" if abs(number) >= 100.0 else f"{number:.3g}"


YEAR_S, DAY_S = 365.25 * 86400.0, 86400.0


def span(seconds: float) -> str:
    """Format how long something lasts: in seconds, from a day on in days, from a year on in years."""
    for unit, size in (("year", YEAR_S), ("day", DAY_S)):
        if abs(seconds) >= size:
            number = three_digits(seconds / size)
            return f"{number} {unit}" if number == "1" else f"{number} {unit}s"
    return f"{three_digits(seconds)} s"


def first_names(names: Sequence[str]) -> str:
    """Format the first five names: ``a, b, c, d, e and 3 more``."""
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"{', '.join(map(printable, names[:MOST_NAMES]))}{more}"


def not_known(name: str, known: Collection[str], kind: str = "") -> str:
    """Say that a frame, or one of this ``kind``, is unknown, and suggest similar names."""
    near = get_close_matches(name, {*known} - {name}, n=3)
    advice = f"; did you mean {' or '.join(near)}?" if near else ""
    return printable(f"there is no frame {name}{kind and f' {kind}'}{advice}")


def write_whole(path: str | os.PathLike[str], data: bytes | memoryview) -> None:
    """
    Replace a file in one step, so that a reader finds either the old contents or all of the new ones.

    :raises OSError: the file cannot be written; its old contents remain.
    """
    with whole_file(path) as file:
        file.write(data)

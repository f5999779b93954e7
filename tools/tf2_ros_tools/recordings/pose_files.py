# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Read files of poses with stamps: tables whose columns are known, as TUM's and EuRoC's, and KITTI's.

Nothing is guessed. Either a user names the columns, or a heading does so in a few spellings, or the rows are
those of TUM, 8 numbers between spaces; what may mean something else is refused.
"""

from __future__ import annotations

import os
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Context
from math import isfinite, nan
from os import PathLike
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_py.printable import printable
from tf2_ros.numpy import to_arrays
from tf2_ros_tools.recordings.bag_reader import BagError

S = 1_000_000_000
LAST_NS = 2**31 * S - 1  # the latest time that the stamp of a message can hold
NOT_SECONDS = 1e11  # in seconds, this is after the year 5000

MOST_CHARACTERS = 1 << 14  # of a line: a file of another kind is refused without being read whole
MOST_ROWS = 10_000_000  # of 72 bytes each
QUOTED = 80  # characters of a line or a name in an error

# A rotation whose numbers have two decimals differs by less from one of length 1.
ROUNDED = 0.1

# What a number of a row is.
Roles: TypeAlias = tuple[str, ...]
STAMP, SECONDS, NANOSECONDS, VALID = "timestamp", "sec", "nsec", "valid"
TUM = (STAMP, "x", "y", "z", "qx", "qy", "qz", "qw")
KITTI = tuple(f"row {row}, column {column}" for row in "123" for column in "1234")
TIMES = (STAMP,)


@dataclass(frozen=True)
class StampedPoses:
    """
    N poses, as they stand in a file or were recorded on a topic.

    :param name: the file, or the recording and the topic; for errors.
    :param of: what ``numbers`` counts from 1, such as ``line``.
    :param numbers: where each pose stands, int64, shape (N,).
    :param times_ns: int64, shape (N,).
    :param translations: meters, shape (N, 3).
    :param rotations: x y z w, shape (N, 4).
    """

    name: str
    of: str
    numbers: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    translations: NDArray[np.float64]
    rotations: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.times_ns)

    def check(self, advice: str = "") -> None:
        """
        Check that all numbers are finite, all rotations have the length 1, and stamps can hold all times.

        :param advice: the end of the error of a rotation.
        :raises BagError: one is not.
        """
        with np.errstate(over="ignore"):
            lengths = np.sqrt((self.rotations**2).sum(axis=1))
        is_finite = np.array(np.isfinite(self.translations).all(axis=1))
        is_turn = np.abs(lengths - 1.0) < ROUNDED
        is_good = is_finite & is_turn & (self.times_ns >= 0) & (self.times_ns <= LAST_NS)
        for i in np.flatnonzero(~is_good)[:1].tolist():
            if not is_finite[i]:
                reason = f"expected a position of finite numbers, got {self.translations[i].tolist()}"
            elif not is_turn[i]:
                reason = f"expected a rotation of length 1, got the length {lengths[i]:.3g}{advice}"
            else:
                reason = f"the stamp of a message cannot hold {self.times_ns[i]} ns"
            raise BagError(f"{self.place(i)}: {reason}")

    def place(self, *indices: int) -> str:
        """Say where some poses stand: ``poses.txt, lines 3 and 7``."""
        numbers = " and ".join(str(self.numbers[one]) for one in indices)
        return f"{self.name}, {self.of}{'s' * (len(indices) > 1)} {numbers}"


def read_table(path: str | PathLike[str], columns: str | None = None) -> StampedPoses:
    """
    Read a table with a row for each pose, in any order.

    :param columns: the names of all columns, as for :func:`columns_of`; a heading is skipped. None: those of
        the heading, or, without one, the stamp in seconds and x y z qx qy qz qw.
    :raises OSError: the file cannot be read.
    :raises BagError: it is not such a table; the text has the file, the line and a remedy.
    """
    table = _read(path, TUM, None if columns is None else columns_of(columns))
    numbers = table.values[:, :3], table.values[:, 3:]
    poses = StampedPoses(table.name, "line", table.lines, table.times_ns, *numbers)
    poses.check("" if columns else _remedy(TUM, len(TUM)))
    return poses


def read_kitti(path: str | PathLike[str], times_ns: NDArray[np.int64], of: str) -> StampedPoses:
    """
    Read the format of KITTI: lines of 12 numbers, the first three rows of a matrix.

    :param times_ns: the stamp of each.
    :param of: where these are from.
    :raises OSError, BagError: see :func:`read_table`; or the number of stamps is another.
    """
    table = _read(path, KITTI)
    if len(table.lines) != len(times_ns):
        raise BagError(
            f"expected a stamp for each of the {len(table.lines)} poses in {table.name},"
            f" got {len(times_ns)} in {of}"
        )
    matrices = table.values.reshape(-1, 3, 4)
    turns = matrices[:, :, :3]
    with np.errstate(all="ignore"):  # huge numbers
        defects = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        bad = np.flatnonzero(~(defects < ROUNDED) | ~(np.linalg.det(turns) > 0.0))
    if bad.size:
        line = table.lines[bad[0]]
        raise BagError(f"{table.name}, line {line}: the numbers are not a rotation matrix and a position")
    # To the nearest rotation, because the numbers are rounded.
    left, _, right = np.linalg.svd(turns)
    whole = np.tile(np.eye(4), (len(turns), 1, 1))
    whole[:, :3, :3], whole[:, :3, 3] = left @ right, matrices[:, :, 3]
    return StampedPoses(table.name, "line", table.lines, times_ns, *to_arrays(whole))


def read_times(path: str | PathLike[str]) -> NDArray[np.int64]:
    """
    Read a file with a stamp in each line: in seconds, or in the unit that its heading names.

    :return: nanoseconds, int64, shape (N,).
    :raises OSError, BagError: see :func:`read_table`.
    """
    return _read(path, TIMES).times_ns


# The names of columns.

UNITS = {"ns": 1, "us": 1_000, "ms": 1_000_000, "s": S}
# In lower case. A column with another name is not needed: if it is, one that is needed is missing.
SPELLINGS = {
    STAMP: r"(timestamp|time|t|stamp)(_[num]?s|\s*[\[(][num]?s[\])])?",
    **{axis: rf"((t|p|pos|position)?[_.]?|p_rs_r_){axis}(\s*[\[(]m[\])])?" for axis in "xyz"},
    **{f"q{axis}": rf"((q|quat|rotation|orientation)[_.]?|q_rs_){axis}(\s*\[\])?" for axis in "xyzw"},
    **{role: role for role in (SECONDS, NANOSECONDS, VALID)},
}
NAMES = re.compile("|".join(f"(?P<{role}>{names})" for role, names in SPELLINGS.items()))
UNIT = re.compile(r"[_\[(]([num]?s)[\])]?")
SPACES = re.compile(r"\s+(?![\s\[(])(?![^\[(]{,20}[\])])")  # between names: not in front of a unit, nor in it
# The beginning of the only heading without units in which stamps are nanoseconds.
EUROC = "timestamp p_rs_r_x [m] p_rs_r_y [m] p_rs_r_z [m] q_rs_w [] q_rs_x [] q_rs_y [] q_rs_z []"
# A comment with such a word may name the columns or their units: it is understood, or the file is refused.
TIME_UNIT = r"[nuµm]s(ecs?)?|(nano|micro|milli)[a-z]+|min(utes?)?|hours?"
LENGTH_UNIT = r"[cmk]m|(centi|milli|kilo)[a-z]+|inch(es)?|feet|foot|ft|yards?|miles?"
LIKE_NAMES = {
    TUM: re.compile(
        rf"(?<![a-z])([a-z]?w|[wxyz]q|q([a-z\d]?|vec|[qwxyz\d]*)|(xyz)?(wxyz|xyzw)|scalar|real|rot[wxyz]?|{TIME_UNIT}|{LENGTH_UNIT})(?![a-z\d])"
        r"|quat|rotation|orientation"
        # As many words as a row has numbers.
        r"|^\W*(\w+:\s*)?([a-z/][^\s,;|]*(\s*[\[(].*?[\])])?[\s,;|]+){7}[a-z/][^\s,;|]*$"
        r"|(\S*\w[_/]\w\S*[\s,;|]+){2}\S*\w[_/]\w",  # words like pos_x or pose/x
        re.I,
    ),
    TIMES: re.compile(rf"time|stamp|(?<![a-z])(secs?|seconds?|s|d?t|{TIME_UNIT})(?![a-z])", re.I),
    KITTI: re.compile(rf"(?<![a-z])(r_?\d\d|{LENGTH_UNIT})(?![a-z\d])", re.I),
}
# Another column of a heading with such a name may be a part of the stamp, or select poses.
DOUBTFUL = re.compile(
    r"time|stamp|valid|success|fail|lost|good|track(ed|ing)|stat(e|us)|accept|reject|flag|quality|usable|ignore"
    r"|skip|enabled|converged|healthy|initialized|has_pose|t_s$|^\W*(s|d?t|fix)\W*$"
    rf"|(?<![a-z])((is)?ok|bad|(in|out)lier|date|doy|utc|(sec(ond)?|day|week|month|year)s?|{TIME_UNIT})(?![a-z])"
    r"|^\W*(child|parent|source|robot|(rigid_?)?body|agent|device|object|vehicle)(_frame)?(_id|_name)?\W*$|frame_id"
)
ANGLE = re.compile(r"roll|pitch|yaw|theta|euler|heading")
IN_BRACKETS = re.compile(r"[\[(].*?[\])]")
EXAMPLE, MORE = "timestamp x y z qx qy qz qw", "..."


class Layout(NamedTuple):
    """
    The columns of a table, ``width`` of them.

    ``places`` are the indices of those that are needed, ``unit`` is that of the stamp in ns; None: nothing
    says it, so it is a second. ``nanoseconds`` is the index of the rest of a stamp in whole seconds,
    ``valid`` that of the column that says whether a row has a pose. ``has_more``: others follow.
    """

    width: int
    places: tuple[int, ...]
    unit: int | None = None
    nanoseconds: int | None = None
    valid: int | None = None
    has_more: bool = False


def columns_of(columns: str) -> Layout:
    """
    Understand the names that a user gives to all columns, such as ``timestamp_us - x y z qw qx qy qz ...``.

    :raises ValueError: one is neither known nor ``-``, or is missing or there twice.
    """
    names = SPACES.split(columns.replace(",", " ").strip())
    has_more = names[-1] == MORE
    names = names[: len(names) - has_more]
    for name in names:
        if name != "-" and not NAMES.fullmatch(name.lower()):
            like = f"names like {EXAMPLE}, or - for a column that is not needed, or {MORE} at the end"
            raise ValueError(f"columns: expected {like}, got {_quoted(name)}")
    try:
        return _layout(names, TUM)._replace(has_more=has_more)
    except ValueError as error:
        raise ValueError(f"columns: {error}") from None


def _layout(names: Sequence[str], needed: Roles) -> Layout:
    names = [one.strip("\"' ").lower() for one in names]
    roles = [found.lastgroup if (found := NAMES.fullmatch(one)) else None for one in names]
    is_split = NANOSECONDS in roles
    if STAMP in roles and (is_split or SECONDS in roles):
        raise ValueError(f"expected one column for {STAMP}, or {SECONDS} and {NANOSECONDS}, got both")
    roles = [STAMP if is_split and one == SECONDS else one for one in roles]
    for role in (*needed, *{NANOSECONDS, VALID}.intersection(roles)):
        if (count := roles.count(role)) != 1:
            advice = "; poses with angles must be arrays" * any(map(ANGLE.search, names))
            raise ValueError(f"expected one column for {role}, got {count or 'none'}{advice}")
    places = tuple(map(roles.index, needed))
    is_euroc = " ".join(names).startswith(EUROC)
    unit = UNIT.search("_s" if is_split else names[places[0]] + "_ns" * is_euroc)
    rest, valid = (roles.index(one) if one in roles else None for one in (NANOSECONDS, VALID))
    return Layout(len(names), places, unit and UNITS[unit[1]], rest, valid)


def _of_heading(heading: str, separator: str | None, first: Sequence[str], needed: Roles) -> Layout:
    """Understand the heading of rows with this separator, of which the ``first`` has these fields."""
    text = heading.strip("#%/ ")
    own = separator if separator and separator in text else _separator(text)
    names = text.split(own) if own else SPACES.split(text)
    try:
        if len(names) != len(first):
            raise ValueError(f"expected names of the {len(first)} columns, got {len(names)}")
        if bool(names[-1].strip()) != bool(first[-1].strip()):  # it may be none, but a separator at the end
            raise ValueError("expected the last column to have a name and a value, or neither")
        named = [one for one in names if one not in ("", "-")]
        if len(named) > len({*named}):  # as of pos x pos y pos z between spaces
            raise ValueError("expected different names")
        layout = _layout(names, needed)
        for one in named:
            bare = one.strip("\"' ").lower()
            if not NAMES.fullmatch(bare) and DOUBTFUL.search(IN_BRACKETS.sub("", bare)):
                raise ValueError(f"the column {_quoted(one)} may be a part of the stamp, or select poses")
        return layout
    except ValueError as error:
        kind = "comment" if heading.startswith("#") else "heading"
        raise ValueError(f"the {kind} {_quoted(heading)}: {error}") from None


# Rows.

EXACT = Context(prec=60, traps=[])  # a float cannot hold all digits of a stamp
WHOLE = re.compile(r"\s*\d{1,10}\s*", re.A)
NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?\s*", re.I | re.A)
LIKE_NUMBER = re.compile(r"\W*(\d|nan\b|inf\b)", re.I)
EXPECTED = {
    TUM: "8 numbers, a stamp in seconds and x y z qx qy qz qw",
    KITTI: "12 numbers, the first three rows of a matrix",
    TIMES: "one number, a stamp in seconds",
}


class _Table(NamedTuple):
    """The N rows of a file: their lines, their stamps in ns if they have them, and the other numbers."""

    name: str
    lines: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    values: NDArray[np.float64]


def _read(path: str | PathLike[str], needed: Roles, given: Layout | None = None) -> _Table:
    """Read the numbers that are needed; ``given``: the columns, if a user has named them."""
    name, rows = printable(os.fspath(path)), _Rows(needed, given)
    lines, times_ns, values = array("q"), array("q"), array("d")
    for number, text in _lines(path, name):
        try:
            if (fields := rows.split(text)) is None:
                continue
            row = _numbers([fields[place] for place in rows.layout.places], needed)
            if needed[0] == STAMP:
                times_ns.append(_time_ns(row.pop(0), fields, rows.layout))
            if len(lines) == MOST_ROWS:
                raise ValueError(f"expected at most {MOST_ROWS:,} rows, got more")
        except ValueError as error:
            advice = "" if given else _remedy(needed, rows.width)
            raise BagError(f"{name}, line {number}: {error}{advice}") from None
        lines.append(number)
        values.extend(row)
    if not lines:
        raise BagError(f"{name}: expected lines of {EXPECTED[needed]}; there are none")
    return _Table(name, np.array(lines), np.array(times_ns), np.array(values).reshape(len(lines), -1))


def _lines(path: str | PathLike[str], name: str) -> Iterator[tuple[int, str]]:
    """Read the lines that are not empty, with their numbers."""
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(iter(lambda: file.readline(MOST_CHARACTERS), ""), 1):
            if "\0" in line:
                raise BagError(f"{name}, line {number}: expected a text in UTF-8, got binary data")
            if len(line) == MOST_CHARACTERS and line[-1] != "\n":
                raise BagError(f"{name}, line {number}: expected at most {MOST_CHARACTERS:,} characters")
            if not line.isspace():
                yield number, line.strip(" \n")  # an empty field may be between two tabs


class _Rows:
    """
    Split the lines of a file, from the first one on.

    ``layout`` is that of the rows, ``width`` the number of columns of the first one.
    """

    def __init__(self, needed: Roles, given: Layout | None) -> None:
        self._needed, self._given = needed, given
        self._heading: str | None = None
        self._separator: str | None = None
        self.layout = given or Layout(len(needed), tuple(range(len(needed))))
        self.width = 0

    def split(self, text: str) -> list[str] | None:
        """Get the fields of a row; None: the line is a comment, a heading, or a row without a pose."""
        if text.startswith("#"):
            if not self._given and LIKE_NAMES[self._needed].search(text) and text != self._heading:
                if self._heading or self.width:
                    raise ValueError(f"expected one heading, before the rows, got {_quoted(text)}")
                self._heading = text
            return None
        if not self.width:
            self._separator = _separator(text)
            if not self._heading and self._is_title(text):
                self._heading = text
                return None
            self._begin(text.split(self._separator))
        fields = text.split(self._separator)
        if text.startswith(("%", "//")):
            raise ValueError(f"expected a row, or a comment after #, got {_quoted(text)}")
        if len(fields) != self.layout.width:
            what = f"{self.layout.width} columns" if self._given or self._heading else EXPECTED[self._needed]
            raise ValueError(f"expected {what}, got {len(fields)}: {_quoted(text)}")
        return fields if self.layout.valid is None or _is_true(fields[self.layout.valid]) else None

    def _is_title(self, text: str) -> bool:
        """Whether the first line has names of columns (between commas, maybe too few) and no number."""
        fields = text.split(self._separator)
        is_wide = len(fields) >= self.layout.width or (not self._given and self._separator in (",", ";"))
        return is_wide and any(map(str.isalpha, text)) and not any(map(LIKE_NUMBER.match, fields))

    def _begin(self, first: Sequence[str]) -> None:
        """Find the layout, with the fields of the first row."""
        self.width = len(first)
        if self._given and self._given.has_more:
            self.layout = self._given._replace(width=max(self.width, self._given.width))
        elif self._heading and not self._given:
            self.layout = _of_heading(self._heading, self._separator, first, self._needed)
        elif self._needed == TUM and self._separator in (",", ";") and not self._given:
            raise ValueError("expected a heading, or spaces between numbers, as in TUM's format")


def _separator(text: str) -> str | None:
    """What is between the columns; None: spaces."""
    return next((one for one in ",;\t" if one in text), None)


def _is_true(text: str) -> bool:
    if (word := text.strip().lower()) not in ("true", "false"):
        raise ValueError(f"{VALID}: expected true or false, got {_quoted(text)}")
    return word == "true"


def _numbers(texts: Sequence[str], roles: Roles) -> list[float]:
    try:
        row = [*map(float, texts)]
    except ValueError:
        row = [nan]
    # Python's floats may also be 1_000, nan, or have digits of other scripts.
    joined = "".join(texts)
    if "_" in joined or not joined.isascii() or not isfinite(sum(row)):
        for role, text in zip(roles, texts, strict=True):
            if not NUMBER.fullmatch(text) or not isfinite(float(text)):
                raise ValueError(f"{role}: expected a finite number, got {_quoted(text)}")
    return row


def _time_ns(value: float, fields: Sequence[str], layout: Layout) -> int:
    """:param value: the number in the field of the stamp, which a float does not hold exactly."""
    text, scale = fields[layout.places[0]].strip(), layout.unit or S
    if value < 0.0:
        raise ValueError(f"expected a stamp of 0 or more, got {_shortened(text)}")
    if layout.unit is None and value >= NOT_SECONDS:
        raise ValueError(f"the stamp {_shortened(text)} is not in seconds (name it timestamp_ns, _us or _ms)")
    if scale == UNITS["ns"] and not value.is_integer():
        raise ValueError(f"the stamp {_shortened(text)} is not in nanoseconds")
    is_held = value * scale < LAST_NS + S  # about, because a float is not exact
    time_ns = round(EXACT.multiply(EXACT.create_decimal(text), scale)) if is_held else LAST_NS + 1
    if layout.nanoseconds is not None:
        rest = fields[layout.nanoseconds]
        if not (value.is_integer() and WHOLE.fullmatch(rest) and int(rest) < S):
            raise ValueError(f"expected seconds and ns below 10^9, got {_shortened(f'{text} and {rest}')}")
        time_ns += int(rest)
    if time_ns > LAST_NS:
        raise ValueError(f"the stamp {_shortened(text)} is more than messages hold: {value * scale / S:g} s")
    return time_ns


# Texts.


def _remedy(needed: Roles, width: int) -> str:
    """Say what to do about a file of ``width`` columns that is not understood."""
    if needed == KITTI:
        return ""
    if needed == TIMES:
        names = " ".join([STAMP, *"-" * min(width - 1, 9)])
        return f'; name all columns in a first line, such as "{names}", or pass an array'
    kitti = "; KITTI's poses need `times` or --trajectory-times" * (width == len(KITTI))
    names = EXAMPLE + f" {MORE}" * (width > len(TUM))
    return f'{kitti}; to say what all columns are, pass `columns` or --trajectory-columns, such as "{names}"'


def _quoted(text: str) -> str:
    return repr(_shortened(text))


def _shortened(text: str) -> str:
    shown = printable(text[: QUOTED + 1])
    return shown if len(shown) <= QUOTED else f"{shown[:QUOTED]}…"

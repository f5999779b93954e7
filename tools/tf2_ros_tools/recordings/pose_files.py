# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read files of poses with stamps: tables with or without a heading, as TUM's and EuRoC's, and KITTI's."""

from __future__ import annotations

import os
import re
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
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

# A file of another kind is refused without being read whole.
MOST_CHARACTERS = 1 << 14  # of a line
MOST_BEFORE_ROWS = 1 << 20  # characters
MOST_ROWS = 10_000_000  # of 72 bytes each
QUOTED = 80  # characters of a line or a name in an error
MOST_LISTED = 8  # names in an error

# A rotation whose numbers have two decimals differs by less from one of length 1.
ROUNDED = 0.1

# What a number of a row is.
Roles: TypeAlias = tuple[str, ...]
STAMP, NANOSECONDS, VALID = "stamp", "nanoseconds", "valid"
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
TUM = (STAMP, *POSE)
KITTI = tuple(f"{row}{column}" for row in "123" for column in "1234")
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


def read_table(path: str | PathLike[str]) -> StampedPoses:
    """
    Read a table with a row for each pose, in any order.

    Columns are separated by commas or white space. Without a heading, they are the stamp in seconds and
    x y z qx qy qz qw. Lines that begin with ``#`` are comments, except for a heading.

    :raises OSError: the file cannot be read.
    :raises BagError: it is not such a table; the text has the file, the line and a remedy.
    """
    table = _read(path, TUM)
    numbers = table.values[:, :3], table.values[:, 3:]
    poses = StampedPoses(table.name, "line", table.lines, table.times_ns, *numbers)
    poses.check("" if table.has_heading else f"; if the columns have another order, {_add_heading()}")
    return poses


def read_kitti(path: str | PathLike[str], times: str | PathLike[str]) -> StampedPoses:
    """
    Read the format of KITTI: lines of 12 numbers, the first three rows of a matrix.

    :param times: a file with the stamp of each; see :func:`read_times`.
    :raises OSError, BagError: see :func:`read_table`; or the files have different numbers of rows.
    """
    table, stamps = _read(path, KITTI), _read(times, TIMES)
    if len(table.lines) != len(stamps.lines):
        raise BagError(
            f"expected a stamp for each of the {len(table.lines)} poses in {table.name},"
            f" got {len(stamps.lines)} in {stamps.name}"
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
    return StampedPoses(table.name, "line", table.lines, stamps.times_ns, *to_arrays(whole))


def read_times(path: str | PathLike[str]) -> NDArray[np.int64]:
    """
    Read a file with a stamp in each line: in seconds, or in the unit that its heading names.

    :return: nanoseconds, int64, shape (N,).
    :raises OSError, BagError: see :func:`read_table`.
    """
    return _read(path, TIMES).times_ns


# Headings.

# Nanoseconds in the units of a stamp, and meters in those of a position.
TIME_UNITS = {
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanos", "nanoseconds"), 1.0),
    **dict.fromkeys(("us", "\u00b5s", "\u03bcs", "usec", "usecs", "microsec", "micros", "microseconds"), 1e3),
    **dict.fromkeys(("ms", "msec", "msecs", "millisec", "millis", "milliseconds"), 1e6),
    **dict.fromkeys(("s", "sec", "secs", "seconds"), 1e9),
}
LENGTH_UNITS = {"m": 1.0, "meters": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3}
NO_UNITS = {"-": 1.0, "1": 1.0}
UNITS = {**dict.fromkeys((STAMP, NANOSECONDS), TIME_UNITS), **dict.fromkeys(POSE[:3], LENGTH_UNITS)}

# The names of columns, in lower case and without units. Dots separate the fields of messages.
STAMPS = re.compile(r"time|timestamp|t|ts|stamp|(\w+\.)*header\.stamp")
POSITIONS = re.compile(r"(?:t|p|pos|position|translation|p_\w+|(?:\w+\.)*position)?[_.]?([xyz])")
ROTATIONS = re.compile(r"(?:q|quat|quaternion|rotation|orientation|q_\w+|(?:\w+\.)*orientation)[_.]?([xyzw])")
# A stamp in two columns: whole seconds, and the rest.
PART = re.compile(rf"(?P<stem>(\w*[./])*(stamp|timestamp|time|ts|t)[._/])?(?P<unit>{'|'.join(TIME_UNITS)})")
LIKE_STAMP = re.compile("time|stamp", re.I)
OF_EUROC = re.compile(r"p_[a-z]+_[a-z]+_[xyz]")  # a format in which stamps are nanoseconds
LONGEST_NAME = 100

EXAMPLE, W_FIRST = "timestamp tx ty tz qx qy qz qw", "timestamp tx ty tz qw qx qy qz"
_SHOWN = dict(zip(TUM, EXAMPLE.split(), strict=True)) | {
    one: f"row {one[0]}, column {one[1]}" for one in KITTI
}


class _Column(NamedTuple):
    """
    A column of a heading, and what its name means; without a role, it is not needed.

    ``stem`` is what both parts of a stamp have in common: ``stamp_`` of ``stamp_nsec``, ``""`` of ``nsec``;
    None: it is no such part.
    """

    name: str
    role: str = ""
    unit: str = ""
    stem: str | None = None

    @property
    def is_seconds(self) -> bool:
        return self.stem is not None and TIME_UNITS[self.unit] == S


def _column(name: str) -> _Column:
    short = _short(name)
    if short == VALID:
        return _Column(name, VALID)
    if len(short) > LONGEST_NAME:
        return _Column(name)
    if (found := PART.fullmatch(short)) and (found["stem"] or len(short) > len("ns")):  # s alone is anything
        stem, unit = found["stem"] or "", found["unit"]
        return _Column(name, STAMP if stem or TIME_UNITS[unit] == S else NANOSECONDS, unit, stem)
    short, unit = _without_unit(short)
    if STAMPS.fullmatch(short):
        return _Column(name, STAMP, unit)
    if found := POSITIONS.fullmatch(short):
        return _Column(name, found[1], unit)
    if found := ROTATIONS.fullmatch(short):
        return _Column(name, f"q{found[1]}", unit)
    return _Column(name)


def _short(name: str) -> str:
    return name.strip("\"' ").lstrip("#% ").lower()


def _without_unit(name: str) -> tuple[str, str]:
    """Split ``x [m]``, ``x(m)`` and ``x_m``."""
    begin = max(name.rfind("["), name.rfind("("))
    if begin > 0 and name[-1] in "])":
        return name[:begin].rstrip(), name[begin + 1 : -1].strip()
    short, _, unit = name.rpartition("_")
    is_unit = unit in LENGTH_UNITS and POSITIONS.fullmatch(short)
    return (short, unit) if is_unit else (name, "")


def _with_rests(columns: Sequence[_Column]) -> list[_Column]:
    """Let ``stamp_nsec`` beside ``stamp_sec`` be the rest of one stamp."""
    stems = {one.stem for one in columns if one.stem and one.is_seconds}
    return [
        one._replace(role=NANOSECONDS) if one.stem in stems and not one.is_seconds else one for one in columns
    ]


def _names(text: str) -> list[str]:
    """Split a heading at its commas, or at white space outside of the brackets of units."""
    if "," in text:
        return _fields(text)
    names: list[str] = []
    for word in text.split():
        if names and (word[0] in "[(" or _is_open(names[-1])):
            names[-1] += word
        else:
            names.append(word)
    return names


def _is_open(name: str) -> bool:
    return max(name.rfind("["), name.rfind("(")) > max(name.rfind("]"), name.rfind(")"))


@dataclass(frozen=True)
class _Layout:
    """
    How the rows of a table are read.

    ``roles`` are those of the numbers that a row must have, ``places`` the indices of their columns,
    ``units`` what they are multiplied by, for nanoseconds and meters. A row has ``most`` columns; with a
    heading, those at its end that are not needed may be absent. ``valid`` is the index of the column that
    says whether a row has a pose. ``names_unit``: the heading has the unit of the stamp.
    """

    needed: Roles
    roles: Roles
    places: tuple[int, ...]
    units: tuple[float, ...]
    most: int
    has_heading: bool = True
    valid: int | None = None
    names_unit: bool = False
    is_of_euroc: bool = False

    def same_as(self, other: _Layout) -> bool:
        return (self.roles, self.places, self.units) == (other.roles, other.places, other.units)


def _without_heading(needed: Roles) -> _Layout:
    units = tuple(TIME_UNITS["s"] if role == STAMP else 1.0 for role in needed)
    return _Layout(needed, needed, tuple(range(len(needed))), units, len(needed), has_heading=False)


def _of_heading(text: str, needed: Roles, *, is_comment: bool) -> _Layout | None:
    """
    Understand a heading.

    :param is_comment: the text follows a ``#``.
    :return: None: it is a comment that does not name the columns.
    :raises ValueError: it cannot be obeyed, or is not a heading.
    """
    columns = _with_rests([*map(_column, _names(text.rpartition(":")[2] if is_comment else text))])
    known = {one.role for one in columns}.intersection(needed)
    if is_comment:
        # A prose comment may contain one of these words.
        if len(known) < (min(3, len(needed)) if STAMP in known else len(POSE)):
            return None
    elif not known:
        raise ValueError(_unexpected(text, needed, is_first=True))
    return _of_columns(columns, needed)


def _of_columns(columns: Sequence[_Column], needed: Roles) -> _Layout:
    roles = [one.role for one in columns]
    for role in (*needed, NANOSECONDS):
        if len(same := [one.name for one in columns if one.role == role]) > 1:
            what = _SHOWN.get(role, role)
            raise ValueError(
                f"the heading has several columns for {what}: {_listed(same)}; rename the others"
            )
    if missing := [_SHOWN[role] for role in needed if role not in roles]:
        names = " ".join(one.name for one in columns)
        hint = _hint(names) if "qw" in missing or COLMAP.search(names) else ""
        if similar := [one.name for one in columns if STAMP not in roles and LIKE_STAMP.search(one.name)]:
            name = _shortened(similar[0])
            hint = f"; if {name} is the stamp, call it timestamp, or timestamp [ns] if it is in ns"
        raise ValueError(
            f"the heading has no column for {_listed(missing)}; its names are like {EXAMPLE}{hint}"
        )
    wanted = (*needed, NANOSECONDS) if NANOSECONDS in roles else needed
    places = tuple(map(roles.index, wanted))
    stamp = columns[roles.index(STAMP)]
    if NANOSECONDS in roles and not stamp.is_seconds:
        both = _listed([stamp.name, columns[places[-1]].name])
        raise ValueError(f"the heading has several columns for {_SHOWN[STAMP]}: {both}; rename the other one")
    names_unit = bool(stamp.unit)
    is_of_euroc = any(OF_EUROC.fullmatch(_without_unit(_short(one.name))[0]) for one in columns)
    if not names_unit:
        stamp = stamp._replace(unit="ns" if is_of_euroc else "s")
    units = (
        _factor(stamp if role == STAMP else columns[place])
        for role, place in zip(wanted, places, strict=True)
    )
    valid = roles.index(VALID) if VALID in roles else None
    return _Layout(
        needed,
        wanted,
        places,
        tuple(units),
        len(columns),
        True,
        valid,
        names_unit,
        is_of_euroc and not names_unit,
    )


def _factor(column: _Column) -> float:
    """What the numbers of a column are multiplied by."""
    units = UNITS.get(column.role, NO_UNITS)
    if column.unit and column.unit not in units:
        raise ValueError(f"the unit of the column {_shortened(column.name)} is not one of {', '.join(units)}")
    return units[column.unit] if column.unit else 1.0


# Rows.

EXACT = Context(prec=60)  # a float cannot hold all digits of a stamp
EXPECTED = {
    TUM: "8 numbers, a stamp in seconds and x y z qx qy qz qw",
    KITTI: "12 numbers, the first three rows of a matrix",
    TIMES: "one number, a stamp in seconds",
}


class _Table(NamedTuple):
    """The N rows of a file: their lines, their stamps in ns if they have them, and the other numbers."""

    name: str
    has_heading: bool
    lines: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    values: NDArray[np.float64]


def _read(path: str | PathLike[str], needed: Roles) -> _Table:
    """
    Read the rows of a file.

    :param needed: the roles of the numbers that a row must have; without a heading, it has no others.
    """
    name = printable(os.fspath(path))
    lines, times_ns, values = array("q"), array("q"), array("d")
    layout, before, columns = None, 0, 0
    for number, line in _lines(path, name):
        text = line.strip()
        try:
            if not lines:
                before += len(line)
                if before > MOST_BEFORE_ROWS:
                    raise ValueError(f"expected {EXPECTED[needed]}; no line before has them")
            if not text:
                continue
            is_comment = text.startswith("#")
            if is_comment or layout is None and not _is_number(_fields(text)[0]):
                found = _of_heading(text.lstrip("# "), needed, is_comment=is_comment)
                if found and layout and not found.same_as(layout):
                    raise ValueError("the heading differs from what is before it")
                layout = layout or found
                continue
            layout = layout or _without_heading(needed)
            fields = _fields(text)
            columns = columns or len(fields)
            row = _row(text, fields, layout, columns, is_first=not lines)
        except ValueError as error:
            raise BagError(f"{name}, line {number}: {error}") from None
        if row is not None:
            lines.append(number)
            times_ns.append(row[0])
            values.extend(row[1])
        if len(lines) > MOST_ROWS:
            raise BagError(f"{name}: expected at most {MOST_ROWS:,} rows, got more")
    if layout is None or not lines:
        raise BagError(f"{name}: expected lines of {EXPECTED[needed]}; there are none")
    rows = np.array(values).reshape(len(lines), -1)
    return _Table(name, layout.has_heading, np.array(lines), np.array(times_ns), rows)


def _lines(path: str | PathLike[str], name: str) -> Iterator[tuple[int, str]]:
    with open(path, encoding="utf-8-sig", errors="replace") as file:
        number = 0
        while line := file.readline(MOST_CHARACTERS):
            number += 1
            if "\0" in line:
                raise BagError(f"{name}, line {number}: expected a text in UTF-8, got binary data")
            if len(line) == MOST_CHARACTERS and line[-1] != "\n":
                most = f"expected at most {MOST_CHARACTERS:,} characters"
                raise BagError(f"{name}, line {number}: {most}{_hint(line)}")
            yield number, line


def _fields(text: str) -> list[str]:
    if "," not in text:
        return text.split()
    fields = [one.strip() for one in text.split(",")]
    return fields if fields[-1] else fields[:-1]  # some programs write a comma at the end


def _row(
    text: str, fields: Sequence[str], layout: _Layout, columns: int, *, is_first: bool
) -> tuple[int, list[float]] | None:
    """
    Read the stamp in ns and the other numbers of a row; None: a column says that it is not valid.

    :param columns: how many the first row has.
    """
    if not columns == len(fields) == layout.most:
        _check_columns(text, fields, layout, columns, is_first)
    if layout.valid is not None and [one.lower() for one in fields[layout.valid :][:1]] in (["false"], ["0"]):
        return None
    try:
        numbers = [float(fields[place]) for place in layout.places]
    except ValueError:
        numbers = [nan]
    if not isfinite(sum(numbers)):
        _check_numbers(text, fields, layout, is_first)
    scaled = [number * unit for number, unit in zip(numbers, layout.units, strict=True)]
    if STAMP not in layout.needed:
        return 0, scaled
    return _time_ns(fields[layout.places[0]], numbers, layout), scaled[1 : len(layout.needed)]


def _check_columns(text: str, fields: Sequence[str], layout: _Layout, columns: int, is_first: bool) -> None:
    """Refuse a row with other columns than the first one, too many, or too few of those that are needed."""
    if not layout.has_heading:
        raise ValueError(_unexpected(text, layout.needed, is_first=is_first))
    if len(fields) > layout.most:
        raise ValueError(f"expected at most the {layout.most} columns of the heading, got {len(fields)}")
    ends = zip(layout.roles, layout.places, strict=True)
    if missing := [_SHOWN.get(role, role) for role, place in ends if place >= len(fields)]:
        raise ValueError(f"the row is cut off before {_listed(missing)}: {_quoted(text)}")
    if len(fields) != columns:
        raise ValueError(
            f"expected {columns} columns, as in the first row, got {len(fields)}: {_quoted(text)}"
        )


def _check_numbers(text: str, fields: Sequence[str], layout: _Layout, is_first: bool) -> None:
    """Refuse a row with a field that is not a finite number."""
    for role, place in zip(layout.roles, layout.places, strict=True):
        if not _is_number(fields[place]) and not layout.has_heading:
            raise ValueError(_unexpected(text, layout.needed, is_first=is_first))
        if not _is_number(fields[place]) or not isfinite(float(fields[place])):
            shown = _SHOWN.get(role, role)
            raise ValueError(f"{shown}: expected a finite number, got {_quoted(fields[place])}")


def _time_ns(text: str, numbers: Sequence[float], layout: _Layout) -> int:
    value, unit = numbers[0], layout.units[0]
    if value < 0.0:
        raise ValueError(f"expected a stamp of 0 or more, got {_shortened(text)}")
    if layout.is_of_euroc and 0.0 < value < NOT_SECONDS:
        raise ValueError(
            f"in EuRoC's format, stamps are in ns, but {_shortened(text)} is not; name its unit in the"
            " heading, such as: timestamp [s]"
        )
    if not layout.names_unit and not layout.is_of_euroc and NOT_SECONDS <= value <= LAST_NS:
        raise ValueError(f"the stamp {_shortened(text)} is not in seconds{_unit_hint(value, layout)}")
    time_ns = LAST_NS + 1
    if value * unit < LAST_NS + S:  # a float is not exact
        time_ns = round(EXACT.multiply(Decimal(text), Decimal(unit)))
        if NANOSECONDS in layout.roles:
            rest_ns = numbers[-1] * layout.units[-1]
            if not (0.0 <= rest_ns < S and value.is_integer()):
                raise ValueError(
                    f"expected whole seconds and less than 10^9 ns, got {_shortened(text)} and {rest_ns:g}"
                )
            time_ns += round(rest_ns)
    if time_ns > LAST_NS:
        large = f"the stamp {_shortened(text)} is too large: messages cannot hold {value * unit / S:g} s"
        raise ValueError(f"{large}{_unit_hint(value, layout)}")
    return time_ns


def _unit_hint(value: float, layout: _Layout) -> str:
    """Say how to name the unit of a stamp that cannot be in the one that is assumed."""
    unit = _likely_unit(value)
    how = f"say so in the heading: timestamp [{unit}]"
    if not layout.has_heading:
        how = _add_heading(unit) if layout.needed == TUM else f"add the first line: timestamp [{unit}]"
    return f"; if it is in {unit}, {how}" if unit else ""


def _likely_unit(value: float) -> str:
    """Guess the unit of a stamp that cannot be in seconds, from its size."""
    if not NOT_SECONDS / 10 <= value <= LAST_NS:
        return ""
    # Of today, or, in ns, of a simulation that has run for some seconds.
    return "ns" if value < NOT_SECONDS or value >= 1e17 else "us" if value >= 1e14 else "ms"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


# Texts.

DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d*(?:[eE][-+]?\d+)?")

# What a file may be, by the first line that is not understood, and what to do about it.
MATRIX = re.compile(
    r"(?<![a-z0-9])(r|rot|rotation|dcm|t|tf|m|mat|matrix|h|pose)[_\[(]*([01])[_\[\](), ]*\2(?!\d)", re.I
)
COLMAP = re.compile(r"IMAGE_ID|\.(jpe?g|png)$", re.I)
_SCIPY = "with `from scipy.spatial.transform import Rotation`:"
_QUATERNION = f"the columns qx qy qz qw are, {_SCIPY}"
HINTS = (
    (
        re.compile(r"^[\[{]"),
        'write JSON in rows; this does so with ego_pose.json of nuScenes: python3 -c "import json;'
        " print('timestamp [us],tx,ty,tz,qw,qx,qy,qz'); [print(p['timestamp'], *p['translation'],"
        " *p['rotation'], sep=',') for p in json.load(open('FILE'))]\"",
    ),
    (
        re.compile(r"^VERSION 0?\.\d"),
        "write a point cloud of poses, as LIO-SAM saves it, in rows: sed -n 's/^FIELDS //p;"
        " /^DATA/,${/^DATA/!p}' FILE; if its DATA are binary, convert it first:"
        " pcl_convert_pcd_ascii_binary FILE ascii.pcd 0 17",
    ),
    (
        COLMAP,
        "images.txt of COLMAP has no stamps, and the pose of the world in each camera. Of the camera,"
        f" qx qy qz qw are -qx -qy -qz qw, and tx ty tz are, {_SCIPY}"
        " `Rotation.from_quat([-qx, -qy, -qz, qw]).apply([-tx, -ty, -tz])`",
    ),
    (
        re.compile("roll|yaw|euler|rpy|theta|heading|^VERTEX3", re.I),
        f"of angles in radians, {_QUATERNION} `Rotation.from_euler('xyz', [roll, pitch, yaw]).as_quat()`;"
        " in a plane, z, roll and pitch are 0",
    ),
    (
        MATRIX,
        f"of a rotation matrix, {_QUATERNION}"
        " `Rotation.from_matrix([[r11, r12, r13], [r21, r22, r23], [r31, r32, r33]]).as_quat()`",
    ),
    (
        re.compile(r"(?<![a-z])(q|quat|quaternion)[_.\[(]*0", re.I),
        "name the parts of a quaternion qw qx qy qz if the real part is the first, or qx qy qz qw if it is"
        " the last",
    ),
    (
        re.compile("^(VERTEX|EDGE|FIX|PARAMS)"),
        "a graph of g2o has no stamps. If times.txt has those of its poses, this writes the format of TUM:"
        " awk '/^VERTEX_SE3:QUAT/ {print $3, $4, $5, $6, $7, $8, $9} /^VERTEX(_SE)?2/ {printf"
        ' "%s %s 0 0 0 %.17g %.17g\\n", $3, $4, sin($5 / 2), cos($5 / 2)}\' FILE | paste -d " " times.txt -',
    ),
)


def _add_heading(unit: str = "") -> str:
    """Say which line is to be added to a file without a heading, whose stamps are in this unit."""
    w_last, w_first = (
        one.replace("timestamp", f"timestamp [{unit}]" if unit else "timestamp") for one in (EXAMPLE, W_FIRST)
    )
    return (
        f"add a first line that names all columns in the order of the file, such as: {w_last}; or, if qw"
        f" comes before qx, as VINS and EuRoC write it: {w_first}"
    )


def _hint(text: str) -> str:
    return next((f"; {remedy}" for pattern, remedy in HINTS if pattern.search(text)), "")


def _unexpected(text: str, needed: Roles, *, is_first: bool) -> str:
    return f"expected {EXPECTED[needed]}, got {_quoted(text)}{_advice(text, needed, is_first=is_first)}"


def _advice(text: str, needed: Roles, *, is_first: bool) -> str:
    """Say what a row may be, and what to do about it."""
    fields, words = _fields(text), text.replace(";", " ").split()
    separator, awk = (",", "awk -F ,") if "," in text else (" ", "awk")
    if ";" in text or len(words) > 1 and all(map(DECIMAL_COMMA.fullmatch, words)):
        return "; write decimal points, and commas or spaces between numbers: tr ',;' '. ' < FILE"
    if needed == KITTI and MATRIX.search(text):
        return "; the format of KITTI has no heading: tail -n +2 FILE"
    if hint := _hint(text):
        return hint
    if needed == TIMES:
        several = "; if one of its columns is the stamp, add a first line such as: timestamp [ns],file"
        return several if len(fields) > 1 else ""
    if not all(map(_is_number, fields)):
        return f"; the names of columns are like {EXAMPLE}" if is_first else ""
    if needed == KITTI and len(fields) == len(TUM):
        return "; a file that has the stamps is read without `times`"
    by_columns = "print $1, $5, $9, $13, $2, $6, $10, $14, $3, $7, $11, $15"
    upper_rows = by_columns if any(map(float, fields[12:15])) else "NF = 12; print"
    found = {
        3: "; poses need a position and a rotation",
        4: f"; if they are a stamp, x y and an angle in radians: {awk}"
        " '{printf \"%s %s %s 0 0 0 %.17g %.17g\\n\", $1, $2, $3, sin($4 / 2), cos($4 / 2)}' FILE",
        7: "; if they are a stamp, a position and angles, add the first line: timestamp x y z roll pitch yaw;"
        " if they are x y z qx qy qz qw, and times.txt has the stamps:"
        f" paste -d '{separator}' times.txt FILE",
        12: "; KITTI's poses need `times` or `--trajectory-times`",
        13: f"; without the first number, it may be a matrix: `{awk} '{{$1 = \"\"; print}}' FILE` writes the"
        f" format of KITTI, which needs `times`; if the first number is the stamp,"
        f" `{awk} '{{print $1}}' FILE` writes these",
        16: f"; if it is a matrix, `{awk} '{{{upper_rows}}}' FILE` writes the format of KITTI, which needs"
        " `times`",
        17: f"; if it is an index and a matrix, `{awk} '{{NF = 13; $1 = \"\"; print}}' FILE` writes the"
        " format of KITTI, which needs `times`",
    }
    if not is_first and len(fields) < len(needed):
        return "; the row is cut off"
    likely = found.get(len(fields), "")
    if needed != TUM or len(fields) <= len(TUM):
        return likely
    how = _add_heading(_likely_unit(float(fields[0])))
    return f"{likely}; otherwise, {how}" if likely else f"; {how}"


def _quoted(text: str) -> str:
    return repr(_shortened(text))


def _listed(names: Sequence[str]) -> str:
    return ", ".join([*map(_shortened, names[:MOST_LISTED]), *["…"] * (len(names) > MOST_LISTED)])


def _shortened(text: str) -> str:
    shown = printable(text[: QUOTED + 1])
    return shown if len(shown) <= QUOTED else f"{shown[:QUOTED]}…"

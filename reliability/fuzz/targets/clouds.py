# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuzz the layouts of PointCloud2, beside a slow transform of one point after the other."""

import struct
from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
from geometry_msgs.msg import Transform
from sensor_msgs.msg import PointCloud2, PointField

from reliability.fuzz.buffer_checks import Fault
from reliability.fuzz.fuzzer_input import Input
from tf2_sensor_msgs import do_transform_cloud
from tf2_sensor_msgs._errors import FieldError, SizeError

MOST_BYTES = 1024
FORMATS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}
NAMES = ("x", "y", "z", "normal_x", "normal_y", "normal_z", "vp_x", "vp_y", "vp_z", "rgb", "")
MOST_COMPARED = 100  # points
# What the fields of a message, which need not check them, may hold instead of a small number.
ODD: list[Any] = [2**31, 2**32 - 1, 2**32, -1, 2**63, 2**64, 10**30, 1.5, None, "1", True, np.uint8(3)]


def run(data: bytes) -> None:
    """Transform one cloud."""
    given = Input(data)
    cloud, only_xyz = _cloud(given)
    transform = _transform(given)
    # The bytes of the points may be an array of any kind, and are of their exact size.
    points = given.some(given.left)
    cloud._data = _holding(points, given)
    before = bytes(points)
    try:
        wanted, error = _transformed(cloud, before, transform, only_xyz), None
    except (FieldError, SizeError, TypeError, ValueError) as found:
        wanted, error = None, found
    try:
        answer = do_transform_cloud(cloud, transform, only_xyz=only_xyz)
    except (TypeError, ValueError) as found:
        if error is None or not isinstance(found, type(error)):
            raise Fault(f"{found!r} instead of {error!r}") from found
        return
    if error is not None:
        raise Fault(f"an answer instead of {error!r}")
    if bytes(cloud._data) != before:
        raise Fault("the cloud has changed")
    if wanted is not None:
        _compare(answer, wanted)


def _number(given: Input) -> Any:
    # Mostly small: others are refused early.
    kind = given.byte()
    if kind < 224:
        return kind % 33
    return ODD[kind % len(ODD)]


def _cloud(given: Input) -> tuple[PointCloud2, bool]:
    cloud = PointCloud2()
    flags = given.byte()
    cloud._is_bigendian = bool(flags & 1)
    cloud._is_dense = bool(flags & 2)
    cloud._height, cloud._width = _number(given), _number(given)
    cloud._point_step, cloud._row_step = _number(given), _number(given)
    if flags & 4 and isinstance(cloud._width, int) and isinstance(cloud._point_step, int):
        cloud._row_step = cloud._width * cloud._point_step + (flags >> 5)
    cloud._fields = []
    for _ in range(given.below(12)):
        field = PointField()
        kind = given.byte()
        field._name = NAMES[kind % len(NAMES)]
        field._offset, field._datatype = _number(given), given.below(10)
        field._count = 1 if kind < 200 else _number(given)
        if kind > 240:
            field._datatype = _number(given)
        cloud._fields.append(field)
    return cloud, bool(flags & 8)


def _transform(given: Input) -> Transform:
    transform = Transform()
    kind = given.below(4)
    for part, names in ((transform.translation, "xyz"), (transform.rotation, "xyzw")):
        for name in names:
            number = given.double() if kind == 3 else given.whole("b") / 16
            setattr(part, f"_{name}", number)
    return transform


def _holding(points: bytes, given: Input) -> Any:
    kind = len(points) % 4
    if kind == 0:
        return array("B", points)
    if kind == 1:
        return points
    exact = np.frombuffer(points, np.uint8).copy()
    return exact if kind == 2 else list(points)


def _whole(value: Any) -> int:
    if not hasattr(value, "__index__"):
        raise TypeError(value)
    whole = value.__index__()
    if not 0 <= whole < 2**32:
        raise ValueError(whole)
    return int(whole)


# What is wanted: the size of a point, of a row, the bytes, and the places of numbers.
_Wanted = tuple[int, int, bytes, list[tuple[int, str]]]


def _transformed(cloud: PointCloud2, data: bytes, transform: Transform, only_xyz: bool) -> _Wanted | None:
    matrix = _matrix(transform)
    rows, columns, step, row_step = (
        _whole(value) for value in (cloud._height, cloud._width, cloud._point_step, cloud._row_step)
    )
    if len(data) < rows * columns * step or columns * step >= 2**32:
        raise SizeError
    used, new_row_step, size = columns * step, row_step, len(data)
    if rows and (row_step < used or size < rows * row_step):
        if row_step < used or size < (rows - 1) * row_step + used:
            row_step = used
        new_row_step, size = used, rows * used
    fields: dict[str, PointField] = {}
    for field in cloud._fields:
        fields.setdefault(field._name, field)
    order = ">" if cloud._is_bigendian else "<"
    triples = [(_triple(fields, "xyz", step, order), True)]
    new_step = step
    if len(fields) == 3:
        new_step = max(offset + struct.calcsize(code) for offset, code in triples[0][0])
        if new_step < step:
            new_row_step = columns * new_step
            size = rows * new_row_step
    elif not only_xyz:
        for names, moves in ((NAMES[3:6], False), (NAMES[6:9], True)):
            if all(name in fields and fields[name]._datatype in (7, 8) for name in names):
                triples.append((_triple(fields, names, step, order), moves))
    # A cloud without columns may claim any number of rows.
    if max(rows, rows * columns) > MOST_COMPARED:
        return None
    made = bytearray(size)
    numbers: list[tuple[int, str]] = []
    end = new_end = 0
    for row in range(rows):
        for column in range(columns):
            begin, new_begin = row * row_step + column * step, row * new_row_step + column * new_step
            point = bytearray(data[begin : begin + new_step])
            for triple, moves in triples:
                _move(point, triple, matrix, transform, moves)
                numbers += [(new_begin + at, code) for at, code in triple]
            made[new_begin : new_begin + new_step] = point
        end, new_end = row * row_step + used, row * new_row_step + columns * new_step
        padding = (new_row_step if row + 1 < rows else size - row * new_row_step) - columns * new_step
        made[new_end : new_end + padding] = data[end : end + padding]
    if not rows:
        made[:] = data[:size]
    return new_step, new_row_step, bytes(made), numbers


def _matrix(transform: Transform) -> list[float]:
    x, y, z, w = (float(getattr(transform.rotation, f"_{name}")) for name in "xyzw")
    with np.errstate(all="ignore"):
        squared = float(np.float64(x) * x + np.float64(y) * y + np.float64(z) * z + np.float64(w) * w)
        if not np.isfinite(squared):
            raise ValueError("rotation")
        if squared < np.finfo(float).eps:
            x, y, z, w, squared = 0.0, 0.0, 0.0, 1.0, 1.0
        q = [np.float64(number) for number in (x, y, z, w)]
        # In the order of the additions in the C, which may not change: the comparison is exact.
        squared = q[3] * q[3] + q[0] * q[0] + q[1] * q[1] + q[2] * q[2]
        a, b, c = q[0] * 2.0 / squared, q[1] * 2.0 / squared, q[2] * 2.0 / squared
        return [
            1.0 - (b * q[1] + c * q[2]),
            b * q[0] - c * q[3],
            c * q[0] + b * q[3],
            b * q[0] + c * q[3],
            1.0 - (a * q[0] + c * q[2]),
            c * q[1] - a * q[3],
            c * q[0] - b * q[3],
            c * q[1] + a * q[3],
            1.0 - (a * q[0] + b * q[1]),
        ]


_Triple = list[tuple[int, str]]


def _triple(fields: dict[str, PointField], names: Any, step: int, order: str) -> _Triple:
    triple = []
    for name in names:
        if name not in fields:
            raise FieldError(name)
        offset = _whole(fields[name]._offset)
        datatype = fields[name]._datatype
        if not isinstance(datatype, int) or datatype not in FORMATS:
            raise FieldError(name)
        code = order + FORMATS[datatype]
        if fields[name]._count > 1 or offset + struct.calcsize(code) > step:
            raise FieldError(name)
        triple.append((offset, code))
    return triple


def _move(point: bytearray, triple: _Triple, matrix: list[float], by: Transform, moves: bool) -> None:
    old = [np.float64(struct.unpack_from(code, point, at)[0]) for at, code in triple]
    with np.errstate(all="ignore"):
        for row, (at, code) in enumerate(triple):
            moved = np.float64(getattr(by.translation, "_" + "xyz"[row])) if moves else np.float64(0)
            m = matrix[3 * row : 3 * row + 3]
            _store(point, at, code, m[0] * old[0] + m[1] * old[1] + m[2] * old[2] + moved)


def _store(point: bytearray, at: int, code: str, value: Any) -> None:
    size = struct.calcsize(code)
    if code[1] in "fd":
        made = np.asarray(value).astype(f"{code[0]}f{size}")
        point[at : at + size] = made.tobytes()
        return
    # Towards zero; what does not fit, as x86 converts it.
    wide = code[1] == "I"
    lowest, end = (-(2.0**63), 2.0**63) if wide else (-2147483649.0, 2147483648.0)
    fits = lowest <= value < end if wide else lowest < value < end
    whole = int(value) if fits else -(2**63) if wide else -(2**31)
    order = "little" if code[0] == "<" else "big"
    point[at : at + size] = (whole % 256**size).to_bytes(size, order)


def _compare(answer: PointCloud2, wanted: _Wanted) -> None:
    step, row_step, data, numbers = wanted
    if (answer.point_step, answer.row_step, len(answer.data)) != (step, row_step, len(data)):
        raise Fault(
            f"point_step, row_step, bytes {answer.point_step, answer.row_step, len(answer.data)},"
            f" not {step, row_step, len(data)}"
        )
    found = bytes(answer.data)
    # Where coordinates overlap, the bits of a NaN, which are not said, become parts of others.
    if found == data or _overlap(numbers):
        return
    places: set[int] = set()
    for at, code in numbers:
        size = struct.calcsize(code)
        one, other = (struct.unpack_from(code, some, at)[0] for some in (found, data))
        if one != one and other != other:
            places.update(range(at, at + size))
    for at, (byte, other_byte) in enumerate(zip(found, data, strict=True)):
        if byte != other_byte and at not in places:
            raise Fault(f"byte {at} is {byte}, not {other_byte}: {found!r}, not {data!r}")


def _overlap(numbers: list[tuple[int, str]]) -> bool:
    covered: set[int] = set()
    for at, code in numbers:
        some = set(range(at, at + struct.calcsize(code)))
        if covered & some:
            return True
        covered |= some
    return False


def _seed(flags: int, rows: int, columns: int, step: int, fields: list[tuple[int, int, int]]) -> bytes:
    # One that `_cloud` reads; the row step follows from the others.
    head = bytes([flags | 4, rows, columns, step, 0, len(fields)])
    head += b"".join(bytes(field) for field in fields)
    turn = struct.pack("8b", 0, 16, -32, 5, 0, 0, 9, 12)
    floats = struct.pack("<8f", 1, 2, 3, 4, -5, 6.5, float("nan"), 1e30)
    return head + turn + (floats * (rows * columns * step // len(floats) + 2))[: rows * columns * step]


def seeds() -> Iterator[bytes]:
    """Clouds as drivers send them, and in the odd layouts."""
    xyz = [(0, 0, 7), (1, 4, 7), (2, 8, 7)]
    doubles = [(0, 0, 8), (1, 8, 8), (2, 16, 8)]
    normals = [(3, 12, 7), (4, 16, 7), (5, 20, 7)]
    views = [(6, 24, 7), (7, 28, 7)]
    for flags in (0, 1, 8, 0x40, 0x41):
        yield _seed(flags, 1, 9, 12, xyz)
        yield _seed(flags, 2, 9, 16, xyz)
        yield _seed(flags, 3, 7, 16, [*xyz, (9, 12, 7)])
        yield _seed(flags, 2, 9, 24, doubles)
        yield _seed(flags, 1, 9, 32, doubles)
        yield _seed(flags, 2, 3, 32, [*xyz, *normals, *views])
        yield _seed(flags, 1, 5, 26, [(0, 1, 5), (1, 7, 4), (2, 11, 1), (9, 0, 2)])
        yield _seed(flags, 1, 5, 20, [(2, 3, 7), (1, 8, 8), (0, 16, 6)])

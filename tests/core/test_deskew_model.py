# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Deskewing by a model that looks up one transform for each point: any motions, layouts and times."""

import array
import math

import numpy as np
import pytest
from hypothesis import event, example, given
from hypothesis import strategies as st
from rclpy.duration import Duration
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header
from times_and_transforms import S, at_ns, stamp_ns, transform

from tf2_ros import Buffer, TransformException
from tf2_sensor_msgs import deskew

SWEEP = S // 10
# Of clouds. Simulated time begins at 0.
STAMPS = [*3 * [1_700_000_000 * S + 987_654_321], 0, 1, SWEEP // 3]
FARTHEST = 2.0**62  # ns
CODES = {
    "i1": PointField.INT8, "u1": PointField.UINT8, "i2": PointField.INT16, "u2": PointField.UINT16,
    "i4": PointField.INT32, "u4": PointField.UINT32, "f4": PointField.FLOAT32, "f8": PointField.FLOAT64,
}  # fmt: skip


NORMAL = ("normal_x", "normal_y", "normal_z")
VIEWPOINT = ("vp_x", "vp_y", "vp_z")


# Motions.


class Motion:
    """A path of frames between `world` and `lidar`, and how far the lidar may move within a nanosecond."""

    def __init__(self, stamp):
        self.stamp = stamp
        self.buffer = Buffer(Duration(seconds=100))
        self.turn = self.length = self.speed = 0.0

    def add_path(self, dice, hops, top, is_static, is_jumping):
        names = ["world", *(f"frame_{i}" for i in range(1, hops)), "lidar"]
        for i in range(hops):
            # Up to the common ancestor and down from it.
            parent, child = names[i : i + 2] if i >= top else names[i + 1 : i - 1 if i else None : -1]
            if is_static[i]:
                self._add_static(dice, parent, child)
            else:
                self._add_moving(dice, parent, child, is_jumping)
        self._add_moving(dice, "ocean", "island", is_jumping)

    def _add_static(self, dice, parent, child):
        xyz = dice.uniform(-3, 3, 3)
        self.length += np.linalg.norm(xyz)
        self.buffer.set_transform_static(transform(parent, child, xyz=xyz, xyzw=turn(dice, 3)), "x")

    def _add_moving(self, dice, parent, child, is_jumping):
        count = dice.integers(2, 30)
        begin, after = max(self.stamp - 2 * SWEEP, 0), self.stamp + 2 * SWEEP
        end = dice.choice([after, after, after, self.stamp + SWEEP // 2])  # some end within the sweep
        inner = np.unique(dice.integers(begin, end, count))
        stamps = np.array([begin, *inner[np.diff(inner, prepend=begin) > 2_000_000], end])
        if is_jumping:
            stamps = np.sort(np.append(stamps, stamps[len(stamps) // 2]))
        far, step, angle = dice.choice([0, 30, 1e5]), dice.choice([0, 0.02, 2]), dice.choice([0, 0.02, 2])
        xyz, q = dice.uniform(-far, far, 3), turn(dice, 3)
        for stamp in stamps.tolist():
            self.buffer.set_transform(transform(parent, child, ns=stamp, xyz=xyz, xyzw=q), "x")
            xyz, q = xyz + dice.uniform(-step, step, 3), product(q, turn(dice, angle))
        shortest = max(np.diff(stamps).min(), 2_000_000) / S
        self.turn += angle / shortest
        self.speed += 2 * step / shortest
        self.length += 2 * far + 4 * step * count

    def speed_at(self, distance):
        return self.speed + self.turn * (self.length + distance)


def turn(dice, angle):
    axis = dice.normal(size=3)
    half = dice.uniform(-angle, angle) / 2
    return (*(axis / np.linalg.norm(axis) * math.sin(half)), math.cos(half))


def product(a, b):
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


@st.composite
def motions(draw, stamp):
    hops = draw(st.integers(1, 4))
    is_static = draw(st.lists(st.booleans(), min_size=hops, max_size=hops))
    is_static[draw(st.integers(0, hops - 1))] = False  # else nothing moves
    dice = np.random.default_rng(draw(st.integers(0, 2**32)))
    motion = Motion(stamp)
    motion.add_path(dice, hops, draw(st.integers(0, hops)), is_static, draw(st.integers(0, 5)) == 5)
    return motion


# Fields of times: the name, the type, the number of ns of a 1, and whether that must be said. A `timestamp`
# is since 1970, the others are after the stamp.

FIELDS = [
    ("time", "f4", S, False),
    ("time", "f8", S, False),
    ("t", "u4", 1, False),
    ("offset_time", "u4", 1, False),
    ("timestamp", "f8", S, False),
    ("timestamp", "f8", 1, False),
    ("time", "f4", SWEEP, True),
    ("time", "u4", 1000, True),
    ("t", "u4", 1, True),
    ("t", "i4", 1, True),
    ("t", "u2", 10_000, True),
    ("offset_time", "i2", 10_000, True),
    ("offset_time", "u1", SWEEP // 200, True),
    ("timestamp", "f8", 1000, True),
]
VELODYNE, SECONDS, OUSTER, _, HESAI, LIVOX, *_ = FIELDS
# As times after the stamp.
HOSTILE_NS = [
    -1, 1, -SWEEP, 3 * SWEEP, -3 * SWEEP, 2**31, 2**32 - 1, -(2**31), 10 * S, 3600 * S, -1e18, 1e18, 4e18,
    5e18, 9.3e18,
]  # fmt: skip
HOSTILE = [math.nan, math.inf, -math.inf, 0.0, 1e9, 1e18, 1e300, -1e300, 5e-324]


def as_number(value, kind):
    """What a driver stores, which wraps around, or is too large."""
    if kind[0] == "f":
        with np.errstate(over="ignore"):
            return np.dtype(kind).type(value)
    if not math.isfinite(value):
        return 0
    least = np.iinfo(kind).min
    return (int(value) - least) % 2 ** (8 * int(kind[1])) + least


def since(stamp, field):
    return *field, 0 if field[0] == "timestamp" else stamp


def numbers_of(field, stamp, since_ns):
    """What a driver stores for points at these times after the stamp."""
    name, kind, unit_ns, _, base_ns = field
    if name == "timestamp" and unit_ns == 1:
        return [np.float64(stamp + int(ns)) for ns in since_ns]
    return [as_number((stamp - base_ns + int(ns)) / unit_ns, kind) for ns in since_ns]


def message_of(points, stamp, rows=1, padding=lambda: b""):
    """The points in rows, with padding after each."""
    columns, step = len(points) // rows, points.dtype.itemsize
    rows_of_bytes = [row.tobytes() + padding() for row in points.reshape(rows, columns)]
    cloud = PointCloud2(header=Header(frame_id="lidar", stamp=at_ns(stamp).to_msg()))
    cloud.height, cloud.width, cloud.is_bigendian = rows, columns, points.dtype["x"].byteorder == ">"
    cloud.point_step, cloud.row_step = step, len(rows_of_bytes[0])
    cloud.fields = [
        PointField(name=name, offset=at, datatype=CODES[one.str[1:]], count=1)
        for name, (one, at, *_) in points.dtype.fields.items()
    ]
    cloud.data = array.array("B", b"".join(rows_of_bytes))
    cloud.is_dense = not bool(np.isnan(xyz_of(points)).any())
    return cloud


@st.composite
def clouds(draw, stamp):
    """A cloud, its points, and its field of times, with the ns that its numbers count from."""
    field = name, kind, unit_ns, is_said, base_ns = since(stamp, draw(st.sampled_from(FIELDS)))
    order = draw(st.sampled_from("<>"))
    rows = draw(st.sampled_from([1, 1, 2, 5]))
    columns = draw(st.sampled_from([1, 2, 9, 16, 17, 64, 400]))
    count = rows * columns
    dice = np.random.default_rng(draw(st.integers(0, 2**32)))
    parts = [(axis, draw(st.sampled_from(["f4", "f4", "f8"]))) for axis in "xyz"] + [(name, kind)]
    if draw(st.booleans()):
        parts = [(axis, "f4") for axis in "xyz"] + [(name, kind)]  # what most drivers write
    for other in draw(st.sets(st.sampled_from(["intensity", "ring", "nx"]))):
        parts.append((other, draw(st.sampled_from(list(CODES)))))
    for directions in (NORMAL, VIEWPOINT):
        if draw(st.booleans()):
            parts += [(axis, "f4") for axis in directions]
    if draw(st.booleans()):
        parts = draw(st.permutations(parts))
    offsets, end = [], 0
    for _, code in parts:
        offsets.append(end + draw(st.sampled_from([0, 0, 0, 1, 4])))
        end = offsets[-1] + int(code[1])
    layout = {
        "names": [part for part, _ in parts],
        "formats": [order + code for _, code in parts],
        "offsets": offsets,
        "itemsize": end + draw(st.sampled_from([0, 0, 3, 8])),
    }
    dtype = np.dtype(layout)
    points = np.frombuffer(dice.bytes(count * dtype.itemsize), dtype).copy()
    for axis in "xyz":
        points[axis] = dice.uniform(-100, 100, count)
    for axis in {*NORMAL, *VIEWPOINT} & {*dtype.names}:
        points[axis] = dice.uniform(-1, 1, count)
    since_ns = np.linspace(0, SWEEP, count).astype(np.int64) - draw(st.sampled_from([0, SWEEP // 2, SWEEP]))
    if is_said and kind[0] == "u":
        since_ns += SWEEP
    arranged = draw(st.sampled_from(["sorted", "sorted", "reversed", "random", "equal", "in columns"]))
    if arranged == "reversed":
        since_ns = since_ns[::-1]
    elif arranged == "random":
        since_ns = dice.permutation(since_ns)
    elif arranged == "equal":
        since_ns[:] = since_ns[count // 2]
    elif arranged == "in columns":
        since_ns = np.sort(since_ns.reshape(-1, rows), axis=1).T.ravel()
    numbers = numbers_of(field, stamp, since_ns)
    for _ in range(draw(st.integers(0, 3)) if draw(st.booleans()) else 0):
        at = draw(st.integers(0, count - 1))
        if draw(st.booleans()):
            numbers[at] = as_number((stamp - base_ns + draw(st.sampled_from(HOSTILE_NS))) / unit_ns, kind)
        else:
            numbers[at] = as_number(draw(st.sampled_from(HOSTILE)), kind)
    points[name] = numbers
    for _ in range(draw(st.integers(0, 2))):
        points[draw(st.sampled_from("xyz"))][draw(st.integers(0, count - 1))] = math.nan
    padding = draw(st.sampled_from([0, 0, 7]))
    return message_of(points, stamp, rows, lambda: dice.bytes(padding)), points, field


def rows_of(cloud):
    """The bytes of each row: of its points, and after them."""
    used, step = cloud.width * cloud.point_step, cloud.row_step
    rows = [bytes(cloud.data[row * step :][:step]) for row in range(cloud.height)]
    return [row[:used] for row in rows], [row[used:] for row in rows]


def points_of(cloud, dtype):
    return np.frombuffer(b"".join(rows_of(cloud)[0]), dtype)


def xyz_of(points, axes="xyz"):
    return np.stack([points[axis].astype(np.float64) for axis in axes], axis=1)


# The model.


def time_of(number, field):
    """The ns of a number, or None."""
    name, kind, unit_ns, is_said, base_ns = field
    value = float(number)
    if kind == "u4" and unit_ns == 1 and value >= 2**31:
        value -= 2**32
    if not abs(value * unit_ns) < FARTHEST:
        return None
    return base_ns + int(value) * unit_ns + round((value - int(value)) * unit_ns)


def unit_of(points, field):
    """The field with the unit that most of a timestamp's numbers have."""
    if field[0] != "timestamp" or field[3]:
        return field
    numbers = points["timestamp"]
    needed = numbers[~np.isnan(xyz_of(points)).any(axis=1) & np.isfinite(numbers)]
    numbers = needed if len(needed) else numbers[np.isfinite(numbers)]
    large = np.sum((numbers >= 2**31) & (numbers < 2**62))
    return (*field[:2], 1 if large and 2 * large >= len(numbers) else S, *field[3:])


def text_of(field):
    name, _, unit_ns, *_ = field
    unit = {1: "ns", 1000: "µs", S: "s"}.get(unit_ns, f"{unit_ns / S:g} s")
    return f"{unit} since 1970" if name == "timestamp" else f"{unit} after the stamp"


def single_lookups(motion, points, field, how, policy, target):
    """The matrix for each point from a single lookup, or its error, or what the point lacks."""
    found, answers = [], {}
    for xyz, number in zip(xyz_of(points), points[field[0]], strict=True):
        ns = time_of(number, field)
        if np.isnan(xyz).any() or ns is None:
            found.append("no coordinates" if np.isnan(xyz).any() else "no time")
            continue
        if ns not in answers:
            answers[ns] = looked_up(motion.buffer, ns or 1, how, policy, target)  # 0 is no latest time
        found.append(answers[ns])
    return found


def looked_up(buffer, ns, how, policy, target):
    try:
        return buffer.lookup_matrix(target, "lidar", ns, **how, **policy)
    except TransformException as error:
        return error
    except OverflowError as error:
        return error


def is_asked_about(points, field, stamp):
    """Whether the times are hardly those of a sweep; None: rounding decides."""
    name, kind, unit_ns, is_said, base_ns = field
    numbers = points[name][~np.isnan(xyz_of(points)).any(axis=1)].astype(float)
    if kind == "u4":
        numbers = np.where(numbers >= 2**31, numbers - 2**32, numbers)
    since = numbers[np.isfinite(numbers)] * (unit_ns / S) + (base_ns - stamp) / S
    if not len(since):
        return False
    about = 1e-5
    low, high = since.min(), since.max()
    if stamp and (min(abs(low - 3600), abs(high + 3600)) < about):
        return None
    if stamp and (low > 3600 or high < -3600):
        return True
    span = high - low
    if name != "time" or not 0.9 - about < span < 1 + about:
        return False
    return True if 0.9 + about < span < 1 - about or span == 1 else None


def lacks_target(motion, target, how, policy):
    """Whether the target itself has no transform at the target time."""
    arguments = target, how["fixed_frame"], how["target_time"]
    return not motion.buffer.can_transform(*arguments, **policy)


POLICIES = [{}, {}, {}, {"tolerance": 0.15}, {"tolerance": 0.15, "extrapolate": True}, {"max_gap": 0.02}]


SWEEPS = st.sampled_from(STAMPS).flatmap(lambda stamp: st.tuples(motions(stamp), clouds(stamp)))


# With a fixed frame, or without. The island is not connected to the lidar.
TARGETS = [("world", None), ("world", None), ("lidar", "world"), ("lidar", "world"), ("island", None)]
TARGETS.append(("island", "world"))
# With one, the last point is waited for.
TIMEOUTS = [0, 0, 1e-4]


# So slowly that poses are interpolated.
TURNING = [(-SWEEP, 0.0), (SWEEP // 3, 2.0), (SWEEP // 2, 1.5), (2 * SWEEP, 4.0)]


def swept(
    field,
    odd=(),
    number=0.0,
    lacking=(),
    samples=TURNING,
    others=(),
    xyz="<f4",
    stamp=STAMPS[0],
    after_ns=0,
    rows=1,
):
    """
    A sweep of 400 points of a lidar that moves.

    :param odd: the points that have this number as their time.
    :param lacking: the points that have no y.
    :param samples: the ns after the first point, and the x of the lidar, which turns by 0.02 rad/m.
    :param after_ns: from the stamp to the first point.
    :param xyz: the type of the coordinates; all else has the same byte order.
    :param rows: they are followed by 7 bytes each.
    """
    dice = np.random.default_rng(1)
    motion, field = Motion(stamp), since(stamp, field)
    for ns, x in samples:
        q = product((0.5, 0.5, 0.5, 0.5), (0, 0, math.sin(x / 100), math.cos(x / 100)))
        moved = transform("world", "lidar", ns=stamp + after_ns + ns, xyz=(x, 2, 3), xyzw=q)
        motion.buffer.set_transform(moved, "x")
    parts = [*((axis, xyz) for axis in "xyz"), *((axis, xyz[0] + "f4") for axis in others)]
    points = np.zeros(400, [*parts, (field[0], xyz[0] + field[1])])
    for axis in (*"xyz", *others):
        points[axis] = dice.uniform(-100, 100, 400) if axis in "xyz" else dice.uniform(-1, 1, 400)
    points[field[0]] = numbers_of(field, stamp, after_ns + np.linspace(0, SWEEP, 400).astype(np.int64))
    points[field[0]][[*odd]] = number
    points["y"][[*lacking]] = math.nan
    return motion, (message_of(points, stamp, rows, lambda: dice.bytes(7)), points, field)


# As in an uninitialized field.
GARBAGE = [
    (VELODYNE, 3e9), (VELODYNE, -3e9), (SECONDS, 1e5), (OUSTER, 2_000_000_000), (LIVOX, 12.0), (HESAI, 4e9),
    (HESAI, 0.25),
]  # fmt: skip
NS = STAMPS[0]  # too large for seconds
# All other points are within the data.
OUTSIDE = [(OUSTER, 2**32 - 1), (OUSTER, SWEEP + 1), (SECONDS, -1 / S), (SECONDS, (SWEEP + 1) / S)]
EXAMPLES = [
    *(swept(field, lacking=[3, 250], rows=4) for field in (VELODYNE, LIVOX)),
    # A point that lacks a coordinate has no directions; no point may have coordinates.
    swept(VELODYNE, lacking=[3], others=(*NORMAL, *VIEWPOINT)),
    *(swept(field, lacking=range(400)) for field in (VELODYNE, OUSTER, LIVOX, HESAI)),
    *(swept(VELODYNE, [17, 250], number) for number in (math.nan, math.inf, -math.inf, 3e38)),
    *(swept(SECONDS, [17, 250], number) for number in (math.nan, 1e300)),
    swept(("time", "f8", S, True), range(400), 1e300),
    *(swept(field, [at], number) for at in (0, 234) for field, number in GARBAGE),
    # The most points with coordinates decide whether times are seconds.
    *(
        swept(field, range(300), number, range(300), xyz=xyz)
        for xyz in ("<f4", "<f8")
        for field, number in ((LIVOX, 0.0), (HESAI, NS))
    ),
    *(swept(LIVOX, xyz=xyz, stamp=100 * S) for xyz in ("<f4", "<f8")),
    # The last point would be after the data if times since 1970 were rounded.
    *(swept(field, xyz=">f4") for field in (LIVOX, HESAI)),
    *(swept(field, range(n), number) for n in (50, 300) for field, number in ((LIVOX, 0.0), (HESAI, NS))),
    swept(HESAI, range(300), 1e30),
    # Between two doubles of seconds, the lidar moves by 0.7 mm.
    swept(HESAI, [17], math.nan, samples=[(-SWEEP, -450.0), (2 * SWEEP, 450.0)]),
    # An integer of 32 bits with another unit is never negative, and no unit is cut off.
    swept(("t", "u4", 1000, True), samples=[(0, 0.0), (SWEEP, 3.0)], after_ns=2**31 * 1000),
    *(swept(("t", "u4", unit_ns, True)) for unit_ns in (1, 15, 30, 120, 1000, 15_258_789)),
    *(
        swept(field, [235], number, samples=[(0, 0.0), (SWEEP // 4, 1.0), (SWEEP, 3.0)])
        for field, number in OUTSIDE
    ),
    # Jumps: say because the map was corrected; at the oldest stamp, a lookup takes the first sample.
    swept(OUSTER, samples=[(0, 0.0), (SWEEP // 3, 0.0), (SWEEP // 3, 0.001), (SWEEP, 0.001)]),
    swept(OUSTER, samples=[(0, 0.0), (0, 1.0), (SWEEP, 1.1), (2 * SWEEP, 1.2)]),
]


def with_examples(test):
    for sweep in EXAMPLES:
        for may_miss in (False, True):
            test = example(sweep, {}, ("world", None), may_miss, 0)(test)
            test = example(sweep, {}, ("lidar", "world"), may_miss, 1e-4)(test)
    return test


# Some of these clouds are that short.
@pytest.mark.filterwarnings("ignore:deskew. the field .* hardly any motion is corrected:UserWarning")
@given(SWEEPS, st.sampled_from(POLICIES), st.sampled_from(TARGETS), st.booleans(), st.sampled_from(TIMEOUTS))
@with_examples
def test_each_point_moves_by_the_transform_of_its_own_time(sweep, policy, frames, may_miss, timeout):
    motion, (cloud, points, field) = sweep
    name, kind, unit_ns, is_said, base_ns = field
    unit = {"time_unit": unit_ns / S} if is_said else {}
    field = unit_of(points, field)
    (target, is_fixed), how = frames, {}
    if is_fixed:
        how = {"fixed_frame": "world", "target_time": at_ns(motion.stamp + SWEEP // 3)}
    wanted = single_lookups(motion, points, field, how, policy, target)
    data = bytes(cloud.data)

    def call(on_missing):
        how_else = {"on_missing": on_missing, "timeout": timeout}
        return deskew(cloud, motion.buffer, target, **how, **unit, **policy, **how_else)

    asked = False if is_said else is_asked_about(points, field, motion.stamp)
    if asked is not False:
        event("asked")
        try:
            call("nan")
        except ValueError as error:
            assert " is from " in str(error)
            return
        assert asked is None
    bad = [i for i, one in enumerate(wanted) if isinstance(one, str) and one == "no time"]
    failed = [i for i, one in enumerate(wanted) if isinstance(one, Exception)]
    failed.sort(key=lambda i: isinstance(wanted[i], TransformException))  # no stamp can hold the first ones
    if not may_miss and (bad or failed):
        event("raised")
        i = (bad or failed)[0]
        number, kind = points[name][i], ValueError
        begin = f"points[{i}]: expected a time in the field {name}, in {text_of(field)}, got {number:g}"
        if not bad:
            number = (time_of(number, field) - base_ns) / field[2]
            begin = f"points[{i}], {name} = {number:.16g} {text_of(field)}: {wanted[i]}"
            kind = OverflowError if isinstance(wanted[i], OverflowError) else TransformException
        if is_fixed and not bad and lacks_target(motion, target, how, policy):
            begin, kind = "target_time: ", TransformException
        with pytest.raises(kind) as error:
            call("raise")
        assert str(error.value).startswith(begin)
        return
    moved = call("nan" if may_miss else "raise")
    event(f"{len(points)} points")
    missing = np.array([isinstance(one, str | Exception) for one in wanted])
    assert moved.is_dense == (cloud.is_dense and not bad and not failed)
    matrices = np.array([one for one, lacks in zip(wanted, missing, strict=True) if not lacks])
    matrices = matrices.reshape(-1, 4, 4)
    for axes, is_place in (("xyz", True), (NORMAL, False), (VIEWPOINT, True)):
        if not {*axes} <= {*points.dtype.names}:
            continue
        got = xyz_of(points_of(moved, points.dtype), axes)
        assert np.array_equal(np.isnan(got).all(axis=1), missing)
        assert np.array_equal(np.isnan(got).any(axis=1), missing)
        before = xyz_of(points, axes)[~missing]
        exact = np.einsum("nij,nj->ni", matrices[:, :3, :3], before) + is_place * matrices[:, :3, 3]
        distance = np.linalg.norm(before, axis=1, keepdims=True)
        allowed = 2e-6 + 2e-9 * motion.turn
        if is_place:
            rounding = np.abs(exact) * max(np.finfo(points.dtype[axis]).eps for axis in axes)
            allowed = 1e-5 + 1e-6 * distance + rounding + 2e-9 * motion.speed_at(distance)
            allowed += 1e-11 * motion.length
        assert (np.abs(got[~missing] - exact) <= allowed).all()
    new_ns = motion.stamp + SWEEP // 3 if is_fixed else motion.stamp
    assert (moved.header.frame_id, stamp_ns(moved)) == (target, new_ns)
    if is_fixed:
        stored = new_ns / field[2] if name == "timestamp" else 0
        assert (points_of(moved, points.dtype)[name] == np.dtype(kind).type(stored)).all()
    # All else stays.
    assert bytes(cloud.data) == data
    assert (moved.height, moved.width, moved.fields) == (cloud.height, cloud.width, cloud.fields)
    assert (moved.row_step, len(moved.data)) == (cloud.row_step, len(cloud.data))
    assert rows_of(moved)[1] == rows_of(cloud)[1]
    for other in points.dtype.names:
        if other not in ("x", "y", "z", name, *NORMAL, *VIEWPOINT) or (other == name and not is_fixed):
            assert points_of(moved, points.dtype)[other].tobytes() == points[other].tobytes()

"""Clouds of any layout, compared with a model that moves one point after the other."""

import array
import itertools
import mmap
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from making_objects import transform
from sensor_msgs.msg import PointCloud2, PointField

import tf2_sensor_msgs as tf2

pytestmark = pytest.mark.ours

CODES = {PointField.FLOAT32: "f", PointField.FLOAT64: "d"}
HUGE = [2**16, 2**31 - 1, 2**31, 2**32 - 1]
# A quarter turn about z: exact, so that the model need not round as the code does.
TURNED = transform("map", "base", 0, (1, 2, 3), (0, 0, 2**-0.5, 2**-0.5))


def fields_at(offsets, datatype, others=()):
    named = itertools.chain(zip("xyz", offsets, strict=True), others)
    return [PointField(name=name, offset=at, datatype=datatype, count=1) for name, at in named]


@st.composite
def layouts(draw):
    """A cloud: coordinates anywhere in a point, any padding within points, between rows and at the end."""
    datatype = draw(st.sampled_from(list(CODES)))
    size = struct.calcsize(CODES[datatype])
    gaps = draw(st.lists(st.integers(0, 5), min_size=3, max_size=3))
    starts = [sum(gaps[: i + 1]) + i * size for i in range(3)]
    offsets = draw(st.permutations(starts))
    others = [("intensity", 0)] if draw(st.booleans()) else []
    point_step = starts[-1] + size + draw(st.integers(0, 9))
    height, width = draw(st.integers(0, 4)), draw(st.integers(0, 20))
    row_step = width * point_step + draw(st.integers(0, 9))
    used = (height - 1) * row_step + width * point_step if height else 0
    length = draw(st.sampled_from([height * row_step, used]))
    data = array.array("B", [i * 7 % 64 for i in range(length)])
    cloud = PointCloud2(height=height, width=width, point_step=point_step, row_step=row_step, data=data)
    cloud.is_bigendian = draw(st.booleans())
    cloud.fields = fields_at(offsets, datatype, others)
    for row, column, axis in itertools.product(range(height), range(width), range(3)):
        at = row * row_step + column * point_step + offsets[axis]
        struct.pack_into(code_of(cloud), data, at, draw(st.integers(-4, 4)))
    cloud.data = data
    return cloud


def code_of(cloud):
    return (">" if cloud.is_bigendian else "<") + CODES[cloud.fields[0].datatype]


def points_of(cloud, row_step):
    """Each point as its x, y and z, and its bytes without these."""
    code, offsets = code_of(cloud), [field.offset for field in cloud.fields[:3]]
    points = []
    for row, column in itertools.product(range(cloud.height), range(cloud.width)):
        begin = row * row_step + column * cloud.point_step
        point = bytearray(cloud.data[begin : begin + cloud.point_step])
        xyz = tuple(struct.unpack_from(code, point, at)[0] for at in offsets)
        for at in offsets:
            point[at : at + struct.calcsize(code)] = bytes(struct.calcsize(code))
        points.append((xyz, bytes(point)))
    return points


@given(layouts())
def test_points_of_every_layout_move_and_keep_their_other_bytes(cloud):
    got = tf2.do_transform_cloud(cloud, TURNED)
    before = points_of(cloud, cloud.row_step)
    after = points_of(got, got.row_step)
    end = len(before[0][1]) if before else 0
    if len(cloud.fields) == 3:  # as in tf2, whose create_cloud packs such points
        end = max(field.offset for field in cloud.fields) + struct.calcsize(code_of(cloud))
        assert got.point_step == end
    else:
        assert got.point_step == cloud.point_step
    wanted = [((-y + 1, x + 2, z + 3), rest[:end]) for (x, y, z), rest in before]
    for (xyz, rest), (wanted_xyz, wanted_rest) in zip(after, wanted, strict=True):
        assert xyz == pytest.approx(wanted_xyz, abs=1e-6) and rest == wanted_rest


@given(layouts())
def test_padding_within_points_does_not_depend_on_that_between_rows(cloud):
    got = tf2.do_transform_cloud(cloud, TURNED)
    rows = [
        cloud.data[row * cloud.row_step :][: cloud.width * cloud.point_step] for row in range(cloud.height)
    ]
    cloud.row_step = cloud.width * cloud.point_step
    cloud.data = array.array("B", b"".join(row.tobytes() for row in rows))
    packed = tf2.do_transform_cloud(cloud, TURNED)
    assert packed.point_step == got.point_step
    assert points_of(packed, packed.row_step) == points_of(got, got.row_step)


@given(
    height=st.sampled_from([0, 1, *HUGE]),
    width=st.sampled_from([0, 1, *HUGE]),
    point_step=st.sampled_from([12, 16, *HUGE]),
    row_step=st.sampled_from([0, 12, *HUGE]),
    at_the_end=st.booleans(),
    other=st.booleans(),
)
def test_products_of_huge_numbers_are_exact(height, width, point_step, row_step, at_the_end, other):
    offsets = (point_step - 12, point_step - 8, point_step - 4) if at_the_end else (0, 4, 8)
    cloud = PointCloud2(height=height, width=width, point_step=point_step, row_step=row_step)
    cloud.fields = fields_at(offsets, PointField.FLOAT32, [("intensity", 0)] * other)
    if height and width:
        with pytest.raises(ValueError, match=f"data has 0 bytes, less than height {height} x width {width}"):
            tf2.do_transform_cloud(cloud, TURNED)
    elif width * point_step >= 2**32:
        with pytest.raises(ValueError, match=f"width {width} x point_step {point_step} has") as raised:
            tf2.do_transform_cloud(cloud, TURNED)
        assert isinstance(raised.value, TypeError)  # as that of tf2, for the data of such a row
    else:
        got = tf2.do_transform_cloud(cloud, TURNED)
        assert (got.height, got.width, len(got.data)) == (height, width, 0)
        assert 0 <= got.row_step < 2**32


@pytest.mark.parametrize("names", ["xyz", "xyzi"])
def test_a_row_that_row_step_cannot_describe_is_refused_before_it_is_read(names):
    width = 2**32 // 12 + 1
    cloud = PointCloud2(height=1, width=width, point_step=12, row_step=0)
    cloud.fields = fields_at((0, 4, 8), PointField.FLOAT32, [(name, 0) for name in names[3:]])
    with mmap.mmap(-1, 12 * width) as data:  # memory that exists only where it is used
        cloud._data = data
        with pytest.raises(ValueError, match="has 4294967304 bytes, too many for row_step"):
            tf2.do_transform_cloud(cloud, TURNED)

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Clouds of huge sizes; the fuzz target `clouds` compares those of any layout, byte by byte."""

import itertools
import mmap

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import PointCloud2, PointField
from times_and_transforms import transform

import tf2_sensor_msgs as tf2

HUGE = [2**16, 2**31 - 1, 2**31, 2**32 - 1]
MOVED = transform("map", "base", 0, (1, 2, 3))


def floats_at(offsets, others=()):
    named = itertools.chain(zip("xyz", offsets, strict=True), others)
    return [PointField(name=name, offset=at, datatype=PointField.FLOAT32, count=1) for name, at in named]


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
    cloud.fields = floats_at(offsets, [("intensity", 0)] * other)
    if height and width:
        with pytest.raises(ValueError, match=f"data has 0 bytes, less than height {height} x width {width}"):
            tf2.do_transform_cloud(cloud, MOVED)
    elif width * point_step >= 2**32:
        with pytest.raises(ValueError, match=f"width {width} x point_step {point_step} has") as raised:
            tf2.do_transform_cloud(cloud, MOVED)
        assert isinstance(raised.value, TypeError)  # as that of tf2, for the data of such a row
    else:
        got = tf2.do_transform_cloud(cloud, MOVED)
        assert (got.height, got.width, len(got.data)) == (height, width, 0)
        assert 0 <= got.row_step < 2**32


@pytest.mark.parametrize("names", ["xyz", "xyzi"])
def test_a_row_that_row_step_cannot_describe_is_refused_before_it_is_read(names):
    width = 2**32 // 12 + 1
    cloud = PointCloud2(height=1, width=width, point_step=12, row_step=0)
    cloud.fields = floats_at((0, 4, 8), [(name, 0) for name in names[3:]])
    with mmap.mmap(-1, 12 * width) as data:  # memory that exists only where it is used
        cloud._data = data
        with pytest.raises(ValueError, match="has 4294967304 bytes, too many for row_step"):
            tf2.do_transform_cloud(cloud, MOVED)

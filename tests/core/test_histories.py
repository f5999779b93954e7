"""The samples of a buffer as arrays."""

import numpy as np
import pytest
from making import S, transform

from tf2_py import BufferCore

pytestmark = pytest.mark.ours


def test_each_frame_has_its_samples_oldest_first_with_their_parents():
    buffer = BufferCore()
    for parent, sec, x in (("map", 3, 3.0), ("odom", 1, 1.0), ("map", 2, 2.0)):
        buffer.set_transform(transform(parent, "base", sec, (x, 0.0, 0.0)), "test")
    buffer.set_transform_static(transform("base", "camera", 7, (0.5, 0.0, 0.0)), "test")
    found = buffer.histories()
    assert sorted(found) == ["base", "camera"]
    base, camera = found["base"], found["camera"]
    assert (base.frame, base.static, camera.static) == ("base", False, True)
    assert base.parents.tolist() == ["odom", "map", "map"]
    assert base.stamps_ns.tolist() == [1 * S, 2 * S, 3 * S]
    assert base.translations[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert base.rotations.tolist() == [[0.0, 0.0, 0.0, 1.0]] * 3
    assert (camera.parents.tolist(), camera.stamps_ns.tolist()) == (["base"], [7 * S])


def test_they_are_copies():
    buffer = BufferCore()
    buffer.set_transform(transform("map", "base", 1, (1.0, 0.0, 0.0)), "test")
    before = buffer.histories()["base"]
    before.translations[:] = np.nan
    buffer.set_transform(transform("map", "base", 2, (2.0, 0.0, 0.0)), "test")
    assert buffer.histories()["base"].translations[:, 0].tolist() == [1.0, 2.0]
    assert len(before.stamps_ns) == 1


def test_an_empty_buffer_has_none():
    assert BufferCore().histories() == {}

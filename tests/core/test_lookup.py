# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lookups of a BufferCore: times, paths and errors."""

import types

import pytest
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rclpy.time import Time
from times_and_transforms import S, at, stamp_ns, transform, translation


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore(Duration(seconds=100))


def fill(buffer, *edges):
    """Edges 'parent child' at the seconds given, x = second; no seconds: static."""
    for names, *seconds in edges:
        parent, child = names.split()
        for second in seconds:
            buffer.set_transform(transform(parent, child, second, (second, 0, 0)), "x")
        if not seconds:
            buffer.set_transform_static(transform(parent, child, 0, (1, 0, 0)), "x")


class TestTime:
    @pytest.mark.tf2
    def test_the_latest_common_time_is_a_system_time(self, buffer):
        fill(buffer, ("map odom", 1, 5))
        time = buffer.get_latest_common_time("odom", "map")
        assert isinstance(time, Time)
        assert (time.nanoseconds, time.clock_type) == (5 * S, ClockType.SYSTEM_TIME)

    def test_the_last_representable_times_are_read_exactly(self, buffer):
        fill(buffer, ("map odom",))
        for edge, step in ((2**31 * S - 1, 1), (-(2**31) * S, -1)):
            for time in (
                types.SimpleNamespace(nanoseconds=edge),
                types.SimpleNamespace(sec=edge // S, nanosec=edge % S),
            ):
                assert stamp_ns(buffer.lookup_transform_core("map", "odom", time)) == edge
            for time in (
                types.SimpleNamespace(nanoseconds=edge + step),
                types.SimpleNamespace(sec=edge // S, nanosec=edge % S + step),
                types.SimpleNamespace(nanoseconds=step * 2**62),
            ):
                for call in (
                    lambda time=time: buffer.lookup_transform_core("map", "odom", time),
                    lambda time=time: buffer.lookup_transform_full_core("map", time, "odom", at(1), "map"),
                    lambda time=time: buffer.lookupVelocityCore("odom", "map", time, Duration()),
                ):
                    with pytest.raises(OverflowError):
                        call()


class TestPath:
    @pytest.mark.parametrize("looped", [pytest.param(False, marks=pytest.mark.tf2), True])
    def test_a_thousand_hops_are_allowed_on_each_side(self, tf2_py, buffer, looped):
        if looped:
            fill(buffer, ("a b",), ("b a",))
        for side in "lr":
            for i in range(1003):
                parent = f"{side}{i}" if i else "root"
                buffer.set_transform_static(transform(parent, f"{side}{i + 1}", 0, (1, 0, 0)), "x")
        assert translation(buffer.lookup_transform_core("r1000", "l1000", at(0))) == (0, 0, 0)
        assert buffer.get_latest_common_time("r1000", "l1000").nanoseconds == 0
        with pytest.raises(tf2_py.LookupException, match="contains a loop"):
            buffer.lookup_transform_core("r1001", "l1001", at(0))
        if looped:
            for target, source in (("r1001", "l1000"), ("r1000", "l1001")):
                with pytest.raises(tf2_py.LookupException, match="contains a loop"):
                    buffer.lookup_transform_core(target, source, at(1))
            with pytest.raises(tf2_py.TransformException):
                buffer.get_latest_common_time("r1001", "l1000")

    @pytest.mark.tf2
    def test_a_chain_lacks_the_halves_with_unknown_ends(self, buffer):
        assert buffer._chain("nowhere", at(0), "nobody", at(0), "nothing") == []
        fill(buffer, ("map odom",), ("odom base",))
        for target in ("map", "base", "nowhere", ""):
            assert buffer._chain(target, at(0), "nobody", at(0), "nothing") == []
        assert buffer._chain("nowhere", at(0), "map", at(0), "base") == ["map", "odom", "base"]

    def test_hops_above_the_common_ancestor_do_not_count(self, buffer):
        for i in range(1500):
            buffer.set_transform_static(transform(f"f{i}", f"f{i + 1}", 0, (1, 0, 0)), "x")
        assert translation(buffer.lookup_transform_core("f1490", "f1500", at(0))) == (10, 0, 0)


class TestErrors:
    @pytest.mark.parametrize(
        ("name", "error"),
        [("a\0b", ValueError), ("\udc80", UnicodeEncodeError), (b"map", TypeError), (3, TypeError)],
    )
    def test_a_name_that_is_no_text_is_refused_everywhere(self, buffer, name, error):
        for call in (
            lambda: buffer.lookup_transform_core(name, "b", at(0)),
            lambda: buffer.lookup_transform_core("b", name, at(0)),
            lambda: buffer.lookup_transform_full_core("b", at(0), "c", at(0), name),
            lambda: buffer.can_transform_core("b", name, at(0)),
            lambda: buffer.can_transform_full_core("b", at(0), name, at(0), "c"),
            lambda: buffer.get_latest_common_time("b", name),
            lambda: buffer._frameExists(name),
            lambda: buffer.parent(name),
            lambda: buffer.children(name),
            lambda: buffer.path("b", name),
            lambda: buffer._chain(name, at(0), "b", at(0), "c"),
            lambda: buffer._chain("b", at(0), "c", at(0), name),
        ):
            with pytest.raises(error):
                call()

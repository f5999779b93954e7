"""What a BufferCore answers."""

import math
import threading
import types

import pytest
from making import S, about_z, at, rotation, stamp_ns, transform, translation
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rclpy.time import Time


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
    def test_equal_names_are_the_identity_even_for_a_name_nobody_has_seen(self, buffer):
        for name in ("nowhere", "", "/x"):
            m = buffer.lookup_transform_core(name, name, at(5))
            assert (translation(m), rotation(m), stamp_ns(m)) == ((0, 0, 0), (0, 0, 0, 1), 5 * S)
            assert buffer.can_transform_core(name, name, at(5)) == (1, "")

    def test_the_latest_common_time_is_a_system_time(self, buffer):
        fill(buffer, ("map odom", 1, 5))
        time = buffer.get_latest_common_time("odom", "map")
        assert isinstance(time, Time)
        assert (time.nanoseconds, time.clock_type) == (5 * S, ClockType.SYSTEM_TIME)

    def test_no_latest_common_time_is_a_plain_transform_exception(self, tf2_py, buffer):
        fill(buffer, ("map odom", 1), ("a b", 1))
        with pytest.raises(tf2_py.TransformException) as caught:
            buffer.get_latest_common_time("map", "b")
        assert type(caught.value) is tf2_py.TransformException

    @pytest.mark.parametrize(
        "time",
        [
            Time(nanoseconds=1_500_000_000),
            Time(nanoseconds=1_500_000_000).to_msg(),
            types.SimpleNamespace(sec=1, nanosec=500_000_000),
            types.SimpleNamespace(nanoseconds=1_500_000_000),
        ],
        ids=["rclpy", "message", "sec_nanosec", "nanoseconds"],
    )
    def test_a_time_is_anything_with_its_fields(self, buffer, time):
        fill(buffer, ("map odom", 1, 2))
        assert translation(buffer.lookup_transform_core("map", "odom", time)) == (1.5, 0, 0)

    @pytest.mark.parametrize("time", [True, 1.5, None, "1"])
    def test_what_is_no_time_is_a_type_error(self, buffer, time):
        with pytest.raises(TypeError):
            buffer.lookup_transform_core("map", "odom", time)

    @pytest.mark.ours
    @pytest.mark.parametrize(
        "time", [types.SimpleNamespace(nanoseconds=2**63), types.SimpleNamespace(sec=10**11, nanosec=0)]
    )
    def test_a_time_beyond_64_bits_is_an_overflow_error(self, buffer, time):
        with pytest.raises(OverflowError):
            buffer.lookup_transform_core("map", "odom", time)

    @pytest.mark.ours
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
                for call in every_question(buffer, time):
                    with pytest.raises(OverflowError):
                        call()


def every_question(buffer, time):
    """Calls that ask for a transform at a time, one for each way to ask."""
    now = at(1)
    return [
        lambda: buffer.lookup_transform_core("map", "odom", time),
        lambda: buffer.can_transform_core("map", "odom", time),
        lambda: buffer.lookup_transform_full_core("map", time, "odom", now, "map"),
        lambda: buffer.can_transform_full_core("map", now, "odom", time, "map"),
        lambda: buffer._wait("map", "odom", time),
        lambda: buffer._chain("map", now, "odom", time, "map"),
        lambda: buffer.lookupVelocityCore("odom", "map", time, now),
        lambda: buffer.lookup_transforms("map", "odom", [S], fixed_frame="map", target_time=time),
    ]


class TestPath:
    def test_a_thousand_hops_are_allowed_on_each_side(self, tf2_py, buffer):
        for i in range(1001):
            buffer.set_transform_static(transform(f"l{i}", f"l{i + 1}", 0, (1, 0, 0)), "x")
            buffer.set_transform_static(
                transform("l0" if i == 0 else f"r{i}", f"r{i + 1}", 0, (1, 0, 0)), "x"
            )
        assert translation(buffer.lookup_transform_core("r1000", "l1000", at(0))) == (0, 0, 0)
        with pytest.raises(tf2_py.LookupException, match="contains a loop"):
            buffer.lookup_transform_core("r1001", "l1001", at(0))

    @pytest.mark.ours
    def test_as_many_hops_are_allowed_in_a_tree_that_once_had_a_loop(self, tf2_py, buffer):
        fill(buffer, ("a b",), ("b a",))
        for side in "lr":
            for i in range(1003):
                parent = f"{side}{i}" if i else "root"
                buffer.set_transform_static(transform(parent, f"{side}{i + 1}", 0, (1, 0, 0)), "x")
        assert translation(buffer.lookup_transform_core("r1000", "l1000", at(0))) == (0, 0, 0)
        assert buffer.get_latest_common_time("r1001", "l1000").nanoseconds == 0
        for target, source in (("r1001", "l1000"), ("r1000", "l1001")):
            with pytest.raises(tf2_py.LookupException, match="contains a loop"):
                buffer.lookup_transform_core(target, source, at(1))
        with pytest.raises(tf2_py.TransformException):
            buffer.get_latest_common_time("r1002", "l1000")

    @pytest.mark.ours
    def test_hops_above_the_common_ancestor_do_not_count(self, buffer):
        for i in range(1500):
            buffer.set_transform_static(transform(f"f{i}", f"f{i + 1}", 0, (1, 0, 0)), "x")
        assert translation(buffer.lookup_transform_core("f1490", "f1500", at(0))) == (10, 0, 0)


class TestErrors:
    @pytest.mark.parametrize("call", ["lookup", "can"])
    @pytest.mark.parametrize(
        ("name", "error", "phrase"),
        [
            ("", "InvalidArgumentException", "cannot be empty"),
            ("/odom", "InvalidArgumentException", "cannot start with a '/'"),
            ("nowhere", "LookupException", "does not exist"),
            ("NO_PARENT", "LookupException", "does not exist"),
        ],
    )
    def test_names_are_checked_target_first(self, tf2_py, buffer, call, name, error, phrase):
        fill(buffer, ("map odom",))
        other = "elsewhere"
        for target, source in ((name, "odom"), ("odom", name), (name, other)):
            if call == "can":
                possible, reason = buffer.can_transform_core(target, source, at(0))
                assert possible == 0
            else:
                with pytest.raises(getattr(tf2_py, error)) as caught:
                    buffer.lookup_transform_core(target, source, at(0))
                reason = str(caught.value)
            assert phrase in reason
            assert other not in reason

    @pytest.mark.ours
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
        ):
            with pytest.raises(error):
                call()

    @pytest.mark.ours
    def test_an_extrapolation_names_its_edge_its_times_and_both_ends(self, tf2_py, buffer):
        fill(buffer, ("map odom", 1, 9), ("odom base", 1, 2.25), ("base camera",))
        with pytest.raises(tf2_py.ExtrapolationException) as caught:
            buffer.lookup_transform_core("map", "camera", at(2.5))
        text = str(caught.value)
        for part in ("2.500000000", "2.250000000", "[camera]", "[map]", "0.250000000 s"):
            assert part in text
        assert "base in odom" in text
        with pytest.raises(
            tf2_py.ExtrapolationException, match=r"into the past.* 0\.500000000 s are missing"
        ):
            buffer.lookup_transform_core("map", "camera", at(0.5))

    @pytest.mark.ours
    def test_an_extrapolation_into_the_past_names_the_parent_of_the_oldest_sample(self, tf2_py, buffer):
        fill(buffer, ("map cup", 2), ("hand cup", 3))
        with pytest.raises(tf2_py.ExtrapolationException, match="before the oldest sample of cup in map"):
            buffer.lookup_transform_core("map", "cup", at(1))
        with pytest.raises(tf2_py.ExtrapolationException, match="after the newest sample of cup in hand"):
            buffer.lookup_transform_core("hand", "cup", at(4))

    @pytest.mark.parametrize(
        "name",
        [
            "LookupException",
            "ConnectivityException",
            "ExtrapolationException",
            "InvalidArgumentException",
            "TimeoutException",
        ],
    )
    def test_every_error_is_a_transform_exception(self, tf2_py, name):
        assert issubclass(getattr(tf2_py, name), tf2_py.TransformException)
        assert issubclass(tf2_py.TransformException, Exception)


class TestInterpolation:
    @pytest.mark.parametrize("angle", [1e-9, 1e-4, 0.1, 0.49, 0.51, 1.0, 3.0, math.pi, 5.0])
    @pytest.mark.parametrize("ratio", [0.0, 0.1, 0.5, 0.75, 1.0])
    def test_rotation_turns_evenly_along_the_shorter_way(self, buffer, angle, ratio):
        buffer.set_transform(transform("map", "odom", 1, xyzw=about_z(0)), "x")
        buffer.set_transform(transform("map", "odom", 2, xyzw=about_z(angle)), "x")
        shorter = angle if angle <= math.pi else angle - 2 * math.pi
        x, y, z, w = rotation(buffer.lookup_transform_core("map", "odom", at(1 + ratio)))
        turned = 2 * math.atan2(z, w)
        assert (x, y) == (0, 0)
        assert math.remainder(turned - ratio * shorter, 2 * math.pi) == pytest.approx(0, abs=1e-14)
        assert x * x + y * y + z * z + w * w == pytest.approx(1, abs=1e-14)


@pytest.mark.ours
def test_readers_and_writers_in_many_threads_see_whole_samples(buffer):
    # Every sample says its number in each coordinate: a torn one would disagree with itself.
    stop = threading.Event()
    failures = []

    def write(child):
        i = 0
        while not stop.is_set():
            i += 1
            buffer.set_transform(transform("map", child, ns=i * 1000, xyz=(i, i, i)), "x")

    def read():
        seen = 0
        while seen < 3000:
            if not buffer.can_transform_core("a", "b", at(0))[0]:
                continue
            x, y, z = translation(buffer.lookup_transform_core("map", "a", at(0)))
            if not x == y == z:
                failures.append((x, y, z))
            seen += 1

    writers = [threading.Thread(target=write, args=(child,)) for child in "ab"]
    readers = [threading.Thread(target=read) for _ in range(2)]
    for thread in writers + readers:
        thread.start()
    for thread in readers:
        thread.join()
    stop.set()
    for thread in writers:
        thread.join()
    assert failures == []
    buffer._self_check()

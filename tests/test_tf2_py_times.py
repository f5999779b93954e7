"""Times and durations as nanoseconds; rclpy's Time is read by the layout of its handle where that holds."""

from types import SimpleNamespace

import pytest
import rclpy.time
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_py._internal import FOR_EVER_NS, duration_ns, stamp_parts, time_ns

pytestmark = pytest.mark.ours


@pytest.mark.parametrize("ns", [0, 1, 10**18 + 7, 2**63 - 1])
def test_an_rclpy_time_is_read(ns):
    assert time_ns(Time(nanoseconds=ns), "time") == ns
    assert time_ns(Time(nanoseconds=ns), "time") == ns, "after its class is known"


class OtherTime:
    """Stands where rclpy's Time was, with a handle of another kind."""

    def __init__(self, *, nanoseconds=0):
        self._time_handle = SimpleNamespace()
        self.nanoseconds = nanoseconds


class HandlelessTime:
    def __init__(self, *, nanoseconds=0):
        self.nanoseconds = nanoseconds


class TimeWithAnotherNumber(Time):
    """The handle is rclpy's, but it does not hold the number that the class tells."""

    nanoseconds = property(lambda self: 7)


@pytest.mark.parametrize("cls", [OtherTime, HandlelessTime, TimeWithAnotherNumber])
def test_a_class_whose_handle_lies_otherwise_is_asked_by_its_property(monkeypatch, cls):
    with monkeypatch.context() as patch:
        patch.setattr(rclpy.time, "Time", cls)
        for _ in range(2):
            assert time_ns(cls(nanoseconds=5), "time") == cls(nanoseconds=5).nanoseconds
    assert time_ns(Time(nanoseconds=11), "time") == 11


def test_what_is_no_time_is_named():
    with pytest.raises(
        TypeError, match="target_time must have nanoseconds, or sec and nanosec; str has neither"
    ):
        time_ns("now", "target_time")


def test_a_duration_that_does_not_fit_is_for_ever():
    assert duration_ns(Duration(seconds=2), "timeout") == 2 * 10**9
    assert duration_ns(SimpleNamespace(nanoseconds=float("inf")), "timeout") == FOR_EVER_NS
    assert duration_ns(SimpleNamespace(nanoseconds=-(2**80)), "timeout") == -FOR_EVER_NS
    with pytest.raises(TypeError, match="^tolerance is"):
        duration_ns(3.0, "tolerance")


@pytest.mark.parametrize("ns", [0, 1_999_999_999, -1, -1_000_000_000])
def test_the_parts_of_a_stamp_give_it_again(ns):
    sec, nanosec = stamp_parts(ns)
    assert 0 <= nanosec < 10**9
    assert sec * 10**9 + nanosec == ns

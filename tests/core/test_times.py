"""Times and durations as nanoseconds; rclpy's Time is read by the layout of its handle where that holds."""

import datetime
import math
from decimal import Decimal
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy.time
from builtin_interfaces.msg import Time as TimeMsg
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_py._internal import FOR_EVER_NS, duration_ns, stamp_parts, time_ns

pytestmark = pytest.mark.ours


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


def test_a_duration_that_does_not_fit_is_for_ever():
    assert duration_ns(Duration(seconds=2), "timeout") == 2 * 10**9
    assert duration_ns(SimpleNamespace(nanoseconds=float("inf")), "timeout") == FOR_EVER_NS
    assert duration_ns(SimpleNamespace(nanoseconds=-(2**80)), "timeout") == -FOR_EVER_NS


@pytest.mark.parametrize("ns", [0, 1_999_999_999, -1, -1_000_000_000])
def test_the_parts_of_a_stamp_give_it_again(ns):
    sec, nanosec = stamp_parts(ns, "time")
    assert 0 <= nanosec < 10**9
    assert sec * 10**9 + nanosec == ns


def test_a_stamp_that_no_message_carries_is_an_overflow_error():
    with pytest.raises(OverflowError, match="does not fit into the stamp of a message"):
        stamp_parts(2**31 * 10**9, "time")


@pytest.mark.parametrize("ns", [0, 1, -1, 10**18 + 7, 2**63 - 1, -(2**63)])
def test_an_integer_is_nanoseconds(ns):
    assert time_ns(ns, "time") == ns
    assert time_ns(np.int64(ns), "time") == ns


@pytest.mark.parametrize("beyond", [2**63, -(2**63) - 1, np.uint64(2**63)])
def test_an_integer_beyond_64_bits_is_an_overflow_error(beyond):
    with pytest.raises(OverflowError, match="^time = .* does not fit into 64-bit nanoseconds"):
        time_ns(beyond, "time")


@pytest.mark.parametrize(
    ("text", "unit", "ns"),
    [
        ("1971", "Y", 365 * 86400 * 10**9),
        ("1970-02", "M", 31 * 86400 * 10**9),
        ("1969-12-31", "D", -86400 * 10**9),
        ("2024-01-01T00:00:00", "s", 1704067200 * 10**9),
        ("2024-01-01T00:00:00.123456789", "ns", 1704067200123456789),
        ("1970-01-01T00:00:00.000000002000", "ps", 2),
        ("2262-04-11T23:47:16.854775807", "ns", 2**63 - 1),
    ],
)
def test_a_datetime64_of_any_unit_is_converted_exactly(text, unit, ns):
    assert time_ns(np.datetime64(text, unit), "time") == ns


@pytest.mark.parametrize("text", ["2262-04-12", "1677-09-21", "3000", "1970-01-01T00:00:00.000000000001"])
def test_a_datetime64_that_64_bits_of_nanoseconds_cannot_hold_is_an_overflow_error(text):
    with pytest.raises(OverflowError, match="^time: expected whole nanoseconds within 64 bits, got "):
        time_ns(np.datetime64(text), "time")


@pytest.mark.parametrize("unit", ["ns", "s", "D"])
def test_nat_is_no_time(unit):
    with pytest.raises(ValueError, match="^time is NaT"):
        time_ns(np.datetime64("NaT", unit), "time")


@pytest.mark.parametrize("zone", [None, "UTC", "Asia/Tokyo"])
@pytest.mark.parametrize("unit", ["s", "ns"])
def test_a_timestamp_of_pandas_is_its_nanoseconds(zone, unit):
    pandas = pytest.importorskip("pandas")
    ns = 1704067200 * 10**9 + (7 if unit == "ns" else 0)
    stamp = pandas.Timestamp(ns, unit="ns", tz=zone).as_unit(unit)
    assert time_ns(stamp, "time") == ns == stamp.as_unit("ns").value
    with pytest.raises(ValueError, match="^time is NaT"):
        time_ns(pandas.NaT, "time")


def test_a_datetime_of_python_may_be_of_any_time_zone():
    with pytest.raises(TypeError, match="got datetime: use Time"):
        time_ns(datetime.datetime(2024, 1, 1), "time")


class Timedelta(datetime.timedelta):
    """As that of pandas, whose ``nanoseconds`` are the part below a microsecond."""

    nanoseconds = 0


@pytest.mark.parametrize("of", [datetime.timedelta, Timedelta])
def test_a_timedelta_is_a_duration_and_no_time(of):
    assert duration_ns(of(seconds=2, microseconds=5), "timeout") == 2 * 10**9 + 5000
    assert duration_ns(of(days=-1), "timeout") == -86400 * 10**9
    assert duration_ns(of.max, "timeout") == FOR_EVER_NS
    with pytest.raises(TypeError, match=rf"^time is a {of.__name__}: use Time\(seconds="):
        time_ns(of(seconds=2), "time")


@pytest.mark.parametrize(
    "wrong", [1.5, np.float32(1), True, np.True_, None, np.timedelta64(1, "s"), Decimal(1)], ids=repr
)
def test_what_is_no_time_is_refused_with_what_to_use(wrong):
    with pytest.raises(TypeError) as refused:
        time_ns(wrong, "time")
    assert str(refused.value).endswith(
        ": use Time(seconds=...), node.get_clock().now(), an int of nanoseconds, a datetime64, or "
        "Time() for the latest"
    )
    assert refused.value.__context__ is None


@pytest.mark.parametrize(
    ("seconds", "ns"),
    [
        (2, 2 * 10**9),
        (-1, -(10**9)),
        (0.1, 10**8),
        (-0.5, -5 * 10**8),
        (np.float32(0.5), 5 * 10**8),
        (np.int8(100), 100 * 10**9),
        (Fraction(1, 4), 25 * 10**7),
        (math.inf, FOR_EVER_NS),
        (-math.inf, -FOR_EVER_NS),
        (1e300, FOR_EVER_NS),
        (10**400, FOR_EVER_NS),
    ],
)
def test_a_number_as_a_duration_is_seconds(seconds, ns):
    assert duration_ns(seconds, "timeout") == ns


@pytest.mark.parametrize(
    "wrong", [True, np.True_, None, "2", np.timedelta64(2, "s"), np.datetime64(2, "s"), Decimal(2)], ids=repr
)
def test_what_is_no_duration_is_refused_with_what_to_use(wrong):
    with pytest.raises(TypeError, match=r"^timeout: expected a duration or seconds, got .*: use Duration"):
        duration_ns(wrong, "timeout")


@pytest.mark.parametrize("nan", [math.nan, np.float32("nan")])
def test_nan_is_no_duration(nan):
    with pytest.raises(ValueError, match="^padding is NaN"):
        duration_ns(nan, "padding")


@pytest.mark.parametrize("time", [Time(seconds=2), TimeMsg(sec=2)], ids=["rclpy", "message"])
def test_a_time_is_no_duration(time):
    with pytest.raises(TypeError, match="^timeout: expected a duration, got a Time"):
        duration_ns(time, "timeout")

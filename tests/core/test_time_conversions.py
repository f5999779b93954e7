# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
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

DAY = 86400 * 10**9  # ns


class HandlelessTime:
    def __init__(self, *, nanoseconds=0):
        self.nanoseconds = nanoseconds


class OtherTime(HandlelessTime):
    """Stands where rclpy's Time was, with a handle of another kind."""

    _time_handle = SimpleNamespace()


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


def test_the_parts_of_a_stamp_give_it_again():
    parts = [stamp_parts(ns, "time") for ns in (0, 1_999_999_999, -1, -1_000_000_000)]
    assert parts == [(0, 0), (1, 999_999_999), (-1, 999_999_999), (-1, 0)]
    with pytest.raises(OverflowError, match="does not fit into the stamp of a message"):
        stamp_parts(2**31 * 10**9, "time")


@pytest.mark.parametrize(
    ("time", "ns"),
    [
        *[(ns, ns) for ns in (0, 1, -1, 10**18 + 7, 2**63 - 1, -(2**63))],
        *[(np.int64(ns), ns) for ns in (0, 10**18 + 7, 2**63 - 1, -(2**63))],
        (np.datetime64("1971", "Y"), 365 * DAY),
        (np.datetime64("1970-02", "M"), 31 * DAY),
        (np.datetime64("1969-12-31", "D"), -DAY),
        (np.datetime64("2024-01-01T00:00:00", "s"), 1704067200 * 10**9),
        (np.datetime64("2024-01-01T00:00:00.123456789", "ns"), 1704067200123456789),
        (np.datetime64("1970-01-01T00:00:00.000000002000", "ps"), 2),
        (np.datetime64("2262-04-11T23:47:16.854775807", "ns"), 2**63 - 1),
    ],
    ids=repr,
)
def test_a_time_is_converted_exactly(time, ns):
    assert time_ns(time, "time") == ns


@pytest.mark.long("needs pandas")
@pytest.mark.parametrize("zone", [None, "UTC", "Asia/Tokyo"])
@pytest.mark.parametrize("unit", ["s", "ns"])
def test_a_timestamp_of_pandas_is_its_nanoseconds(zone, unit):
    pandas = pytest.importorskip("pandas")
    ns = 1704067200 * 10**9 + (7 if unit == "ns" else 0)
    stamp = pandas.Timestamp(ns, unit="ns", tz=zone).as_unit(unit)
    assert time_ns(stamp, "time") == ns == stamp.as_unit("ns").value
    with pytest.raises(ValueError, match="^time: expected a time, got NaT"):
        time_ns(pandas.NaT, "time")


class Timedelta(datetime.timedelta):
    """As that of pandas, whose ``nanoseconds`` are the part below a microsecond."""

    nanoseconds = 0


@pytest.mark.parametrize(
    ("duration", "ns"),
    [
        (2, 2 * 10**9),
        (-1, -(10**9)),
        (0.1, 10**8),
        (-0.5, -5 * 10**8),
        (np.float32(0.5), 5 * 10**8),
        (np.int8(100), 100 * 10**9),
        (Fraction(1, 4), 25 * 10**7),
        (Duration(seconds=2), 2 * 10**9),
        (datetime.timedelta(seconds=2, microseconds=5), 2 * 10**9 + 5000),
        (Timedelta(seconds=2, microseconds=5), 2 * 10**9 + 5000),
        (Timedelta(days=-1), -DAY),
        # What does not fit is for ever.
        *[(more, FOR_EVER_NS) for more in (math.inf, 1e300, 10**400, datetime.timedelta.max, Timedelta.max)],
        (SimpleNamespace(nanoseconds=math.inf), FOR_EVER_NS),
        (-math.inf, -FOR_EVER_NS),
        (SimpleNamespace(nanoseconds=-(2**80)), -FOR_EVER_NS),
    ],
    ids=repr,
)
def test_a_duration_is_in_seconds_or_says_its_nanoseconds(duration, ns):
    assert duration_ns(duration, "timeout") == ns


USE_A_TIME = (
    r": use Time\(seconds=\.\.\.\), node\.get_clock\(\)\.now\(\), an int of nanoseconds, a datetime64, or "
    r"Time\(\) for the latest$"
)


TOO_MANY = "^x = .* does not fit into 64-bit nanoseconds"
NOT_WHOLE = "^x: expected whole nanoseconds within 64 bits, got "
PICOSECOND = "1970-01-01T00:00:00.000000000001"
DATES = [np.datetime64(one) for one in ("2262-04-12", "1677-09-21", "3000", PICOSECOND)]
USE_A_DURATION = r"^x: expected a duration or seconds, got .*: use Duration"
NO_DURATIONS = [True, np.True_, None, "2", np.timedelta64(2, "s"), np.datetime64(2, "s"), Decimal(2)]
DELTAS = [datetime.timedelta(2), Timedelta(2)]


@pytest.mark.parametrize(
    ("convert", "error", "text", "wrong"),
    [
        (time_ns, OverflowError, TOO_MANY, [2**63, -(2**63) - 1, np.uint64(2**63)]),
        (time_ns, OverflowError, NOT_WHOLE, DATES),
        (
            time_ns,
            ValueError,
            "^x: expected a time, got NaT",
            [np.datetime64("NaT", unit) for unit in ("ns", "s", "D")],
        ),
        (time_ns, TypeError, "got datetime: use Time", [datetime.datetime(2024, 1, 1)]),
        (time_ns, TypeError, r"^x: expected a time, got (T|t)imedelta: use Time\(seconds=", DELTAS),
        (time_ns, TypeError, USE_A_TIME, [1.5, np.float32(1), True, np.True_, None]),
        (time_ns, TypeError, USE_A_TIME, [np.timedelta64(1, "s"), Decimal(1)]),
        (duration_ns, TypeError, USE_A_DURATION, NO_DURATIONS),
        (duration_ns, ValueError, "^x: expected .* NaN", [math.nan, np.float32("nan")]),
        (duration_ns, TypeError, "^x: expected a duration, got a Time", [Time(seconds=2), TimeMsg(sec=2)]),
    ],
)
def test_what_is_none_is_refused_with_what_to_use(convert, error, text, wrong):
    for one in wrong:
        with pytest.raises(error, match=text) as refused:
            convert(one, "x")
        assert error is OverflowError or refused.value.__context__ is None, one

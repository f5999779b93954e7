# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lookups at many times in one call: the same answers as as many calls."""

import math
from functools import partial
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
from messages_with_or_without_ros import Duration, Time
from rotations import Turn
from times_and_transforms import S, about_z, at, at_ns, rotation, transform, translation

from tf2_py import BufferCore, ExtrapolationException, LookupException
from tf2_ros.numpy import to_columns

NAT = -(2**63)  # as an integer
FRAMES = ["map", "odom", "base", "arm", "hand", "mast", "camera", "plate", "lens"]
POLICIES = [
    {"tolerance": 0.3},
    {"tolerance": 0.3, "extrapolate": True},
    {"max_gap": 0.02},
    {"tolerance": 0.5, "extrapolate": True, "max_gap": 0.02},
]


@pytest.fixture(scope="module")
def buffer(tf2_ros):
    """Moving, still and jerky edges: map > odom > base > (arm > hand), (mast > camera > plate > lens)."""
    random = np.random.default_rng(3)
    buffer = tf2_ros.Buffer(Duration(seconds=1000))
    for parent, child, step in (
        ("map", "odom", 0.01),
        ("odom", "base", 0.05),
        ("base", "arm", 0.2),
        ("arm", "hand", 2.0),  # far turns between neighbors
        ("mast", "camera", 1e-9),
    ):
        turns = Turn.from_vector(np.cumsum(random.normal(scale=step, size=(300, 3)), axis=0)).q
        places = np.cumsum(random.normal(size=(300, 3)), axis=0)
        stamps = np.cumsum(random.integers(1_000_000, 30_000_000, 300)) + S
        rows = zip(stamps.tolist(), places, turns, strict=True)
        buffer.set_transforms([transform(parent, child, ns=t, xyz=p, xyzw=q) for t, p, q in rows], "x")
    buffer.set_transform_static(transform("base", "mast", xyz=(-0.0, 2, 3), xyzw=about_z(2.5)), "x")
    buffer.set_transform_static(transform("camera", "plate", xyz=(0.1, 0, -0.0), xyzw=about_z(0.7)), "x")
    buffer.set_transform_static(transform("plate", "lens", xyz=(0.3, -7, 0.2), xyzw=about_z(-1.9)), "x")
    return buffer


def span(buffer, target, source):
    newest = buffer.get_latest_common_time(target, source).nanoseconds
    return (S + 30_000_000, newest) if newest else (1, 10 * S)


def span_of_all(buffer):
    return span(buffer, "map", "hand")[0], min(span(buffer, "map", frame)[1] for frame in ("hand", "plate"))


def rows_of(ask, times, width=7):
    """Rows of numbers of as many calls for one time; NaN: there is no answer."""
    rows = []
    for ns in times:
        try:
            rows.append(ask(at_ns(int(ns))))
        except ExtrapolationException:
            rows.append((np.nan,) * width)
    return np.array(rows).reshape(-1, width)


def look_up(buffer, target, source, time, fixed_frame=None, target_time=None, **policy):
    if fixed_frame is None:
        return buffer.lookup_transform(target, source, time, **policy)
    return buffer.lookup_transform_full(target, target_time, source, time, fixed_frame, **policy)


def singles(buffer, target, source, times, **options):
    def ask(time):
        m = look_up(buffer, target, source, time, **options)
        return *translation(m), *rotation(m)

    return rows_of(ask, times)


def assert_same_numbers(series, rows):
    got, missing = np.hstack(series), np.isnan(rows).any(axis=1)
    assert got.shape == rows.shape
    assert got.dtype == np.float64
    assert np.isnan(got[missing]).all()
    np.testing.assert_allclose(got[~missing], rows[~missing], rtol=1e-13, atol=1e-13)


def check(buffer, target, source, times, **options):
    """Rows are those of single lookups, and the first one without an answer is the error."""
    rows = singles(buffer, target, source, times, **options)
    series = buffer.lookup_transforms(target, source, times, on_missing="nan", **options)
    assert_same_numbers(series, rows)
    missing = np.flatnonzero(np.isnan(rows[:, 0]))
    if len(missing):
        with pytest.raises(ExtrapolationException) as error:
            buffer.lookup_transforms(target, source, times, **options)
        with pytest.raises(ExtrapolationException) as single:
            look_up(buffer, target, source, at_ns(int(times[missing[0]])), **options)
        assert str(error.value) == f"times[{missing[0]}]: {single.value}"
    else:
        assert_same_numbers(buffer.lookup_transforms(target, source, times, **options), rows)


TWO_TIMES = [{"fixed_frame": "map", "target_time": time} for time in (at(0), at(4))]


@pytest.mark.parametrize("options", [{}, *POLICIES, *TWO_TIMES], ids=str)
@pytest.mark.parametrize("source", FRAMES)
def test_the_numbers_are_those_of_single_lookups(buffer, source, options):
    for target in ("base", "map") if options else FRAMES:
        low, high = span(buffer, target, source)
        times = np.random.default_rng(1).integers(low, high, 150)
        times[::20] = 0
        times[3] = high
        check(buffer, target, source, times, **options)
        times[40:80] += S // 2
        times[[81, 99, 149]] = (high + 1, 1, 2**31 * S - 1)
        check(buffer, target, source, times, **options)


def test_any_number_of_times(buffer):
    low, high = span(buffer, "map", "hand")
    for count in (0, 1, 2, 63, 64, 65, 255, 256, 257, 1000):
        times = np.linspace(low, high + S, count).astype(np.int64)
        check(buffer, "map", "hand", times[times <= high])
        check(buffer, "map", "hand", times)


def test_at_the_oldest_stamp_the_first_of_equal_samples_answers_after_any_other_time(tf2_ros):
    """Directly after that stamp, the last of them does."""
    buffer = tf2_ros.Buffer()
    for ns, x in ((S, 0), (S, 1), (S + 10, 2)):
        buffer.set_transform(transform("map", "odom", ns=ns, xyz=(x, 0, 0)), "x")
    for times in permutations([S, S + 1, S + 9, S + 10]):
        check(buffer, "map", "odom", times)


# What times may be.

NS = [2 * S + 30_000_000, 3 * S, 4 * S]


def dates(ns, unit):
    return np.array(ns).view("M8[ns]").astype(f"M8[{unit}]")


needs_pandas = pytest.mark.long("needs pandas")


def pandas_index(ns, unit="ns", zone=None):
    index = pytest.importorskip("pandas").DatetimeIndex(dates(ns, unit))
    return index if zone is None else index.tz_localize("UTC").tz_convert(zone)


OF_PANDAS = {
    **{
        f"pandas, {unit}, {zone}": partial(pandas_index, unit=unit, zone=zone)
        for unit in ("ms", "us", "ns")
        for zone in (None, "UTC", "Asia/Tokyo")
    },
    "list of pandas": lambda ns: list(pandas_index(ns)),
    "Series": lambda ns: pytest.importorskip("pandas").Series(pandas_index(ns), index=[7, 8, 9]),
}
FORMS = {
    "list": list,
    "tuple": tuple,
    "int64": np.array,
    "uint64": lambda ns: np.array(ns, np.uint64),
    "strided": lambda ns: np.repeat(np.array(ns), 2)[::2],
    "backwards": lambda ns: np.array(ns[::-1])[::-1],
    "read-only": lambda ns: np.frombuffer(np.array(ns).tobytes(), np.int64),
    "unaligned": lambda ns: np.frombuffer(b"x" + np.array(ns).tobytes(), np.int64, offset=1),
    "NumPy's numbers": lambda ns: [ns[0], *map(np.int64, ns[1:])],
    "Times": lambda ns: [at_ns(one) for one in ns],
    "messages": lambda ns: [at_ns(one).to_msg() for one in ns],
    **{f"datetime64 in {unit}": partial(dates, unit=unit) for unit in ("ms", "us", "ns", "ps")},
    "list of datetime64": lambda ns: list(dates(ns, "ms")),
}


@pytest.mark.parametrize("form", [*FORMS, *(pytest.param(one, marks=needs_pandas) for one in OF_PANDAS)])
def test_times_may_be_anything_that_is_whole_nanoseconds(buffer, form):
    got = buffer.lookup_transforms("map", "odom", {**FORMS, **OF_PANDAS}[form](NS))
    assert_same_numbers(got, singles(buffer, "map", "odom", NS))


@pytest.mark.parametrize("places", [*permutations(range(3))], ids=str)
def test_times_of_several_kinds_in_any_order(buffer, places):
    kinds = [NS[0], Time(nanoseconds=NS[1]), dates(NS, "s")[2]]
    for times in ([kinds[i] for i in places], np.array([kinds[i] for i in places], object)):
        got = buffer.lookup_transforms("map", "odom", times)
        assert_same_numbers(got, singles(buffer, "map", "odom", [NS[i] for i in places]))


@needs_pandas
def test_a_missing_integer_of_a_column_is_named(buffer):
    pandas = pytest.importorskip("pandas")
    for column in (
        pandas.Series([S, None], dtype="Int64"),
        pandas.Series([S, None], dtype="Int64").array,
        pandas.Series([S, None]),
        [S, pandas.NA],
    ):
        with pytest.raises(ValueError, match=MISSING):
            buffer.lookup_transforms("map", "odom", column)


@needs_pandas
def test_a_date_of_pandas_that_does_not_fit_is_named(buffer):
    pandas = pytest.importorskip("pandas")
    late = pandas.Series([pandas.Timestamp("9999-01-01", tz="UTC").as_unit("s")])
    with pytest.raises(OverflowError, match=r"times\[0\]: .* got 9999"):
        buffer.lookup_transforms("map", "odom", late)


def test_whole_numbers_of_any_types_are_taken(buffer):
    low, _ = span_of_all(buffer)
    for mixed in ([np.uint64(low), low + 1], (np.int64(low), np.uint64(low + 1)), [np.uint8(0), low + 1]):
        got = buffer.lookup_transforms("map", "odom", mixed)
        assert_same_numbers(got, singles(buffer, "map", "odom", [int(one) for one in mixed]))


ARRAY = r"integer nanoseconds of shape \(N,\)"
TO_INT64 = "float64, which rounds nanoseconds: keep those as int64; multiply seconds by 1e9, and round them"
MISSING = r"times\[1\] is missing \(NA, null, NaN or masked\)$"


class NAType:
    """Of pandas, in an array of objects."""


TOO_LARGE = r"^times\[1\] = \d+ does not fit into 64-bit nanoseconds$"
BEYOND = r"times\[1\]: expected whole nanoseconds within 64 bits"
NO_TIMES = [
    (TypeError, ARRAY, 1, None, "12", ["1"], [...], [True, False], [5, True], [5, "6"]),
    (ValueError, MISSING, [5, None], (5, None, 7), [5, math.nan], np.array([5, NAType()], object)),
    (ValueError, MISSING, np.array([1.7e18, math.nan]), np.ma.masked_array([5, 6], [False, True])),
    (ValueError, MISSING, np.array([5, None], object), [Time(seconds=5), None], np.float32([5, math.nan])),
    (TypeError, ARRAY, [1.5, 2.5], np.array([1.0]), np.array([5, 1.5], object)),
    ((TypeError, ValueError), ARRAY, np.int64(3)),
    (ValueError, ARRAY, [[S]], [S, (S, S)], [np.array([S])], np.array([S, [S]], object)),
    (ValueError, ARRAY, np.zeros((2, 2), np.int64)),
    (OverflowError, TOO_LARGE, [5, 2**63], [5, 2**70], np.array([5, 2**63], np.uint64)),
    (OverflowError, TOO_LARGE, np.array([5, 2**63], object), [np.int64(1), np.uint64(2**63)]),
    (TypeError, TO_INT64, [1.5], np.array([2.0]), [1.5, 2**63]),
    (TypeError, "timedelta64", np.array([2, 3], "m8[ns]")),
    (
        ValueError,
        r"times\[1\]: .* got NaT",
        np.array([3, "NaT"], "M8[ns]"),
        np.array([3, "NaT"], "M8[D]"),
        np.array([3, NAT, NAT]),
        [3, NAT],
    ),
    (OverflowError, BEYOND, np.array(["1970-01-02", "9999-01-01"], "M8[D]"), np.array([1000, 1], "M8[ps]")),
]


@pytest.mark.parametrize(("error", "text", "wrong"), [(*row[:2], row[2:]) for row in NO_TIMES])
def test_what_is_no_time_says_what_is_wanted(buffer, error, text, wrong):
    for times in wrong:
        with pytest.raises(error, match=text):
            buffer.lookup_transforms("map", "odom", times)


class TestMissingTimes:
    """NaT, and the smallest int64, its value as an integer."""

    @pytest.mark.parametrize("dtype", ["i8", "M8[ns]"])
    def test_a_missing_time_is_a_row_of_nan(self, buffer, dtype):
        times = np.array([3 * S, NAT, 4 * S, NAT]).view(dtype)
        for source in ("base", "map", "plate", ["base", "plate"]):  # the plate never moves
            for target in ("map", "camera"):
                wanted = buffer.lookup_transforms(target, source, [3 * S, 4 * S])
                got = buffer.lookup_transforms(target, source, times, on_missing="nan")
                for one, other in zip(got, wanted, strict=True):
                    np.testing.assert_array_equal(one[..., ::2, :], other)
                    assert np.isnan(one[..., 1::2, :]).all()
        matrices = buffer.lookup_matrices("map", "base", times, on_missing="nan")
        assert np.isnan(matrices).all(axis=(1, 2)).tolist() == [False, True, False, True]
        columns = to_columns(buffer.lookup_transforms("map", "base", times, on_missing="nan"), times)
        assert columns["stamp_ns"].tolist() == times.view("i8").tolist()

    def test_otherwise_it_is_an_error(self, buffer):
        times = np.array([3 * S, NAT])
        wanted = r"^times\[1\]: expected a time, got NaT .*: this stamp is not set$"
        for look_up in (
            lambda: buffer.lookup_transforms("map", "base", times),
            lambda: buffer.lookup_transforms("mast", "camera", times),  # static: any time has an answer
            lambda: buffer.lookup_matrices("map", "base", times),
            lambda: buffer.transform_points(np.zeros((2, 3)), times, "map", "base"),
        ):
            with pytest.raises(ValueError, match=wanted):
                look_up()


class TestTimesThatNoStampCanHold:
    EARLIEST, LATEST = -(2**31) * S, 2**31 * S - 1

    @pytest.mark.parametrize("ns", [EARLIEST - 1, LATEST + 1, 2**63 - 1, 1 - 2**63])
    @pytest.mark.parametrize("frames", [("map", "base"), ("base", "mast"), ("map", "map")])
    def test_they_raise_what_a_single_lookup_raises(self, buffer, frames, ns):
        with pytest.raises(OverflowError) as single:
            buffer.lookup_transform_core(*frames, ns)
        both = [3 * S, ns]
        objects = [SimpleNamespace(nanoseconds=one) for one in both]
        for times in (both, objects, np.array(both), np.array(both).view("M8[ns]")):
            for look_up in (
                lambda times=times: buffer.lookup_transforms(*frames, times),
                lambda times=times: buffer.lookup_transforms(frames[0], [frames[1], "base"], times),
                lambda times=times: buffer.lookup_matrices(*frames, times),
                lambda times=times: buffer.transform_points(np.zeros((2, 3)), times, *frames),
                lambda times=times: buffer.lookup_transforms(*frames, times, tolerance=math.inf),
            ):
                with pytest.raises(OverflowError) as many:
                    look_up()
                assert str(many.value) == f"times[1]: {single.value}"

    def test_they_are_rows_of_nan_if_those_are_wanted(self, buffer):
        times = [self.LATEST, self.EARLIEST - 1, self.EARLIEST, self.LATEST + 1]
        for frames in (("base", "mast"), ("map", "map")):  # any other time has an answer
            translations, rotations = buffer.lookup_transforms(*frames, times, on_missing="nan")
            matrices = buffer.lookup_matrices(*frames, times, on_missing="nan")
            for rows in (translations, rotations, matrices[:, :3].reshape(4, 12)):
                assert np.isnan(rows).all(axis=1).tolist() == [False, True, False, True]
                assert np.isnan(rows).any(axis=1).tolist() == [False, True, False, True]

    def test_they_do_not_hide_a_wrong_name_or_limit(self, buffer):
        times = [self.LATEST + 1]
        with pytest.raises(LookupException, match='"nowhere"'):
            buffer.lookup_transforms("map", "nowhere", times, on_missing="nan")
        with pytest.raises(ValueError, match=r"tolerance has a limit for \[map\]"):
            buffer.lookup_transforms("map", "base", times, on_missing="nan", tolerance={"map": 1.0})


class TestPoints:
    @pytest.mark.parametrize("dtype", [np.float32, np.float64])
    def test_each_point_is_transformed_at_its_own_time(self, buffer, dtype):
        low, high = span_of_all(buffer)
        random = np.random.default_rng(5)
        times = random.integers(low, high, 300)
        points = random.normal(size=(300, 3)).astype(dtype)
        points.flags.writeable = False
        got = buffer.transform_points(points, times, "camera", "hand", **TWO_TIMES[1])
        translations, rotations = buffer.lookup_transforms("camera", "hand", times, **TWO_TIMES[1])
        want = Turn(rotations).apply(points.astype(np.float64)) + translations
        assert got.dtype == dtype
        np.testing.assert_allclose(got, want, rtol=0, atol=np.finfo(dtype).eps * 100 * np.abs(want).max())

    def test_numbers_of_other_types_become_float64(self, buffer):
        odd = np.frombuffer(b"x" + np.array([1.0, 2, 3], ">f8").tobytes(), ">f8", offset=1).reshape(1, 3)
        for points in ([[1, 2, 3]], np.array([[1, 2, 3]], np.int16), np.array([[1, 2, 3]], np.uint8), odd):
            got = buffer.transform_points(points, [0], "map", "base")
            assert got.dtype == np.float64
            assert (got == buffer.transform_points([[1.0, 2.0, 3.0]], [0], "map", "base")).all()

    def test_what_is_no_array_of_a_point_is_refused(self, buffer):
        for wrong in (np.zeros((2, 3)), np.zeros((1, 2)), np.zeros(3)):
            with pytest.raises(ValueError):
                buffer.transform_points(wrong, [1], "map", "base")
        for wrong in (np.zeros((1, 3), complex), np.zeros((1, 3), bool), [["a", "b", "c"]]):
            with pytest.raises(TypeError):
                buffer.transform_points(wrong, [1], "map", "base")


class TestManyFrames:
    """A sequence of source frames: the answers are those of one call for each."""

    def test_the_first_frame_with_an_error_raises_it_even_if_another_fails_earlier(self):
        buffer = BufferCore(Duration(seconds=100))
        for frame, newest in (("long", 200), ("short", 100), ("other", 50)):
            buffer.set_transforms([transform("map", frame, ns=ns) for ns in (1, newest)], "x")
        times = np.arange(1, 301)
        for sources, index in ((["short", "other", "long"], 100), (["long", "short"], 200)):
            with pytest.raises(ExtrapolationException, match=rf"^times\[{index}\].*\[{sources[0]}\]"):
                buffer.lookup_transforms("map", sources, times)

    @pytest.mark.parametrize("on_missing", ["raise", "nan"])
    def test_unknown_names_are_errors_before_missing_times(self, buffer, tf2_py, on_missing):
        with pytest.raises(tf2_py.LookupException, match="unknown_7") as error:
            buffer.lookup_transforms("map", [*FRAMES * 3, "unknown_7"], [1, 2], on_missing=on_missing)
        assert "times[" not in str(error.value)
        with pytest.raises(tf2_py.InvalidArgumentException, match="/base"):
            buffer.lookup_transforms("map", ["/base", "unknown_7"], [1, 2], on_missing=on_missing)


WRONG = {
    "'raise' or 'nan'": [
        lambda b: b.lookup_transforms("map", "base", [1], on_missing="NaN"),
        lambda b: b.lookup_transforms("map", "base", [1], on_missing=None),
    ],
    "or neither": [
        lambda b: b.lookup_transforms("map", "base", [1], fixed_frame="map"),
        lambda b: b.lookup_transforms("map", "base", [1], target_time=at(0)),
    ],
    "expected a str, got int": [lambda b: b.lookup_transforms("map", ["base", 3], [1])],
    "source_frame: .* got (list|bytes|NoneType)": [
        lambda b: b.lookup_transforms("map", [["base"]], [1]),
        lambda b: b.lookup_transforms("map", b"base", [1]),
        lambda b: b.lookup_transforms("map", None, [1]),
    ],
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_arguments(buffer, text):
    for call in WRONG[text]:
        with pytest.raises((TypeError, ValueError), match=text):
            call(buffer)

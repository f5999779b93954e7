"""Lookups at many times in one call: the same answers as as many calls."""

from itertools import permutations

import numpy as np
import pytest
from making import S, about_z, at, at_ns, rotation, transform, translation
from ros_optional import Duration, Time
from scipy.spatial.transform import Rotation

from tf2_py import ExtrapolationException

pytestmark = pytest.mark.ours

FRAMES = ["map", "odom", "base", "arm", "hand", "mast", "camera", "plate"]


def robot(tf2_py, samples=300, seed=3):
    """Moving, still and jerky edges: map > odom > base > (arm > hand), (mast > camera > plate)."""
    random = np.random.default_rng(seed)
    buffer = tf2_py.BufferCore(Duration(seconds=1000))
    for parent, child, step in (
        ("map", "odom", 0.01),
        ("odom", "base", 0.05),
        ("base", "arm", 0.2),
        ("arm", "hand", 2.0),  # far turns between neighbours
        ("mast", "camera", 1e-9),
    ):
        turns = Rotation.from_rotvec(
            np.cumsum(random.normal(scale=step, size=(samples, 3)), axis=0)
        ).as_quat()
        places = np.cumsum(random.normal(size=(samples, 3)), axis=0)
        stamps = np.cumsum(random.integers(1_000_000, 30_000_000, samples)) + S
        buffer.set_transforms(
            [
                transform(parent, child, ns=int(t), xyz=p, xyzw=q)
                for t, p, q in zip(stamps, places, turns, strict=True)
            ],
            "x",
        )
    buffer.set_transform_static(transform("base", "mast", xyz=(-0.0, 2, 3), xyzw=about_z(2.5)), "x")
    buffer.set_transform_static(transform("camera", "plate", xyz=(0.1, 0, -0.0)), "x")
    return buffer


@pytest.fixture(scope="module")
def buffer(tf2_py):
    return robot(tf2_py)


def span(buffer, target, source):
    newest = buffer.get_latest_common_time(target, source).nanoseconds
    return (S + 30_000_000, newest) if newest else (1, 10 * S)


def span_of_all(buffer):
    return span(buffer, "map", "hand")[0], min(span(buffer, "map", frame)[1] for frame in ("hand", "plate"))


def singles(buffer, target, source, times, **two_times):
    """Rows of as many lookups of one time; NaN: there is no answer."""
    rows = []
    for ns in times:
        try:
            if two_times:
                m = buffer.lookup_transform_full_core(
                    target, two_times["target_time"], source, at_ns(int(ns)), two_times["fixed_frame"]
                )
            else:
                m = buffer.lookup_transform_core(target, source, at_ns(int(ns)))
            rows.append((*translation(m), *rotation(m)))
        except ExtrapolationException:
            rows.append((np.nan,) * 7)
    return np.array(rows).reshape(-1, 7)


def assert_same_to_the_last_bit(series, rows):
    got, missing = np.hstack(series), np.isnan(rows).any(axis=1)
    assert got.shape == rows.shape
    assert got.dtype == np.float64
    assert np.isnan(got[missing]).all()
    assert (got[~missing].view(np.int64) == np.ascontiguousarray(rows[~missing]).view(np.int64)).all()


def check(buffer, target, source, times, **two_times):
    """Rows are those of single lookups, and the first one without an answer is the error."""
    rows = singles(buffer, target, source, times, **two_times)
    series = buffer.lookup_transforms(target, source, times, on_missing="nan", **two_times)
    assert_same_to_the_last_bit(series, rows)
    missing = np.flatnonzero(np.isnan(rows[:, 0]))
    if len(missing):
        with pytest.raises(ExtrapolationException, match=rf"^times\[{missing[0]}\]: "):
            buffer.lookup_transforms(target, source, times, **two_times)
    else:
        assert_same_to_the_last_bit(buffer.lookup_transforms(target, source, times, **two_times), rows)


@pytest.mark.parametrize("source", FRAMES)
@pytest.mark.parametrize("target", FRAMES)
def test_the_numbers_are_those_of_single_lookups(buffer, target, source):
    low, high = span(buffer, target, source)
    times = np.random.default_rng(1).integers(low, high, 150)
    times[::20] = 0
    times[3] = high
    check(buffer, target, source, times)
    times[[81, 99, 149]] = (high + 1, 1, 2**31 * S - 1)
    check(buffer, target, source, times)


@pytest.mark.parametrize(
    ("target", "source", "fixed"),
    [("camera", "hand", "map"), ("base", "base", "odom"), ("map", "hand", "hand")],
)
def test_two_times(buffer, target, source, fixed):
    low, high = span_of_all(buffer)
    times = np.sort(np.random.default_rng(2).integers(low, high, 200))
    for target_time in (at_ns(high), at(0)):
        check(buffer, target, source, times, fixed_frame=fixed, target_time=target_time)


@pytest.mark.parametrize("count", [0, 1, 2, 63, 64, 65, 255, 256, 257, 1000])
def test_any_number_of_times(buffer, count):
    low, high = span(buffer, "map", "hand")
    times = np.linspace(low, high + S, count).astype(np.int64)
    check(buffer, "map", "hand", times[times <= high])
    check(buffer, "map", "hand", times)


class TestTimes:
    NS = (2 * S, 3 * S, 0)

    @pytest.mark.parametrize(
        "make",
        [
            list,
            tuple,
            np.array,
            lambda ns: np.array(ns, np.uint64),
            lambda ns: np.repeat(np.array(ns), 2)[::2],
            lambda ns: np.array(ns[::-1])[::-1],
            lambda ns: [at_ns(one) for one in ns],
            lambda ns: [at_ns(one).to_msg() for one in ns],
            lambda ns: np.frombuffer(np.array(ns).tobytes(), np.int64),  # read-only
        ],
    )
    def test_anything_that_is_whole_nanoseconds(self, buffer, make):
        got = buffer.lookup_transforms("map", "odom", make(self.NS))
        assert_same_to_the_last_bit(got, singles(buffer, "map", "odom", self.NS))
        check(buffer, "base", "plate", np.array([2, 0], np.int8))


class TestDates:
    NS = np.array([2 * S + 30_000_000, 3 * S, 4 * S])

    def same(self, buffer, times, ns=NS):
        got = buffer.lookup_transforms("map", "odom", times)
        assert_same_to_the_last_bit(got, np.hstack(buffer.lookup_transforms("map", "odom", ns)))

    @pytest.mark.parametrize("unit", ["s", "ms", "us", "ns", "ps"])
    def test_datetime64_of_any_unit(self, buffer, unit):
        dates = self.NS.view("M8[ns]").astype(f"M8[{unit}]")
        self.same(buffer, dates, dates.astype("M8[ns]").view(np.int64))
        self.same(buffer, list(dates), dates.astype("M8[ns]").view(np.int64))

    @pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
    @pytest.mark.parametrize("zone", [None, "UTC", "Asia/Tokyo"])
    def test_times_of_pandas(self, buffer, unit, zone):
        pandas = pytest.importorskip("pandas")
        index = pandas.DatetimeIndex(self.NS.view("M8[ns]")).as_unit(unit)
        ns = index.as_unit("ns").asi8
        if zone is not None:
            index = index.tz_localize("UTC").tz_convert(zone)
        for times in (index, pandas.Series(index), pandas.Series(index, index=[7, 8, 9])):
            self.same(buffer, times, ns)

    def test_times_of_several_kinds_in_any_order(self, buffer):
        pandas = pytest.importorskip("pandas")
        first, second, third = self.NS.tolist()
        kinds = [first, Time(nanoseconds=second), np.datetime64(third, "ns").astype("M8[s]")]
        for places in permutations(range(3)):
            ns = self.NS[list(places)]
            for times in ([kinds[i] for i in places], np.array([kinds[i] for i in places], object)):
                self.same(buffer, times, ns)
        self.same(buffer, list(pandas.DatetimeIndex(self.NS.view("M8[ns]"))))
        self.same(buffer, [np.int64(first), second, third])

    def test_a_date_of_pandas_that_does_not_fit_is_named(self, buffer):
        pandas = pytest.importorskip("pandas")
        late = pandas.Series([pandas.Timestamp("9999-01-01", tz="UTC").as_unit("s")])
        with pytest.raises(ValueError, match=r"times\[0\]: .* got 9999"):
            buffer.lookup_transforms("map", "odom", late)


ARRAY = r"integer nanoseconds of shape \(N,\)"
NO_TIMES = [
    *[
        (times, TypeError, ARRAY)
        for times in (1, None, "12", ["1"], [...], [True, False], [5, True], [5, "6"])
    ],
    *[(times, TypeError, ARRAY) for times in ([1.5, 2.5], np.array([1.0]), np.array([5, 1.5], object))],
    (np.int64(3), (TypeError, ValueError), ARRAY),
    *[
        (times, ValueError, ARRAY)
        for times in ([[S]], [S, (S, S)], [np.array([S])], np.array([S, [S]], object))
    ],
    *[(times, ValueError, ARRAY) for times in (np.zeros((2, 2), np.int64), [2**63], [2**70])],
    *[(times, ValueError, ARRAY) for times in (np.array([5, 2**63], object), np.array([2**63], np.uint64))],
    (np.ma.masked_array([5, 6], [False, True]), ValueError, ARRAY),
    ([1.5], TypeError, "float64: multiply seconds by 1e9, and round them to int64$"),
    (np.array([2.0]), TypeError, "float64: multiply seconds by 1e9, and round them to int64$"),
    (np.array([2, 3], "m8[ns]"), TypeError, "timedelta64"),
    (np.array([3, "NaT"], "M8[ns]"), ValueError, r"times\[1\] is NaT"),
    (np.array([3, "NaT"], "M8[D]"), ValueError, r"times\[1\] is NaT"),
    (np.array(["1970-01-02", "9999-01-01"], "M8[D]"), ValueError, r"times\[1\]: expected whole nanoseconds"),
    (np.array([1000, 1], "M8[ps]"), ValueError, r"times\[1\]: expected whole nanoseconds within 64 bits"),
]


@pytest.mark.parametrize(("times", "error", "text"), NO_TIMES, ids=repr)
def test_what_is_no_time_says_what_is_wanted(buffer, times, error, text):
    with pytest.raises(error, match=text):
        buffer.lookup_transforms("map", "odom", times)


class TestPoints:
    @pytest.mark.parametrize("dtype", [np.float32, np.float64])
    def test_each_point_is_transformed_at_its_own_time(self, buffer, dtype):
        low, high = span_of_all(buffer)
        random = np.random.default_rng(5)
        times = random.integers(low, high, 300)
        points = random.normal(size=(300, 3)).astype(dtype)
        points.flags.writeable = False
        got = buffer.transform_points(
            points, times, "camera", "hand", fixed_frame="map", target_time=at_ns(high)
        )
        translations, rotations = buffer.lookup_transforms(
            "camera", "hand", times, fixed_frame="map", target_time=at_ns(high)
        )
        want = Rotation.from_quat(rotations).apply(points.astype(np.float64)) + translations
        assert got.dtype == dtype
        np.testing.assert_allclose(got, want, rtol=0, atol=np.finfo(dtype).eps * 100 * np.abs(want).max())

    @pytest.mark.parametrize(
        "points", [[[1, 2, 3]], np.array([[1, 2, 3]], np.int16), np.array([[1, 2, 3]], np.uint8)], ids=repr
    )
    def test_integers_become_float64(self, buffer, points):
        got = buffer.transform_points(points, [0], "map", "base")
        assert got.dtype == np.float64
        assert (got == buffer.transform_points([[1.0, 2.0, 3.0]], [0], "map", "base")).all()

    @pytest.mark.parametrize(
        ("points", "times", "error"),
        [
            (np.zeros((2, 3)), [1], ValueError),
            (np.zeros((2, 2)), [1, 2], ValueError),
            (np.zeros(3), [1], ValueError),
            (np.zeros((1, 3), complex), [1], TypeError),
            (np.zeros((1, 3), bool), [1], TypeError),
            ([["a", "b", "c"]], [1], TypeError),
        ],
    )
    def test_what_is_wrong_says_what_is_wanted(self, buffer, points, times, error):
        with pytest.raises(error):
            buffer.transform_points(points, times, "map", "base")


class TestManyFrames:
    """A sequence of source frames: the answers are those of one call for each."""

    def assert_same_as_one_by_one(self, buffer, target, sources, times, **options):
        translations, rotations = buffer.lookup_transforms(target, sources, times, **options)
        assert translations.shape == (len(sources), len(times), 3)
        assert rotations.shape == (len(sources), len(times), 4)
        for i, source in enumerate(sources):
            one = np.hstack(buffer.lookup_transforms(target, source, times, **options))
            assert_same_to_the_last_bit((translations[i], rotations[i]), one)
        buffer._self_check()

    def test_rows_are_those_of_single_frames(self, buffer):
        low, high = span_of_all(buffer)
        times = [0, *np.random.default_rng(3).integers(low, high, 99)]
        two_times = {"fixed_frame": "map", "target_time": at_ns(high)}
        self.assert_same_as_one_by_one(buffer, "camera", FRAMES, times)
        self.assert_same_as_one_by_one(buffer, "camera", FRAMES, times, **two_times)

    def test_the_first_frame_with_an_error_raises_it_even_if_another_fails_earlier(self, tf2_py):
        buffer = tf2_py.BufferCore(Duration(seconds=100))
        for frame, newest in (("long", 200), ("short", 100), ("other", 50)):
            buffer.set_transforms([transform("map", frame, ns=ns) for ns in (1, newest)], "x")
        times = np.arange(1, 301)
        for sources, index in ((["short", "other", "long"], 100), (["long", "short"], 200)):
            with pytest.raises(tf2_py.ExtrapolationException, match=rf"^times\[{index}\].*\[{sources[0]}\]"):
                buffer.lookup_transforms("map", sources, times)

    @pytest.mark.parametrize("on_missing", ["raise", "nan"])
    def test_unknown_names_are_errors_before_missing_times(self, buffer, tf2_py, on_missing):
        with pytest.raises(tf2_py.LookupException, match="unknown_7") as error:
            buffer.lookup_transforms("map", [*FRAMES * 3, "unknown_7"], [1, 2], on_missing=on_missing)
        assert "times[" not in str(error.value)
        with pytest.raises(tf2_py.InvalidArgumentException, match="/base"):
            buffer.lookup_transforms("map", ["/base", "unknown_7"], [1, 2], on_missing=on_missing)

    @pytest.mark.parametrize("times", [[], [3 * S]], ids=len)
    def test_no_frames_and_no_times(self, buffer, times):
        self.assert_same_as_one_by_one(buffer, "map", [], times)
        self.assert_same_as_one_by_one(buffer, "map", ["base", "hand"], times)


@pytest.mark.parametrize(
    ("source", "options", "error", "text"),
    [
        *[("base", {"on_missing": word}, ValueError, "'raise' or 'nan'") for word in ("NaN", None, "", 0)],
        ("base", {"fixed_frame": "map"}, TypeError, "go together"),
        ("base", {"target_time": at(0)}, TypeError, "go together"),
        *[
            (source, {}, TypeError, f"source_frame: expected a str, got {named}")
            for source, named in (
                (["base", 3], "int"),
                ([["base"]], "list"),
                (b"base", "bytes"),
                (None, "NoneType"),
            )
        ],
    ],
)
def test_wrong_arguments(buffer, source, options, error, text):
    with pytest.raises(error, match=text):
        buffer.lookup_transforms("map", source, [1], **options)

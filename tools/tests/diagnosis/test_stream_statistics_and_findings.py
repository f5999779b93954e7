# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is computed of received transforms: figures, chains, findings. Without a node."""

import random
import statistics
from dataclasses import asdict

import numpy as np
import pytest
from random_runs import seeds

from tf2_py import BufferCore
from tf2_ros import TransformStamped
from tf2_ros.records import RECORD
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.diagnosis.findings import Expectation, Finding, Limits, Received, expected_by, find
from tf2_ros_tools.diagnosis.stream_statistics import TAIL, Streams, moving_on, newest_streams
from tf2_ros_tools.diagnosis.texts import line_of

S = 1_000_000_000
START_NS = 1_795_000_000 * S
FRAMES = ["map", "odom", "base", "camera", "lidar", "world"]
PUBLISHERS = ["/localiser", "/odometry", "/other"]
UPRIGHT, HALF_TURN = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 1.0, 0.0)
# Of static transforms: x y z qx qy qz qw, two of them the same.
VALUES = [
    (0.1, 0.0, 0.5, *UPRIGHT),
    (0.25, 0.0, 0.5, *UPRIGHT),
    (0.1 + 1e-9, 0.0, 0.5, 0.0, 0.0, 0.0, -2.0),
    (0.1, 0.0, 0.5, *HALF_TURN),
    (0.1, 0.00001, 0.5, *UPRIGHT),
]


def at(seconds):
    return START_NS + round(seconds * S)


def heard(
    received,
    child,
    parent="map",
    publisher="/odometry",
    delay=0.01,
    static=False,
    unnormalized=False,
    refusals=0,
    value=0,
):
    """One record; times in seconds, `received` from the start."""
    return (
        at(received),
        at(received - delay),
        FRAMES.index(child),
        FRAMES.index(parent),
        PUBLISHERS.index(publisher),
        static,
        unnormalized,
        refusals,
        value,
    )


def steady(child, parent="map", rate=50, start=0.0, end=4.0, **how):
    times = np.arange(round((end - start) * rate)) / rate + start
    return [heard(time, child, parent, **how) for time in times]


def records(*lists):
    return np.array(sorted(one for some in lists for one in some), RECORD)


def settled(window=None):
    """Streams whose publishers were discovered long ago."""
    streams = Streams(window)
    streams._settled_ns = dict.fromkeys(range(len(PUBLISHERS)), 0)
    return streams


def reported(*lists, now=4.0, window=None, pieces=1):
    streams = settled(window)
    for piece in np.array_split(records(*lists), pieces):
        streams.add(piece)
    return streams.report(at(now), FRAMES, PUBLISHERS)


ROBOT = (
    steady("odom", "map", 20, publisher="/localiser"),
    steady("base", "odom"),
    [heard(0, "camera", "base", static=True), heard(0, "lidar", "base", static=True)],
)


class TestFigures:
    @pytest.mark.parametrize("count", [2, 3, 100])
    def test_of_a_frame(self, count):
        generator = random.Random(4)
        delays = [generator.expovariate(20) for _ in range(count)]
        times = sorted(generator.uniform(0, 3) for _ in range(count))
        [one], _ = reported(
            [heard(time, "base", delay=delay) for time, delay in zip(times, delays, strict=True)]
        )
        assert (one.frame, one.parent, one.publisher, one.static) == ("base", "map", "/odometry", False)
        intervals = np.diff(times)
        stamps = [time - delay for time, delay in zip(times, delays, strict=True)]
        figures = {
            "count": count,
            "rate": (count - 1) / (times[-1] - times[0]),
            "delay": statistics.fmean(delays),
            "jitter": statistics.pstdev(delays),
            "delay_min": min(delays),
            "delay_max": max(delays),
            "gap": intervals.max(),
            # Without the longest one, unless it is the only one.
            "period": (intervals.sum() - intervals.max()) / (count - 2) if count > 2 else intervals[0],
            "first": 4 - times[0],
            "silence": 4 - times[-1],
            "stalled": 4 - times[stamps.index(max(stamps))],
        }
        assert {name: getattr(one, name) for name in figures} == pytest.approx(figures, abs=1e-6)

    def test_are_those_of_the_window(self):
        mine = (steady("base", rate=10, end=20), steady("base", rate=50, start=20, end=30, delay=0.2))
        [one], _ = reported(*mine, now=30, window=5, pieces=30)
        assert one.rate == pytest.approx(50)
        assert one.delay == pytest.approx(0.2)
        assert 4.9 < one.first < 6.1  # the pieces are of a second

    @pytest.mark.parametrize("pieces", [1, 3])
    def test_are_of_what_buffers_take_and_beside_them_is_what_is_refused(self, pieces):
        mine = [heard(i / 10, "base", refusals=8 if i > 3 else 32 if i == 3 else 0) for i in range(10)]
        [one], [refused] = reported(mine, pieces=pieces)
        assert (one.frame, one.count, one.rate) == ("base", 3, pytest.approx(10))
        assert (refused.frame, refused.parent, refused.publisher) == ("base", "map", "/odometry")
        assert (refused.count, refused.static) == (7, False)
        assert refused.because == "a number is NaN and the translation is infinite"

    def test_a_refused_static_one_stays(self):
        bad = heard(1, "camera", "base", static=True, refusals=8)
        assert [one.count for one in reported([bad], window=2, now=60)[1]] == [1]

    def test_of_a_slow_frame_the_period_is_known_beyond_the_window(self):
        [one], _ = reported(steady("base", rate=0.1, end=60), now=59, window=5, pieces=60)
        assert (one.count, one.rate) == (0, None)
        assert one.period == pytest.approx(10)
        assert one.silence == pytest.approx(9)

    def test_one_interval_in_the_window_is_not_the_period(self):
        [one], _ = reported([heard(time, "base") for time in (*range(49), 51, 54)], now=54, window=4)
        assert (one.count, one.gap, one.period) == (2, 3, pytest.approx(1, abs=0.3))

    def test_beyond_the_window_a_few_records_of_each_stream_are_kept(self):
        streams = settled(2.0)
        streams.add(records(steady("base", rate=100, end=100), steady("odom", rate=1, end=100)))
        assert len(streams.kept(at(100))) <= 2 * 101 + TAIL

    @pytest.mark.parametrize("pieces", [1, 3, 40])
    def test_what_was_received_before_the_clock_jumped_back_is_forgotten(self, pieces):
        mine = [*steady("base", start=50.0, end=60.0, delay=1.0), *steady("base", start=2.0, end=20.0)]
        streams = settled()
        for piece in np.array_split(np.array(mine, RECORD), pieces):
            streams.add(piece)
        mean, most = streams.net_delay([FRAMES.index("base")], at(20.0))
        assert 0.0 < mean < most < 0.1
        [one], _ = streams.report(at(20.0), FRAMES, PUBLISHERS)
        assert (one.delay_min, one.delay_max) == pytest.approx((0.01, 0.01))
        assert streams.jump_back(at(20.0)) == pytest.approx(58, abs=0.1)


@pytest.mark.parametrize(
    ("chain", "moving"),
    [("camera base lidar", ""), ("map odom base camera", "odom base"), ("camera base odom map", "base odom")],
)
def test_the_topmost_frame_of_a_chain_and_static_ones_do_not_move_it(chain, moving):
    assert moving_on(newest_streams(reported(*ROBOT)[0]), chain.split()) == moving.split()


class TestNetDelay:
    def test_is_that_of_the_window(self):
        streams = settled(2.0)
        streams.add(records(steady("odom", rate=100, end=2, delay=1.0)))
        streams.add(records(steady("odom", rate=100, start=2, end=3.5, delay=0.1)))
        odom = [FRAMES.index("odom")]
        # The window begins at 1.5 s, within the first of the two.
        mean, most = streams.net_delay(odom, at(3.5))
        assert 0.1 < mean < 0.5 and most == pytest.approx(1.01)
        streams.add(records(steady("odom", rate=100, start=3.5, end=6, delay=0.1)))
        assert streams.net_delay(odom, at(6)) == pytest.approx((0.105, 0.11), abs=1e-3)
        assert streams.net_delay(odom, at(9)) == pytest.approx((2.11, 3.11), abs=0.01)

    def test_is_the_age_of_the_newest_common_time_and_grows_while_nothing_arrives(self):
        streams = Streams()
        streams.add(records([heard(0, "odom", delay=0.5), heard(1, "base"), heard(2, "base", "odom")]))
        children = [FRAMES.index(name) for name in ("odom", "base")]
        assert streams.net_delay(children, at(3)) == pytest.approx((2.5, 3.5))
        assert streams.net_delay(children[:1], at(3)) == pytest.approx((2, 3.5))
        assert streams.net_delay([FRAMES.index("camera")], at(3)) is None


def static(time, child, parent, **how):
    return [heard(time, child, parent, static=True, **how)]


def case(*lists, says=(), now=4.0, **judged):
    return lists, now, {"limits": Limits(), **judged}, [says] if isinstance(says, str) else says


# What is received, when it is judged and how, and what is reported: lines, or their beginnings. What a
# recording shows as well is in `transcripts/tf2_bag.txt`.
FINDINGS = {
    "another parent from now on": case(
        *ROBOT[:1], steady("base", "odom", end=2), steady("base", "map", start=2)
    ),
    "two publishers": case(
        *ROBOT,
        steady("base", "odom", publisher="/other", start=0.005),
        says="publishers: base is published by 2 publishers: /odometry, /other",
    ),
    "a restart": case(steady("base", end=2), steady("base", start=2.5, publisher="/other")),
    "two static publishers": case(
        *ROBOT,
        static(1, "camera", "base", publisher="/other"),
        says="publishers: camera is published by 2 publishers: /odometry, /other",
    ),
    "a static one, and a single dynamic one": case(
        *ROBOT,
        [heard(1, "camera", "base", publisher="/localiser")],
        says="mixed: camera is published as static by /odometry and as dynamic by /localiser",
    ),
    "of which one has ended": case(*ROBOT, static(1, "camera", "base", publisher="/other"), alive={0, 2}),
    "refused, so not in the tree": case(
        *ROBOT,
        steady("odom", "odom", 20, publisher="/localiser", refusals=1),
        steady("base", "world", refusals=8),
        static(2, "camera", "lidar", refusals=8),
        says=[
            "refused: 200 transforms of base",
            "refused: 1 transform of camera by /odometry is refused: ",
            "refused: 80 transforms of odom",
        ],
    ),
    "normalized by buffers, and refused by newer ones": case(
        *ROBOT,
        [heard(0.5, "lidar", "base", static=True, unnormalized=True)],
        steady("world", "base", 20, publisher="/other", unnormalized=True),
        says=[
            "unnormalized: 1 transform of lidar by /odometry has a rotation",
            "unnormalized: 80 transforms of world by /other have a rotation whose length is not 1: tf2 of "
            "ROS 2 Kilted and later refuses them",
        ],
    ),
    "unnormalized by a static publisher that has ended": case(
        *ROBOT,
        [heard(0.5, "lidar", "base", publisher="/other", static=True, unnormalized=True)],
        alive={0, 1},
    ),
    "no longer published": case(
        steady("odom", end=2), says="stale: odom by /odometry was last received 2.02 s ago"
    ),
    "a stamp that stands still": case(
        [heard(time, "odom", delay=time) for time in np.arange(200) / 50],
        says="stale: odom by /odometry has had no newer stamp for 4 s",
    ),
    "a single transform": case([heard(0, "odom")], now=1000),
    "static frames do not get stale": case(
        static(0, "camera", "map"), static(0.01, "camera", "map"), now=1000
    ),
    "late for a slow frame": case(
        steady("odom", rate=0.5, end=20, delay=7),
        now=20,
        says="delay: odom by /odometry is on average 7 s old",
    ),
    "one is later than allowed": case(
        steady("odom"),
        [heard(3, "odom", delay=0.5)],
        limits=Limits(max_delay=0.25),
        says="delay: odom by /odometry is up to 0.5 s old when received; the limit is 0.25 s",
    ),
    "another clock": case(
        *ROBOT[:1],
        steady("base", "odom", delay=START_NS / S - 100),
        steady("camera", "base", delay=START_NS / S - 100),
        says="clocks: the stamps of base, camera by /odometry are 56.9 years behind the clock",
    ),
    "two publishers ahead": case(
        steady("odom", delay=-1),
        steady("odom", delay=-1, publisher="/other", start=0.01),
        says=["publishers: ", "future: odom by /odometry is stamped", "future: odom by /other is stamped"],
    ),
    "bursts, as with simulated time": case([heard(0.1 * (i // 5), "odom") for i in range(200)]),
    "too low a rate": case(
        steady("odom", rate=10),
        limits=Limits(min_rate=20),
        says="rate: odom by /odometry is published at 10 Hz; the minimum is 20 Hz",
    ),
    "a rate within the margin": case(steady("odom", rate=19.2), limits=Limits(min_rate=20)),
    "a rate below the margin": case(
        steady("odom", rate=18.8),
        limits=Limits(min_rate=20),
        says="rate: odom by /odometry is published at 18.8 Hz; the minimum is 20 Hz",
    ),
    "another parent beside the expected one": case(
        steady("base", "odom"),
        steady("base", "map", publisher="/other", start=0.01, end=2.5),
        expectations={"base": Expectation(parent="odom")},
        says=[
            "parents: base has 2 parents: map by /other, odom by /odometry",
            "parent: base also has the parent map, not only odom",
            "publishers: base is published by 2",
            "stale: base in map by /other",
        ],
    ),
    "the expected rate goes first": case(
        *ROBOT, limits=Limits(min_rate=40), expectations={"odom": Expectation(min_rate=10)}
    ),
}


@pytest.mark.parametrize("name", FINDINGS)
def test_findings(name):
    lists, now, judged, wanted = FINDINGS[name]
    streams, refused = reported(*lists, now=now)
    lines = [line_of(one) for one in find(streams, refused=refused, **judged)]
    assert len(lines) == len(wanted) and all(map(str.startswith, sorted(lines), sorted(wanted))), lines


@pytest.mark.parametrize(
    ("names", "listed"),
    [
        (["/robot", "/robot", "/other"], "3 publishers: /other, /robot (twice)"),
        (["/robot", "/robot", "/robot"], "3 publishers: /robot (3 times)"),
    ],
)
def test_publishers_of_one_name_are_counted(names, listed):
    streams = settled()
    streams.add(
        records(*(steady("base", publisher=one, start=0.005 * i) for i, one in enumerate(PUBLISHERS)))
    )
    [found] = find(streams.report(at(4.0), FRAMES, names)[0], Limits())
    assert line_of(found) == f"publishers: base is published by {listed}"


def received(*lists):
    return Received(records(*lists), FRAMES, PUBLISHERS, VALUES, lambda ns: f"at {(ns - START_NS) / S:g}")


def said(findings):
    return [line_of(one) for one in findings]


LASTING = ": lookups at any time use the last one"


class TestRecords:
    """What the figures of streams do not show."""

    @pytest.mark.parametrize(
        ("values", "lines"),
        [
            ([0, 0, 0], []),
            ([0, 2, 0], []),
            ([0, 1], [f"changed from x 0.100 to x 0.250, at 1{LASTING}"]),
            ([0, 1, 1, 0], [f"changed 2 times, last from x 0.250 to x 0.100, at 3{LASTING}"]),
            ([0, 3], [f"changed from yaw 0.000 to yaw 3.142, at 1{LASTING}"]),
            ([1, 3], [f"changed from x 0.250 yaw 0.000 to x 0.100 yaw 3.142, at 1{LASTING}"]),
            ([4, 0], [f"changed from y 0.000010 to y 0.000000, at 1{LASTING}"]),
            ([0, 99], []),  # the second one was not noted
        ],
    )
    def test_a_static_transform_that_changes_is_found_with_its_values(self, values, lines):
        mine = [static(i, "camera", "base", value=value)[0] for i, value in enumerate(values)]
        start = "values: camera in base by /odometry is static and "
        assert said(received(mine, steady("base")).findings()) == [start + one for one in lines]

    def test_static_transforms_of_two_publishers_that_differ_are_found_with_their_values(self):
        mine = [static(i, "camera", "base", publisher=PUBLISHERS[i], value=i)[0] for i in range(3)]
        text = "values: camera in base is static with different values: {}"
        three = "x 0.100 by /localiser, x 0.250 by /odometry, x 0.100 by /other"
        assert said(received(mine).findings()) == [text.format(three)]
        two = "x 0.100 by /localiser, x 0.250 by /odometry"
        assert said(received(mine).findings(alive={0, 1})) == [text.format(two)]
        assert said(received(mine).findings(alive={0, 2})) == []
        elsewhere = static(3, "camera", "lidar", publisher="/other", value=1)
        assert said(received(mine[:1], elsewhere).findings()) == []

    def test_a_static_transform_that_changes_its_parent_is_found(self):
        mine = [static(0, "camera", "base"), static(1, "camera", "base"), static(2, "camera", "lidar")]
        text = "camera in lidar by /odometry is static and changed from parent base to parent lidar, at 2"
        assert said(received(*mine).findings()) == [f"values: {text}{LASTING}"]

    def test_what_is_refused_or_changed_before_the_window_does_not_count(self):
        refused = static(1, "camera", "base", value=1, refusals=8)
        assert said(received(static(0, "camera", "base"), refused).findings()) == []
        changed = received(static(0, "camera", "base"), static(1, "camera", "base", value=1))
        assert len(changed.findings(begin_ns=at(1))) == 1
        assert changed.findings(begin_ns=at(1) + 1) == []

    @pytest.mark.parametrize(
        ("stamps", "count"),
        [([0] * 5, 5), ([0, 0, 1, 2], 0), ([0, 0, 1, 0, 0, 2], 2), ([0], 0), ([1, 0, 2], 0)],
    )
    def test_stamps_that_were_not_set_are_found(self, stamps, count):
        mine = records([heard(i, "odom") for i in range(len(stamps))])
        mine["stamp_ns"] = np.array(stamps) * START_NS
        found = Received(mine, FRAMES, PUBLISHERS, VALUES, str).findings()
        text = (
            f"{count} transforms of odom by /odometry have the stamp 0, because the publisher does not set it"
        )
        assert said(found) == [f"unset: {text}"] * (count > 0)

    def test_causes_come_before_what_follows_from_them(self):
        """A slow clock and a second publisher, in a report with gaps of all frames and a silent one."""
        streams, refused = reported(
            *[steady(frame, "map", end=1) + steady(frame, "map", start=2.5) for frame in ("odom", "base")],
            steady("base", "map", publisher="/other", end=1) + steady("base", publisher="/other", start=2.5),
            steady("camera", "base", end=1, delay=5),
            [heard(0, "lidar", "world", static=True)],
            [heard(0, "world", "map", static=True, refusals=8)],
        )
        also = [Finding("lost", "", "x"), Finding("malformed", "", "x")]
        kinds = [one.kind for one in find(streams, Limits(min_rate=60), refused=refused, also=also)]
        causes = ["malformed", "lost", "publishers", "refused"]
        assert list(dict.fromkeys(kinds)) == [*causes, "roots", "delay", "stale", "gap", "rate"]

    def test_stamps_that_were_not_set_say_nothing_about_a_clock(self):
        mine = records(steady("odom"), steady("base", "odom"))
        mine["stamp_ns"][mine["child"] == FRAMES.index("odom")] = 0
        streams = Streams()
        streams.add(mine)
        report, _ = streams.report(at(4.0), FRAMES, PUBLISHERS)
        unset = Received(mine, FRAMES, PUBLISHERS, VALUES, str).findings()
        assert "clocks" in {one.kind for one in find(report, Limits())}
        kinds = [one.kind for one in find(report, Limits(), also=unset)]
        assert "unset" in kinds and "clocks" not in kinds

    @pytest.mark.parametrize(
        ("lists", "expected"),
        [
            ([steady("odom")], None),
            ([steady("odom"), [heard(2.001, "odom", delay=1.9)]], None),  # a single late one
            ([steady("odom"), steady("odom", publisher="/other", delay=2.0)], None),
            ([steady("odom"), steady("odom", start=4.0, end=4.9, delay=0.5)], None),
            (
                [steady("odom"), steady("base", "odom", end=8), steady("odom", start=4, end=8, delay=3)],
                "odom went back by 2.97 s, at 4",
            ),
            (
                [
                    *(steady(f, rate=10) for f in ("odom", "base")),
                    *(steady(f, rate=10, start=4, end=8, delay=4) for f in ("odom", "base")),
                    *(steady(f, rate=10, start=8, end=9, delay=8) for f in ("odom", "base")),
                ],
                "base, odom went back 2 times, first by 3.89 s, at 4",
            ),
        ],
    )
    def test_stamps_that_go_back_for_more_than_one_transform_are_found(self, lists, expected):
        found = [*received(*lists).jumps("; advice")]
        if expected is None:
            assert found == []
        else:
            [one] = found
            assert line_of(one).startswith(f"clock: the stamps of {expected}: lookups mix ")
            assert line_of(one).endswith(" before and after; advice")
            assert one.frames == tuple(expected.partition(" went")[0].split(", "))

    @pytest.mark.parametrize(
        ("lists", "expected"),
        [
            (
                [steady("odom", end=2), steady("odom", start=2, delay=-100)],
                ["odom jumped ahead by 100 s, at 2"],
            ),
            (
                [
                    steady(one, start=start, end=start + 4, delay=-1e8 * (start > 0))
                    for one in ("odom", "base")
                    for start in (0, 4)
                ],
                ["base, odom jumped ahead by 3.17 years, at 4"],
            ),
            # One that is wrong is ahead first, and the others are behind it.
            (
                [steady("odom"), [heard(2.001, "odom", delay=-20)]],
                ["odom went back by 20 s, at 2.02", "odom jumped ahead by 20 s, at 2.001"],
            ),
            ([steady("odom", end=1), steady("odom", start=60, end=61)], []),  # a pause of both
            ([steady("odom", end=1), steady("odom", start=60, end=61, delay=59)], []),  # of the stamps only
            ([steady("odom"), [heard(1.001 + i, "odom", delay=50) for i in range(2)]], []),  # late ones
            ([steady("odom", delay=-5), steady("odom", publisher="/other", delay=30)], []),
        ],
    )
    def test_stamps_that_jump_ahead_are_found(self, lists, expected):
        found = [line_of(one).rpartition(": ")[0] for one in received(*lists).jumps()]
        assert found == [f"clock: the stamps of {one}" for one in expected]

    @pytest.mark.parametrize("rates", [(20, 10), (10, 20), (20, 20), (50, 1)])
    @pytest.mark.parametrize("behind", [20.0, 1e9])
    def test_two_clocks_at_the_same_time_are_not_separated_by_a_time(self, rates, behind):
        one = steady("odom", rate=rates[0])
        found = received(one, steady("odom", rate=rates[1], start=0.001, delay=behind)).jumps("; advice")
        [text] = map(line_of, found)
        assert text.startswith("clock: the stamps of odom alternate between two clocks, and went back ")
        assert text.endswith(": two publishers send them at the same time")

    @pytest.mark.parametrize(
        ("meters", "degrees", "apart"),
        [
            (0.25, 0.0, "0.25 m and 0 degrees"),
            (0.0, 0.11, "0 m and 0.11 degrees"),
            (0.002, 180.0, "0.002 m and 180 degrees"),
            (0.0009, 0.09, None),
            (0.0, 360.0, None),  # q and -q
        ],
    )
    def test_two_poses_at_one_stamp_are_found(self, meters, degrees, apart):
        half = np.radians(degrees) / 2
        sent = [
            (1, "odom", 0.0, 0.0),
            (2, "odom", 0.0, 0.0),
            (2, "odom", meters, half),
            (2, "odom", 0.0, 0.0),
        ]
        sent += [
            (3, "odom", meters, half),
            (3, "map", 5.0, 0.0),
            (0, "odom", 0.0, 0.0),
            (0, "odom", 5.0, 0.0),
        ]
        assert self.found_in(sent) == (
            [f"{self.AT_ONE} {apart} apart, first at 2.000 s: lookups mix them"] if apart else []
        )

    @pytest.mark.parametrize(
        ("sent", "apart"),
        [
            ([(2, "odom", x, 0.0) for x in (0.0, -0.3, 0.0, 0.5)], "0.8 m and 0 degrees"),
            ([(2, "odom", x, 0.0) for x in (0.0, -0.0009, 0.0009)], "0.0018 m and 0 degrees"),
            ([(2, "map", 5.0, 0.0), (2, "odom", 0.0, 0.0), (2, "odom", 0.3, 0.0)], "0.3 m and 0 degrees"),
            ([(2, "odom", 0.0, 0.0), (2, "map", 5.0, 0.0), (2, "odom", 0.3, 0.0)], "0.3 m and 0 degrees"),
        ],
    )
    def test_each_two_poses_at_one_stamp_are_compared(self, sent, apart):
        assert self.found_in(sent) == [f"{self.AT_ONE} {apart} apart, first at 2.000 s: lookups mix them"]

    AT_ONE = "values: base in odom has different poses at 1 stamp, up to"

    @staticmethod
    def found_in(sent):
        """What is found at equal stamps of these: second, parent, x, half of the yaw."""
        buffer = BufferCore()
        for second, parent, x, turn in sent:
            moved = TransformStamped(child_frame_id="base")
            moved.header.frame_id, moved.header.stamp.sec = parent, second
            moved.transform.translation.x = x
            moved.transform.rotation.z, moved.transform.rotation.w = np.sin(turn), np.cos(turn)
            buffer.set_transform(moved, "/tf")
        return [line_of(one) for one in received([]).of_equal_stamps(buffer.histories().values())]


def random_traffic(generator):
    """
    A few seconds of several publishers, in the order of arrival; the clock may jump back several times.

    Each time by a second at least: what is received by a clock that goes back by less is not in order.
    """
    mine = []
    for publisher in PUBLISHERS:
        start = generator.choice([0, generator.uniform(0, 2)])
        for child in generator.sample(FRAMES[1:], 3):
            how = {"parent": generator.choice(FRAMES[:2]), "publisher": publisher}
            how["static"] = generator.random() < 0.2
            end, rate = start + generator.choice([0.01, 0.5, 4]), generator.choice([1, 5, 20])
            digits = generator.choice([1, 6])  # with one, as of simulated time
            for time in np.arange(start, end, 1 / rate):
                how.update(delay=generator.uniform(0, 0.3), refusals=generator.choice([0, 0, 8]))
                mine.append(heard(round(time, digits), child, **how))
    mine = records(mine)
    for _ in range(generator.choice([0, 0, 1, 2, 3])):
        mine["received_ns"][generator.randrange(len(mine)) :] -= round(generator.uniform(1, 3) * S)
    return mine


def kept_of(*batches):
    streams = Streams()
    for batch in batches:
        streams.add(batch)
    return streams.kept(at(0))


def settled_streams(batches, window):
    streams = Streams(window)
    now_ns = int(np.concatenate(batches)["received_ns"][-1]) + S // 100
    for batch in batches:
        streams.add(batch)
        streams.kept(min([now_ns, *batch["received_ns"][-1:].tolist()]))  # drops what no later report needs
    return streams.report(now_ns, FRAMES, PUBLISHERS)


class TestSettling:
    def test_of_the_first_half_second_of_a_publisher_only_the_last_ones_stay(self):
        late = [heard(1, child, delay=0.3) for child in ("base", "odom") for _ in range(20)]
        mine = records(late, steady("base", start=1.02, end=2), [heard(1, "camera", static=True)])
        kept = kept_of(mine)
        odom, camera = (kept[kept["child"] == FRAMES.index(name)] for name in ("odom", "camera"))
        assert (len(odom), len(camera)) == (1, 1)
        base = kept[kept["child"] == FRAMES.index("base")]
        assert (base["received_ns"] - base["stamp_ns"]).max() < 0.02 * S
        assert base["received_ns"].min() >= at(1.48)
        assert np.count_nonzero(base["received_ns"] >= at(1.5)) == np.count_nonzero(
            mine["received_ns"] >= at(1.5)
        )

    def test_ends_when_the_clock_jumps_back(self):
        before = records(steady("base", start=100, end=100.2))
        assert (len(kept_of(before)), len(kept_of(before, records(steady("base"))))) == (1, 200)

    @pytest.mark.parametrize("window", [None, 1.0])
    @pytest.mark.parametrize("seed", seeds(50))
    def test_no_report_depends_on_how_the_records_are_cut(self, seed, window):
        generator = random.Random(seed)
        mine = random_traffic(generator)
        mine = mine[: generator.choice([len(mine), generator.randrange(1, len(mine))])]
        places = sorted(generator.choices(range(len(mine) + 1), k=generator.randrange(1, 30)))
        whole, pieces = (settled_streams(some, window) for some in ([mine], np.split(mine, places)))
        for one, other in zip(pieces[0], whole[0], strict=True):
            assert asdict(one) == pytest.approx(asdict(other), abs=1e-6)
        assert pieces[1] == whole[1]
        assert find(pieces[0], Limits()) == find(whole[0], Limits())


class TestExpectations:
    def test_are_read_from_a_file(self, tmp_path):
        path = tmp_path / "robot.yaml"
        path.write_text(
            "frames:\n"
            "  /base: {parent: /odom, min_rate: 20, max_delay: 1e-1, static: false}\n"
            "  odom: {max_future: 1}\n"
            "  camera:\n",
            encoding="utf-8",
        )
        assert expected_by(path) == {
            "base": Expectation("odom", False, 20, 0.1),
            "odom": Expectation(max_future=1),
            "camera": Expectation(),
        }

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("", "the key 'frames' only"),
            ("frames: [base]", "mapping such as"),
            ("frames: {1: {}}", "mapping such as"),
            ("frames: {//base: {}}", "'//base' is not the name of a frame"),
            ("frames: {'': {}}", "'' is not the name of a frame"),
            ("frames: {/base: {}, base: {}}", "'base' and '/base' are the same frame"),
            ("frames: {base: {parent: /}}", "base: 'parent': expected the name of a frame, got '/'"),
            ("frames: {base: odom}", "base: expected a mapping with parent and static and "),
            ("frames: {base: {rate: 3}}", "base: 'rate' is not a key; did you mean min_rate"),
            ("frames: {base: {min_rate: fast}}", "base: 'min_rate': expected a number that .*, got 'fast'"),
            ("frames: {base: {static: true, static: false}}", "is not YAML: 'static' occurs twice"),
            ("frames:\n  base: {}\n  odom: {}\n  base: {min_rate: 3}", "is not YAML: 'base' occurs twice"),
            (f"frames: {5000 * '['}", "is not YAML"),
        ],
    )
    def test_what_is_not_understood_is_told(self, text, said, tmp_path):
        path = tmp_path / "robot.yaml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(UsageError, match=said):
            expected_by(path)

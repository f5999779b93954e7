"""What is computed of received transforms: figures, chains, findings. Without a node."""

import math
import random
import statistics
from argparse import Namespace
from dataclasses import asdict, replace

import numpy as np
import pytest

from tf2_ros.records import RECORD
from tf2_ros_tools.findings import KINDS, Expectation, Limits, expected_by, find
from tf2_ros_tools.program import UsageError
from tf2_ros_tools.streams import (
    TAIL,
    Settling,
    Streams,
    chain_between,
    moving_on,
    net_delay,
    newest_streams,
    replaced,
    taken,
    unknown_ends,
)

pytestmark = pytest.mark.ours

S = 1_000_000_000
START_NS = 1_795_000_000 * S
FRAMES = ["map", "odom", "base", "camera", "lidar", "world"]
DEFAULTS, NOTHING = Limits(), {}
PUBLISHERS = ["/localiser", "/odometry", "/other"]


def at(seconds):
    return START_NS + round(seconds * S)


def heard(received, child, parent="map", publisher="/odometry", delay=0.01, static=False, refusals=0):
    """One record; times in seconds, `received` from the start."""
    return (
        at(received),
        at(received - delay),
        FRAMES.index(child),
        FRAMES.index(parent),
        PUBLISHERS.index(publisher),
        static,
        refusals,
    )


def steady(child, parent="map", rate=50, start=0.0, end=4.0, **how):
    times = np.arange(round((end - start) * rate)) / rate + start
    return [heard(time, child, parent, **how) for time in times]


def records(*lists):
    return np.array(sorted(one for some in lists for one in some), RECORD)


def reported(*lists, now=4.0, window=None, pieces=1):
    streams = Streams(window)
    for piece in np.array_split(records(*lists), pieces):
        streams.add(piece)
    return streams.report(at(now), FRAMES, PUBLISHERS)


def streams_of(*lists, **how):
    return reported(*lists, **how).streams


def found(*lists, limits=DEFAULTS, expected=NOTHING, alive=None, **how):
    streams, refused = reported(*lists, **how)
    return find(streams, limits, expected, alive, refused=refused)


def kinds(findings):
    return sorted({(one.kind, one.frame) for one in findings})


ROBOT = (
    steady("odom", "map", 20, publisher="/localiser"),
    steady("base", "odom"),
    [heard(0, "camera", "base", static=True), heard(0, "lidar", "base", static=True)],
)


class TestFigures:
    def test_of_a_steady_frame(self):
        [one] = streams_of(steady("odom", rate=20, delay=0.25))
        assert (one.frame, one.parent, one.publisher, one.static) == ("odom", "map", "/odometry", False)
        assert one.count == 80
        assert one.rate == pytest.approx(20)
        assert one.period == pytest.approx(0.05)
        assert (one.delay, one.delay_max, one.delay_min) == pytest.approx((0.25, 0.25, 0.25))
        assert one.jitter == pytest.approx(0, abs=1e-6)
        assert one.silence == one.stalled == pytest.approx(0.05)
        assert one.first == pytest.approx(4)
        assert one.gap == pytest.approx(0.05)

    @pytest.mark.parametrize("pieces", [1, 2, 7, 100])
    def test_do_not_depend_on_the_pieces_in_which_records_come(self, pieces):
        generator = random.Random(4)
        delays = [generator.expovariate(20) for _ in range(100)]
        times = sorted(generator.uniform(0, 3) for _ in range(100))
        mine = [heard(time, "base", delay=delay) for time, delay in zip(times, delays, strict=True)]
        [one] = streams_of(mine, pieces=pieces)
        assert one.count == 100
        assert one.rate == pytest.approx(99 / (times[-1] - times[0]))
        assert one.delay == pytest.approx(statistics.fmean(delays), abs=1e-6)
        assert one.jitter == pytest.approx(statistics.pstdev(delays), abs=1e-6)
        assert (one.delay_min, one.delay_max) == pytest.approx((min(delays), max(delays)), abs=1e-6)
        intervals = np.diff(times)
        assert one.gap == pytest.approx(intervals.max(), abs=1e-6)
        assert one.period == pytest.approx((intervals.sum() - intervals.max()) / 98, abs=1e-6)
        stamps = [time - delay for time, delay in zip(times, delays, strict=True)]
        assert one.stalled == pytest.approx(4 - times[stamps.index(max(stamps))], abs=1e-6)

    def test_jitter_survives_a_delay_of_decades(self):
        """Whose stamps are zero."""
        mine = [heard(i / 50, "base", delay=START_NS / S + (0.001 if i % 2 else -0.001)) for i in range(50)]
        [one] = streams_of(mine)
        assert one.jitter == pytest.approx(0.001, rel=1e-3)

    def test_of_a_single_transform_there_is_no_rate(self):
        [one] = streams_of([heard(1, "base")])
        assert (one.count, one.rate, one.period, one.gap, one.jitter) == (1, None, None, 0, 0)
        assert one.silence == pytest.approx(3)

    def test_of_static_transforms_there_is_no_delay(self):
        [one] = streams_of([heard(1, "base", static=True)])
        assert one.static
        assert one.delay is one.delay_max is one.delay_min is one.jitter is None

    def test_are_those_of_the_window(self):
        mine = (steady("base", rate=10, end=20), steady("base", rate=50, start=20, end=30, delay=0.2))
        [one] = streams_of(*mine, now=30, window=5, pieces=30)
        assert one.rate == pytest.approx(50)
        assert one.delay == pytest.approx(0.2)
        assert 4.9 < one.first < 6.1  # the pieces are of a second

    @pytest.mark.parametrize("pieces", [1, 3])
    def test_are_of_what_buffers_take_and_beside_them_is_what_is_refused(self, pieces):
        mine = [heard(i / 10, "base", refusals=8 if i > 3 else 32 if i == 3 else 0) for i in range(10)]
        [one], [refused] = reported(mine, pieces=pieces)
        assert (one.frame, one.count, one.rate) == ("base", 3, pytest.approx(10))
        assert (refused.frame, refused.parent, refused.publisher) == ("base", "map", "/odometry")
        assert (refused.count, refused.received, refused.static) == (7, 10, False)
        assert refused.because == "a number is NaN and the translation is infinite"

    @pytest.mark.parametrize("seed", range(30))
    def test_do_not_depend_on_what_is_refused(self, seed):
        generator = random.Random(f"refused {seed}")
        mine = random_traffic(generator)
        mine = mine[np.argsort(mine["received_ns"], kind="stable")]  # a jump may be one between refused ones
        window, now_ns = generator.choice([None, 1.0, 10.0]), int(mine["received_ns"][-1])
        batches = cut(mine, generator)
        figures = []
        for some in (batches, [taken(batch) for batch in batches]):
            streams = Streams(window)
            for batch in some:
                streams.add(batch)
            figures.append(streams.report(now_ns, FRAMES, PUBLISHERS))
        assert figures[0].streams == figures[1].streams
        assert figures[1].refused == []
        if window is None:
            assert sum(one.count for one in figures[0].refused if not one.static) == sum(
                (mine["refusals"] != 0) & (mine["static"] == 0)
            )

    def test_a_refused_static_one_stays_until_its_publisher_replaces_it(self):
        bad = heard(1, "camera", "base", static=True, refusals=8)
        assert [one.count for one in reported([bad], window=2, now=60).refused] == [1]
        good = [heard(0, "camera", "base", static=True)]
        assert [one.received for one in reported(good, [bad]).refused] == [2]
        assert reported([bad], [heard(2, "camera", "odom", static=True)]).refused == []
        assert [
            one.received for one in reported([heard(0, "camera", "odom", static=True)], [bad]).refused
        ] == [2]
        other = [heard(2, "camera", "base", static=True, publisher="/other")]
        assert len(reported([bad], other).refused) == 1

    def test_of_a_slow_frame_the_period_is_known_beyond_the_window(self):
        [one] = streams_of(steady("base", rate=0.1, end=60), now=59, window=5, pieces=60)
        assert (one.count, one.rate) == (0, None)
        assert one.period == pytest.approx(10)
        assert one.silence == pytest.approx(9)

    def test_beyond_the_window_a_few_records_of_each_stream_are_kept(self):
        mine = records(steady("base", rate=100, end=100), steady("odom", rate=1, end=100))
        streams = Streams(2.0)
        for piece in np.array_split(mine, 1000):
            streams.add(piece)
        assert sum(len(piece) for piece, _ in streams._pieces) < 2000
        whole = Streams(2.0)
        whole.add(mine)
        assert streams.report(at(100), FRAMES, PUBLISHERS) == whole.report(at(100), FRAMES, PUBLISHERS)
        assert sum(len(piece) for piece, _ in streams._pieces) <= 2 * 101 + TAIL

    def test_a_stamp_that_stands_still_for_longer_than_the_window(self):
        mine = records(
            steady("base", rate=10, end=5), [heard(5 + i / 10, "base", delay=1 + i / 10) for i in range(200)]
        )
        streams = Streams(2.0)
        for piece in np.array_split(mine, 300):
            streams.add(piece)
        [one], _ = streams.report(at(25), FRAMES, PUBLISHERS)
        assert one.stalled == pytest.approx(20.1)

    def test_a_frame_may_appear_at_any_time(self):
        mine = steady("base", end=4), steady("odom", start=2, end=4), [heard(3, "camera", static=True)]
        current = streams_of(*mine, window=3.5, pieces=40)
        assert [one.frame for one in current] == ["base", "camera", "odom"]
        assert all(one.rate == pytest.approx(50) for one in current if not one.static)

    def test_of_no_records_there_are_none(self):
        assert streams_of() == []

    def test_after_a_jump_of_the_clock_only_static_ones_remain(self):
        streams = Streams()
        streams.add(records([*steady("base", start=100, end=104), heard(100, "camera", "base", static=True)]))
        streams.add(records(steady("odom", end=2)))
        assert [one.frame for one in streams.report(at(2), FRAMES, PUBLISHERS).streams] == ["camera", "odom"]

    def test_a_jump_may_be_between_two_records(self):
        mine = np.array(
            [
                heard(100, "camera", "base", static=True),
                heard(100, "base"),
                heard(2, "odom"),
                heard(2.1, "odom"),
            ],
            RECORD,
        )
        streams = Streams()
        streams.add(mine)
        current, _ = streams.report(at(2.2), FRAMES, PUBLISHERS)
        assert [(one.frame, one.count) for one in current] == [("camera", 1), ("odom", 2)]

    @pytest.mark.parametrize("pieces", [1, 3, 40])
    def test_what_was_sent_before_a_jump_and_received_after_it_is_forgotten(self, pieces):
        # The clock jumps from 60 to 2 s, and the last three transforms from before arrive only then.
        before = steady("base", start=50.0, end=60.0)
        late = [heard(2.0 + i / 1000, "base", delay=-57.9) for i in range(3)]
        mine = np.array([*before, *late, *steady("base", start=2.01, end=20.0)], RECORD)
        streams = Streams()
        for piece in np.array_split(mine, pieces):
            streams.add(piece)
        mean, most = streams.net_delay([FRAMES.index("base")], at(20.0))
        assert 0.0 < mean < most < 0.1
        [one], _ = streams.report(at(20.0), FRAMES, PUBLISHERS)
        assert one.delay_min == pytest.approx(0.01)
        jump = streams.jump_back(at(20.0))
        assert jump == pytest.approx(58, abs=0.1)
        [finding] = find([one], DEFAULTS, jump_back=jump)
        assert (finding.kind, finding.text.split(";")[0]) == ("clock", "the clock jumped back by 58 s")

    def test_records_that_overtook_each_other_are_no_jump(self):
        mine = np.array([heard(1, "base"), heard(0.9, "base"), heard(1.1, "base")], RECORD)
        streams = Streams()
        streams.add(mine)
        [one], _ = streams.report(at(2), FRAMES, PUBLISHERS)
        assert one.count == 3

    def test_the_records_stay_as_they_are(self):
        mine = records(*ROBOT)
        before = mine.copy()
        streams = Streams(1.0)
        streams.add(mine)
        streams.report(at(4), FRAMES, PUBLISHERS)
        assert (mine == before).all()


class TestChains:
    NEWEST = newest_streams(streams_of(*ROBOT))

    def test_lead_over_the_common_ancestor(self):
        assert chain_between(self.NEWEST, "camera", "lidar") == ["camera", "base", "lidar"]
        assert chain_between(self.NEWEST, "map", "camera") == ["map", "odom", "base", "camera"]
        assert chain_between(self.NEWEST, "camera", "map") == ["camera", "base", "odom", "map"]
        assert chain_between(self.NEWEST, "odom", "odom") == ["odom"]

    def test_what_moves_on_them_are_dynamic_frames_below_the_top(self):
        assert moving_on(self.NEWEST, ["map", "odom", "base", "camera"]) == ["odom", "base"]
        assert sorted(moving_on(self.NEWEST, ["camera", "base", "odom", "map"])) == ["base", "odom"]
        assert moving_on(self.NEWEST, ["camera", "base", "lidar"]) == []
        assert moving_on(self.NEWEST, ["odom"]) == []

    def test_of_unconnected_frames_there_is_none(self):
        assert chain_between(self.NEWEST, "camera", "world") is None

    def test_in_a_loop_they_end(self):
        newest = newest_streams(streams_of(steady("odom", "base"), steady("base", "odom")))
        assert chain_between(newest, "odom", "map") is None
        assert chain_between(newest, "odom", "base") == ["odom", "base"]

    def test_the_parent_is_the_one_that_was_heard_last(self):
        newest = newest_streams(streams_of(steady("base", "odom", end=2), steady("base", "map", start=1)))
        assert newest["base"].parent == "map"


class TestNetDelay:
    CHILDREN = [FRAMES.index(name) for name in ("odom", "base")]

    @staticmethod
    def expected(mine, children, until):
        """Mean and maximum, by steps of a tenth of a millisecond."""
        ages, newest, i = [], {}, 0
        begin = None
        for step in range(round(until * 10_000)):
            now = at(step / 10_000)
            while i < len(mine) and mine[i]["received_ns"] <= now:
                child = int(mine[i]["child"])
                if child in children:
                    newest[child] = max(newest.get(child, -math.inf), mine[i]["stamp_ns"])
                i += 1
            if len(newest) == len(children):
                begin = now if begin is None else begin
                ages.append((now - min(newest.values())) / S)
        return statistics.fmean(ages), max(ages)

    @pytest.mark.parametrize("pieces", [1, 13])
    def test_is_the_age_of_the_newest_common_time_over_all_times(self, pieces):
        generator = random.Random(2)
        mine = records(
            [
                heard(generator.uniform(0, 2), child, "map", delay=generator.uniform(0, 0.1))
                for child in ("odom", "base", "camera")
                for _ in range(40)
            ]
        )
        streams = Streams()
        for piece in np.array_split(mine, pieces):
            streams.add(piece)
        expected = self.expected(mine, self.CHILDREN, 2.05)
        assert streams.net_delay(self.CHILDREN, at(2.05)) == pytest.approx(expected, abs=5e-4)

    def test_needs_every_frame_of_the_chain(self):
        assert net_delay(records(steady("odom")), self.CHILDREN, 0, at(4)) is None

    def test_of_a_static_chain_is_unknown(self):
        assert net_delay(records(*ROBOT), [], 0, at(4)) is None

    def test_is_that_of_the_window(self):
        streams = Streams(2.0)
        streams.add(records(steady("odom", rate=100, end=2, delay=1.0)))
        streams.add(records(steady("odom", rate=100, start=2, end=6, delay=0.1)))
        odom = [FRAMES.index("odom")]
        mean, most = streams.net_delay(odom, at(3.5))
        assert 0.1 < mean < 0.5 and most == pytest.approx(1.01)
        assert streams.net_delay(odom, at(6)) == pytest.approx((0.105, 0.11), abs=1e-3)
        assert streams.net_delay(odom, at(9)) == pytest.approx((2.11, 3.11), abs=0.01)

    def test_grows_while_nothing_arrives(self):
        mine = records([heard(0, "odom", delay=0.5)])
        assert net_delay(mine, [FRAMES.index("odom")], 0, at(3)) == pytest.approx((2, 3.5))


class TestFindings:
    def test_a_healthy_robot_has_none(self):
        assert found(*ROBOT) == []
        assert found(*ROBOT, window=2, pieces=40) == []

    def test_silence(self):
        assert kinds(found()) == [("nothing", "")]

    def test_two_trees(self):
        robot, other = ROBOT[:2], [heard(1, "lidar", "world", static=True)]
        [one] = found(*robot, other)
        assert one.text == "2 unconnected trees: map (3 frames), world (2 frames)"
        assert (one.kind, one.numbers) == ("roots", {"roots": ["map", "world"]})

    def test_a_loop(self):
        mine = steady("odom", "base"), steady("base", "odom"), steady("camera", "base")
        [one] = found(*mine)
        assert (one.kind, one.text) == ("loop", "the frames base -> odom -> base form a loop")

    def test_a_frame_below_itself(self):
        assert kinds(found(steady("odom", "odom"))) == [("loop", "odom")]

    def test_two_parents_in_turn(self):
        mine = steady("base", "odom"), steady("base", "map", start=0.01)
        [one] = found(*ROBOT[:1], *mine)
        assert (one.kind, one.frame) == ("parents", "base")
        assert one.text == "base has 2 parents in turn: map, odom"

    def test_another_parent_from_some_time_on_is_none(self):
        assert found(*ROBOT[:1], steady("base", "odom", end=2), steady("base", "map", start=2)) == []

    def test_two_publishers(self):
        mine = steady("base", "odom", publisher="/other", start=0.005)
        [one] = found(*ROBOT, mine)
        assert (one.kind, one.frame) == ("publishers", "base")
        assert one.text == "base is published by 2 publishers: /odometry, /other"

    def test_a_restarted_publisher_is_one(self):
        mine = steady("base", end=2), steady("base", start=2.5, publisher="/other", end=4)
        assert found(*mine) == []

    def test_two_publishers_of_a_static_frame(self):
        again = [heard(1, "camera", "base", publisher="/other", static=True)]
        assert kinds(found(*ROBOT, again)) == [("publishers", "camera")]
        # Unless one of them has ended.
        assert found(*ROBOT, again, alive={0, 2}) == []

    def test_a_static_frame_that_is_sent_again_is_healthy(self):
        again = [heard(time, "camera", "base", static=True) for time in (1, 2, 3)]
        assert found(*ROBOT, again) == []

    def test_a_static_frame_that_its_publisher_moves_is_healthy(self):
        assert found(*ROBOT, [heard(1, "camera", "odom", static=True)]) == []

    def test_a_frame_both_static_and_dynamic(self):
        assert kinds(found(*ROBOT, steady("camera", "base"))) == [("mixed", "camera")]

    def test_what_every_buffer_refuses(self):
        [one] = found(*ROBOT, [heard(1, "lidar", "base", static=True, refusals=16)])
        assert (one.kind, one.frame, one.numbers["refused"]) == ("refused", "lidar", 1)
        assert (
            one.text
            == "1 of 2 transforms of lidar by /odometry are refused: the rotation is too short or too long"
        )
        # A publisher that has ended sends it to nobody any more.
        assert found(*ROBOT, [heard(1, "lidar", "base", static=True, refusals=16)], alive={0}) == []

    def test_what_is_refused_is_no_part_of_the_tree(self):
        """Of the frames of a robot: below itself, below another one, static, and below none."""
        again = (
            steady("odom", "odom", 20, publisher="/localiser", refusals=1),
            steady("base", "world", refusals=8),
            [heard(2, "base", "world", static=True, refusals=8)],
            [heard(2, "camera", "lidar", static=True, refusals=8)],
        )
        assert {one.kind for one in found(*ROBOT, *again)} == {"refused"}
        nothing, refused = found(steady("odom", "odom", refusals=1))
        assert nothing.text == "no transform that buffers accept was received"
        assert (refused.kind, refused.frame) == ("refused", "odom")

    def test_what_is_refused_hides_nothing(self):
        broken = steady("odom", refusals=8), steady("base", "odom"), steady("camera")
        assert kinds(found(*broken)) == [("refused", "odom"), ("roots", "")]
        base = steady("base", end=1), steady("base", start=1, refusals=8)
        assert kinds(found(*base)) == [("refused", "base"), ("stale", "base")]
        slow = found(steady("base", refusals=8), steady("base", rate=5), limits=Limits(min_rate=20))
        assert kinds(slow) == [("rate", "base"), ("refused", "base")]
        [_, missing] = found(*ROBOT, steady("world", refusals=8), expected={"world": Expectation()})
        assert missing.text == "world is expected, and all its transforms are refused"

    def test_a_frame_that_is_no_longer_published(self):
        [one] = found(steady("odom", end=2))
        assert one.kind == "stale"
        assert one.numbers["silence"] == pytest.approx(2.02)
        assert found(steady("odom", end=3.2)) == []

    def test_a_slow_frame_is_not_stale_within_ten_periods(self):
        assert found(steady("odom", rate=1, end=20), now=29) == []
        assert kinds(found(steady("odom", rate=1, end=20), now=30)) == [("stale", "odom")]

    def test_a_stamp_that_stands_still(self):
        mine = [heard(time, "odom", delay=time) for time in np.arange(200) / 50]
        assert kinds(found(mine)) == [("stale", "odom")]

    def test_a_single_transform_is_not_stale(self):
        assert found([heard(0, "odom")], now=1000) == []

    def test_static_frames_are_never_stale(self):
        again = [heard(time, "camera", static=True) for time in (0, 0.01, 0.02)]
        assert found(again, now=1000) == []

    def test_stamps_in_the_future(self):
        [one] = found(steady("odom", delay=-0.5))
        assert one.kind == "future"
        assert one.numbers["ahead"] == pytest.approx(0.5)
        assert found(steady("odom", delay=-0.05)) == []
        assert found(steady("odom", delay=-0.5), expected={"odom": Expectation(max_future=1.0)}) == []

    def test_stamps_of_a_clock_that_is_late(self):
        [one] = found(steady("odom", delay=5))
        assert (one.kind, one.frame) == ("delay", "odom")
        assert one.text == "odom is on average 5 s old when it is received, more than 1 s"
        assert one.numbers == {"delay": pytest.approx(5), "max_delay": 1}
        assert found(steady("odom", delay=0.9)) == []
        # For a slow frame, it is a few periods.
        assert found(steady("odom", rate=0.5, end=20, delay=5), now=20) == []
        assert kinds(found(steady("odom", rate=0.5, end=20, delay=7), now=20)) == [("delay", "odom")]
        # On a busy machine single transforms are late.
        assert found(steady("odom"), [heard(3.0 + i / 100, "odom", delay=3) for i in range(20)]) == []
        late = found(steady("odom", delay=5, end=2))
        assert kinds(late) == [("delay", "odom"), ("stale", "odom")]

    def test_the_longest_delay_may_be_given(self):
        assert found(steady("odom", delay=5), limits=Limits(max_delay=6)) == []
        [one] = found(steady("odom"), [heard(3, "odom", delay=0.5)], limits=Limits(max_delay=0.25))
        assert one.text == "odom is up to 0.5 s old when it is received, more than 0.25 s"
        expected = {"odom": Expectation(max_delay=1.0)}
        assert found(steady("odom", delay=0.5), limits=Limits(max_delay=0.25), expected=expected) == []

    @pytest.mark.parametrize(
        ("delay", "where"),
        [
            (START_NS / S - 100, "56.9 years behind"),
            (100 - START_NS / S, "56.9 years ahead of"),
            (2 * 3600.0, "2 hours behind"),
        ],
    )
    def test_stamps_of_another_clock(self, delay, where):
        other = steady("base", "odom", delay=delay), steady("camera", "base", delay=delay)
        [one] = found(*ROBOT[:1], *other)
        assert (one.kind, one.frame) == ("clocks", "")
        assert one.text == (
            f"the stamps of base, camera by /odometry are {where} the clock of this program: "
            "only one of the two is simulated (see use_sim_time), or a clock is wrong"
        )
        assert one.numbers["frames"] == ["base", "camera"]
        assert one.numbers["delay"] == pytest.approx(delay, abs=1)

    def test_a_stamp_that_was_forgotten_is_not_another_clock(self):
        [one] = found(steady("odom"), [heard(2, "odom", delay=at(2) / S)])
        assert (one.kind, one.frame) == ("delay", "odom")

    def test_simulated_time_without_a_clock(self):
        [one] = find(streams_of(*ROBOT), DEFAULTS, no_clock=True)
        assert (one.kind, one.frame) == ("clock", "")
        assert one.text.startswith("use_sim_time is set, and no time was received on /clock")

    def test_which_of_a_frames_publishers_is_meant(self):
        other = steady("odom", delay=-1, publisher="/other", start=0.01)
        said = [one.text for one in found(steady("odom", delay=-1), other) if one.kind == "future"]
        assert sorted(said) == [
            f"odom by {name} is stamped up to 1 s ahead" for name in ("/odometry", "/other")
        ]
        streams = streams_of(steady("odom", delay=-1), other)
        streams = [replace(one, publisher="/started_twice") for one in streams]
        said = [one.text for one in find(streams, DEFAULTS) if one.kind == "future"]
        assert sorted(text.partition(" is stamped")[0] for text in said) == [
            f"odom by /started_twice ({number} of 2 of this name)" for number in (1, 2)
        ]

    def test_which_of_a_frames_parents_is_meant(self):
        mine = steady("base", "odom", delay=-1), steady("base", "map", delay=-1, start=0.01)
        said = [one.text for one in found(*ROBOT[:1], *mine) if one.kind == "future"]
        assert sorted(said) == [f"base in {name} is stamped up to 1 s ahead" for name in ("map", "odom")]

    def test_a_gap(self):
        [one] = found(steady("odom", end=1), steady("odom", start=2))
        assert one.kind == "gap"
        assert one.numbers["gap"] == pytest.approx(1.02)

    def test_a_burst_has_no_gaps(self):
        """As where simulated time stands still between messages of /clock."""
        mine = [heard(0.1 * (i // 5), "odom") for i in range(200)]
        assert found(mine) == []

    def test_few_transforms_have_no_gaps(self):
        assert found([heard(time, "odom") for time in (0, 0.01, 3, 3.01)]) == []

    def test_a_rate_that_is_too_low(self):
        [one] = found(steady("odom", rate=10), limits=Limits(min_rate=20))
        assert one.kind == "rate"
        assert one.numbers == {"rate": pytest.approx(10), "min_rate": 20}
        assert found(steady("odom", rate=20), limits=Limits(min_rate=20)) == []
        assert found(*ROBOT, limits=Limits(min_rate=19)) == []

    def test_the_rate_of_a_frame_that_has_ended_falls(self):
        mine = steady("odom", rate=100, end=3.2)
        assert kinds(found(mine, limits=Limits(min_rate=90))) == [("rate", "odom")]

    def test_the_rate_of_a_frame_that_came_a_moment_ago_is_unknown(self):
        limits = Limits(min_rate=20)
        assert found([heard(3.95, "odom")], limits=limits) == []
        assert kinds(found([heard(3, "odom")], limits=limits)) == [("rate", "odom")]

    @pytest.mark.parametrize(
        ("expected", "kind"),
        [
            (Expectation(parent="odom"), None),
            (Expectation(parent="map"), "parent"),
            (Expectation(min_rate=40), None),
            (Expectation(min_rate=60), "rate"),
            (Expectation(max_delay=0.02), None),
            (Expectation(max_delay=0.005), "delay"),
            (Expectation(static=False), None),
            (Expectation(static=True), "static"),
        ],
    )
    def test_what_differs_from_what_is_expected(self, expected, kind):
        wanted = [] if kind is None else [(kind, "base")]
        assert kinds(found(*ROBOT, expected={"base": expected})) == wanted

    def test_a_frame_that_is_missing(self):
        assert kinds(found(*ROBOT, expected={"world": Expectation()})) == [("missing", "world")]

    def test_an_expected_rate_goes_before_the_common_one(self):
        expected = {"odom": Expectation(min_rate=10)}
        assert found(*ROBOT, limits=Limits(min_rate=40), expected=expected) == []

    def test_are_told_in_one_order(self):
        mine = (
            steady("base", delay=-1),
            steady("base", "odom", delay=-1, start=0.01),
            steady("lidar", "world"),
        )
        told = [one.kind for one in found(*mine)]
        assert told == ["roots", "parents", "future", "future"]
        assert told == sorted(told, key=list(KINDS).index)


def thinned(mine):
    return mine[~replaced(mine, Settling().early(mine))]


def random_traffic(generator):
    """
    A few seconds of several publishers, in the order of arrival; each starts, and may end, at some time.

    Some send only once, some several times in one moment; the clock may jump back.
    """
    mine, frames = [], FRAMES[1:]
    for publisher in PUBLISHERS:
        start = generator.choice([0, 0.2, generator.uniform(0, 2)])
        for child in generator.sample(frames, 3):
            how = {
                "parent": generator.choice(FRAMES[:2]),
                "publisher": publisher,
                "static": generator.random() < 0.2,
            }
            refusals = generator.choice([[0], [0], [0, 8], [1]])
            first, last = (start + generator.choice([0, generator.uniform(0, 0.6)]) for _ in range(2))
            rate, last = generator.choice([(1, first), (5, 4), (20, 4), (20, 2), (20, last)])
            times = [first + i / rate for i in range(1 + max(0, round((last - first) * rate)))]
            if generator.random() < 0.3:
                times = [math.floor(time * 10) / 10 for time in times]  # as with simulated time
            for time in times:
                how.update(delay=generator.uniform(0, 0.3), refusals=generator.choice(refusals))
                mine.append(heard(time, child, **how))
    mine = records(mine)
    if generator.random() < 0.3:
        mine["received_ns"][generator.randrange(len(mine)) :] -= round(generator.uniform(0.1, 3) * S)
    return mine


def cut(mine, generator):
    places = sorted(generator.choices(range(len(mine) + 1), k=generator.randrange(1, 30)))
    return np.split(mine, places)


def settled_streams(batches, window):
    streams, settling = Streams(window), Settling()
    for batch in batches:
        streams.add(batch, settling.early(batch))
    now_ns = int(np.concatenate(batches)["received_ns"][-1]) + S // 100
    return streams.report(now_ns, FRAMES, PUBLISHERS)


class TestSettling:
    def test_of_the_first_half_second_of_a_publisher_only_the_last_ones_stay(self):
        late = [heard(1, child, delay=0.3) for child in ("base", "odom") for _ in range(20)]
        mine = records(late, steady("base", start=1.02, end=2), [heard(1, "camera", static=True)])
        kept = thinned(mine)
        odom, camera = (kept[kept["child"] == FRAMES.index(name)] for name in ("odom", "camera"))
        assert (len(odom), len(camera)) == (1, 1)
        base = kept[kept["child"] == FRAMES.index("base")]
        assert (base["received_ns"] - base["stamp_ns"]).max() < 0.02 * S
        assert base["received_ns"].min() >= at(1.48)
        assert np.count_nonzero(base["received_ns"] >= at(1.5)) == np.count_nonzero(
            mine["received_ns"] >= at(1.5)
        )

    def test_each_publisher_has_its_own(self):
        settling = Settling()
        settling.early(records(steady("base")))
        both = records(steady("base", start=4, end=5), steady("odom", publisher="/other", start=4, end=5))
        early = both[settling.early(both)]
        assert {*early["child"]} == {FRAMES.index("odom")}
        assert len(early) == 25

    def test_begins_with_the_first_record_of_the_publisher_itself(self):
        settling = Settling()
        settling.early(records(steady("base", publisher="/other")))  # whose number is higher
        assert settling.early(records(steady("odom", publisher="/localiser", start=9, end=9.4))).all()

    def test_ends_when_the_clock_jumps_back(self):
        settling = Settling()
        assert settling.early(records(steady("base", start=100, end=100.2))).all()
        assert not settling.early(records(steady("base"))).any()

    def test_of_nothing_nothing_is_left(self):
        assert len(thinned(records())) == 0

    @pytest.mark.parametrize("place", [1, 8, 24, 25, 26])
    def test_no_gap_is_found_where_a_batch_ended(self, place):
        mine = records(steady("base"))
        [one], _ = settled_streams([mine[:place], mine[place:]], None)
        assert (one.count, one.gap) == (176, pytest.approx(0.02))  # one of 25 that are early
        assert find([one], DEFAULTS, NOTHING, {one.publisher_id}) == []

    @pytest.mark.parametrize("window", [None, 60.0])
    @pytest.mark.parametrize("seed", range(100))
    def test_no_report_depends_on_how_the_records_are_cut(self, seed, window):
        generator = random.Random(seed)
        mine = random_traffic(generator)
        mine = mine[: generator.choice([len(mine), generator.randrange(1, len(mine))])]
        whole, pieces = (settled_streams(some, window) for some in ([mine], cut(mine, generator)))
        assert len(pieces.streams) == len(whole.streams)
        for one, other in zip(pieces.streams, whole.streams, strict=True):
            assert asdict(one) == pytest.approx(asdict(other), abs=1e-6)
        assert pieces.refused == whole.refused
        assert find(pieces.streams, DEFAULTS) == find(whole.streams, DEFAULTS)

    @pytest.mark.parametrize("seed", range(100))
    def test_a_report_has_every_frame_and_the_figures_of_what_stays(self, seed):
        generator = random.Random(seed)
        mine = random_traffic(generator)
        jumps = np.flatnonzero(np.diff(mine["received_ns"], prepend=mine["received_ns"][0]) < -S)
        since = np.arange(len(mine)) >= max(jumps, default=0)
        received, stamps = mine["received_ns"], mine["stamp_ns"]
        left_over = np.zeros(len(mine), bool)
        if len(jumps):
            before, after = received[jumps[-1] - 1], received[jumps[-1]]
            ahead = (stamps > received + S) & (stamps <= before + S)
            left_over = ahead & (received < after + S) & (mine["static"] == 0)
        early = dict.fromkeys(range(len(PUBLISHERS)), True)
        begin, stays = {}, {}
        for record, is_since, is_left_over in zip(mine, since, left_over, strict=True):
            publisher, static = int(record["publisher"]), bool(record["static"])
            begin.setdefault(publisher, record["received_ns"])
            early[publisher] &= 0 <= record["received_ns"] - begin[publisher] < S // 2
            if record["refusals"] or is_left_over or (not is_since and not static):
                continue
            stream = (int(record["child"]), int(record["parent"]), publisher, static)
            times = stays.setdefault(stream, [])
            if early[publisher] and not static:
                times.clear()
            times.append(int(record["received_ns"]))
        streams, _ = settled_streams(cut(mine, generator), None)
        assert {one.frame for one in streams} == {FRAMES[child] for child, *_ in stays}
        for one in streams:
            ends = (FRAMES.index(one.frame), FRAMES.index(one.parent))
            times = stays[(*ends, one.publisher_id, one.static)]
            gap = max(0, *np.diff(times), 0) / S
            assert (one.count, one.gap) == (len(times), pytest.approx(gap, abs=1e-6))


def test_a_frame_that_does_not_exist_is_told_with_those_that_may_be_meant():
    streams = streams_of(*ROBOT)
    assert unknown_ends(streams, ("map", "base")) == []
    assert unknown_ends(streams, ("mapp", "nope")) == [
        "mapp is not known; did you mean map?",
        "nope is not known",
    ]


class TestExpectations:
    def test_are_read_from_a_file(self, tmp_path):
        path = tmp_path / "robot.yaml"
        path.write_text(
            "frames:\n"
            "  /base: {parent: odom, min_rate: 20, max_delay: 1e-1, static: false}\n"
            "  odom: {max_future: 1}\n"
            "  camera:\n",
            encoding="utf-8",
        )
        assert expected_by(Namespace(expect=str(path))) == {
            "base": Expectation("odom", False, 20, 0.1),
            "odom": Expectation(max_future=1),
            "camera": Expectation(),
        }

    @pytest.mark.parametrize(
        ("text", "said"),
        [
            ("", "one key, frames"),
            ("frame: {}", "one key, frames"),
            ("frames: [base]", "the names of frames"),
            ("frames: {1: {}}", "1 is not a frame's name"),
            ("frames: {base: odom}", "base must be a mapping with parent and static and "),
            ("frames: {base: {rate: 3}}", "base: 'rate' is not a key; did you mean min_rate"),
            ("frames: {base: {min_rate: fast}}", "base: min_rate must be a number that .*, not 'fast'"),
            ("frames: {base: {min_rate: true}}", "base: min_rate must be a number"),
            ("frames: {base: {min_rate: .nan}}", "base: min_rate must be a number"),
            (
                "frames: {base: {min_rate: -5}}",
                "base: min_rate must be a number that .*, not -5",
            ),
            ("frames: {base: {static: 1}}", "base: static must be true or false"),
            ("frames: {base: {parent: 1}}", "base: parent must be a name"),
            ("frames: {", "while parsing"),
            (f"frames: {5000 * '['}", "is not YAML"),
        ],
    )
    def test_what_is_not_understood_is_told(self, text, said, tmp_path):
        path = tmp_path / "robot.yaml"
        path.write_text(text, encoding="utf-8")
        with pytest.raises(UsageError, match=said):
            expected_by(Namespace(expect=str(path)))

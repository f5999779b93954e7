# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tests of a feed from a robot that DDS and Zenoh share, and helpers for those of each."""

import sys

import pytest
from obeying_processes import OrderError
from waiting import DEADLINE_S

# Runs the program that follows, without the warning of Python 3.12 and newer about a fork beside threads.
FORKING_PYTHON = (sys.executable, "-W", "ignore:This process:DeprecationWarning", "-c")


def matched(robot, laptop, **options):
    """Make the publisher `out` of a robot, and wait until both sides know of each other."""
    given = "".join(f", {name}={value!r}" for name, value in options.items())
    robot.do(f"out = publisher('out'{given})")
    robot.until("matched(out)")
    laptop.until("'/out' in [one.node for one in robot.publishers()]")


def why(laptop):
    """The reason for which nothing was received, after a wait."""
    with pytest.raises(OrderError) as raised:
        laptop.do("robot.wait_until_heard(0.5)")
    return str(raised.value)


def check_exit(laptop, send):
    """Check that the feed ends if a callback exits; `send` sends the transform from base to map."""
    laptop.do("import sys; watch = robot.buffer.on_change('map', 'base', lambda _: sys.exit('enough'))")
    send()
    laptop.until("robot.why_ended()")
    assert laptop.do("robot.why_ended()").endswith(" has ended (receiving failed: SystemExit('enough'))")
    with pytest.raises(OrderError, match="receiving failed: SystemExit"):
        laptop.do(f"robot.buffer.lookup_transform('map', 'nowhere', 0, timeout={DEADLINE_S})")
    laptop.do("robot.close()")


class RobotFeed:
    """
    The tests of both, with the fixtures `new_robot`, `robot`, `new_laptop` and `laptop` of their module.

    `none_lost`: what a feed says if it has lost nothing. `publishes` and `latches`: what it says of
    publishers.
    """

    none_lost: int | None
    publishes: str
    latches: str

    def test_a_late_joiner_has_the_static_transforms_of_five_nodes_in_two_processes(
        self, new_robot, new_laptop
    ):
        first, second = new_robot(), new_robot()
        for name in ("a", "b", "c"):
            first.do(f"latched('{name}', ('base', '{name}', 1))")
        for name in ("d", "e"):
            second.do(f"latched('{name}', ('base', '{name}', 2))")
        laptop = new_laptop()
        matched(first, laptop)
        first.do("send(out, ('map', 'base', 3))")
        laptop.do(f"robot.wait_until_heard({DEADLINE_S})")
        laptop.until("all(robot.buffer.can_transform('map', name, 0) for name in 'abcde')")
        assert laptop.do("[seen(robot, 'base', name) for name in 'abcde']") == [1, 1, 1, 2, 2]
        assert laptop.do("heard(robot)") == [[1, self.none_lost, 0], [5, self.none_lost, 0]]
        laptop.until("all(one.node for one in robot.publishers())")
        assert sorted(laptop.do("[one[:3] for one in robot.publishers()]")) == [
            ["/tf", "/out", self.publishes],
            *(["/tf_static", f"/{name}", self.latches] for name in "abcde"),
        ]
        assert 0 <= laptop.do("robot.clock_offset") < DEADLINE_S

    def test_a_blocked_lookup_ends_when_its_transform_arrives_and_names_the_node(self, robot, laptop):
        matched(robot, laptop)
        laptop.begin(f"robot.buffer.lookup_transform('map', 'base', 0, timeout={DEADLINE_S}).child_frame_id")
        robot.do("send(out, ('map', 'base', 1))")
        assert laptop.finish() == "base"
        assert "broadcaster: '/out'" in laptop.do("robot.buffer.all_frames_as_yaml()")

    def test_other_topics_and_a_prefix(self, robot, new_laptop):
        laptop = new_laptop("topic='robot1/tf', static_topic='/robot1/tf_static/', prefix='robot1/'")
        robot.do("latched('mounts', ('base', 'camera', 2), topic='/robot1/tf_static')")
        matched(robot, laptop, topic="/robot1/tf")
        robot.do("send(out, ('map', 'base', 3))")
        laptop.do(f"robot.wait_until_heard({DEADLINE_S})")
        assert laptop.do("seen(robot, 'robot1/map', 'robot1/camera')") == 5
        assert laptop.do("[*robot.topics]") == ["/robot1/tf", "/robot1/tf_static"]

    def test_nothing_is_lost_while_a_call_holds_the_gil(self, robot, laptop):
        matched(robot, laptop)
        robot.do("sending = flood(out, 200, 50, 600)")
        laptop.until("robot.topics['/tf'].count > 0")
        laptop.do("hold_gil(2)")
        robot.until("not sending.is_alive()")
        laptop.until("robot.topics['/tf'].count >= 600")
        assert laptop.do("heard(robot)[0]") == [600, self.none_lost, 0]

    @pytest.mark.long("sends for a minute")
    def test_nothing_is_lost_of_ten_thousand_messages(self, robot, laptop):
        matched(robot, laptop)
        robot.do("sending = flood(out, 200, 50, 10_000)")
        laptop.begin(f"wait_for_each_hundredth(robot, 10_000, {DEADLINE_S})")
        robot.do(f"sending.join(4 * {DEADLINE_S})")
        laptop.finish()
        laptop.until("heard(robot)[0][0] + (heard(robot)[0][1] or 0) >= 10_000")
        received, lost, malformed = laptop.do("heard(robot)[0]")
        assert (lost is None, malformed) == (self.none_lost is None, 0)
        # The real rmw_zenoh drops some where a busy machine does not let it send; all are counted.
        assert received + (lost or 0) == 10_000
        assert received > 9_950
        assert laptop.do("seen(robot, 'map', 'f49')") == 9_999

    def test_a_robot_that_is_killed_and_started_again(self, new_robot, new_laptop):
        first = new_robot()
        first.do("latched('mounts', ('base', 'camera', 1))")
        laptop = new_laptop()
        laptop.until("robot.topics['/tf_static'].count")
        first.kill()
        second = new_robot()
        second.do("latched('mounts', ('base', 'camera', 2))")
        laptop.until("seen(robot, 'base', 'camera') == 2")
        assert laptop.do("heard(robot)[1]") == [2, self.none_lost, 0]

    def test_what_a_laptop_sends_arrives_also_at_a_late_listener(self, new_robot, laptop):
        first = new_robot()
        first.do("listen()")
        laptop.do("moving, fixed = robot.broadcaster(), robot.static_broadcaster()")
        laptop.do("fixed.sendTransform(made('base', 'camera', 1))")
        laptop.do("fixed.sendTransform([made('base', 'lidar', 2), made('base', 'imu', 3)])")
        # A publisher that does not latch sends to those who have found it.
        laptop.do("moving.sendTransform(made('map', 'first', 0))")
        while not first.do("('/tf', 'first') in heard"):
            laptop.do("moving.sendTransform(made('map', 'first', 0)); time.sleep(0.05)")
        # Those that were sent again arrive before this.
        laptop.do("moving.sendTransform(made('map', 'settled', 0))")
        first.until("('/tf', 'settled') in heard")
        before = first.do("messages['/tf']")
        each = "moving.sendTransform([made('map', f'f{n}', n), made('map', 'last', n)])"
        laptop.do(f"for n in range(500): {each}")
        first.until("heard.get(('/tf', 'last')) == 499")
        assert first.do("messages['/tf']") - before == 500
        late = new_robot()
        late.do("listen()")
        late.until("('/tf_static', 'imu') in heard")
        assert late.do("(sorted(heard.items()), messages['/tf_static'])") == [
            [[["/tf_static", "camera"], 1], [["/tf_static", "imu"], 3], [["/tf_static", "lidar"], 2]],
            1,
        ]
        # The program itself has them, as with a broadcaster and a listener of tf2, but has not heard them.
        assert laptop.do("(seen(robot, 'map', 'last'), seen(robot, 'base', 'imu'))") == [499, 3]
        assert laptop.do("[one.count for one in robot.topics.values()]") == [0, 0]
        assert laptop.do("[one[:3] for one in robot.publishers()]") == []

    def test_a_callback_that_exits_ends_the_feed(self, robot, laptop):
        matched(robot, laptop)
        check_exit(laptop, lambda: robot.do("send(out, ('map', 'base', 1))"))

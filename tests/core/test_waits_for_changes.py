"""Waits for another answer than the latest one: what the iterator and the callbacks of changes stand on."""

import random

import pytest
from making import at_ns, rotation, stamp_ns, transform, translation

pytestmark = pytest.mark.ours

LATEST = at_ns(0)


class Follower:
    """Waits for one change after the other; `seen` are the answers."""

    def __init__(self, buffer, target, source):
        self.buffer, self.names, self.seen, self.wait = buffer, (target, source), [], None
        self.go_on()

    def go_on(self):
        while True:
            self.wait = self.buffer._wait(*self.names, LATEST, notify=self.answered, after=self.wait)
            if self.wait.answer is None:
                return
            self.seen.append(self.wait.answer)

    def answered(self, answer):
        self.seen.append(answer)
        return self.go_on  # to be called outside the lock


@pytest.fixture
def buffer(tf2_py):
    return tf2_py.BufferCore()


def insert(buffer, parent, child, seconds, x=0.0, static=False):
    (buffer.set_transform_static if static else buffer.set_transform)(
        transform(parent, child, seconds, (x, 0, 0)), "x"
    )


def test_a_static_transform_below_an_earlier_parent_is_one(buffer):
    insert(buffer, "odom", "table", 0, 1.0, static=True)
    for second in (3, 6):
        insert(buffer, "table", "arm", second, 1.0)
    insert(buffer, "gripper", "arm", 10, 1.0)
    insert(buffer, "base", "gripper", 0, 1.0, static=True)
    for second in (4, 5):
        insert(buffer, "odom", "base", second, 1.0)
    follower = Follower(buffer, "odom", "arm")
    insert(buffer, "odom", "table", 0, 50.0, static=True)
    assert [translation(one)[0] for one in follower.seen] == [2.0, 51.0]


def test_what_does_not_touch_the_path_is_not_looked_at(buffer):
    insert(buffer, "map", "base", 1)
    follower = Follower(buffer, "map", "base")
    for tick in range(100):
        insert(buffer, "base", "arm", 2 + tick)
    assert len(follower.seen) == 1
    assert buffer._pending_waits() == [
        "waits for the transform from frame [base] to frame [map] at the latest common time: "
        "the answer is the one that it has"
    ]


def test_a_cancelled_wait_hands_on_what_it_was_to_differ_from(buffer):
    insert(buffer, "map", "base", 1)
    first = buffer._wait("map", "base", LATEST, notify=print)
    second = buffer._wait("map", "base", LATEST, notify=print, after=first)
    second.cancel()
    third = buffer._wait("map", "base", LATEST, notify=print, after=second)
    assert (second.answer, third.answer) == (None, None)


def test_random_inserts_are_followed(tf2_py):
    """Each answer differs from the one before, and the last one is the present one."""
    numbers = random.Random(2)
    links = [
        ("map", "odom"),
        ("odom", "base"),
        ("base", "arm"),
        ("map", "arm"),
        ("base", "mast"),
        ("odom", "mast"),
    ]
    followed = 0
    for _ in range(40):
        buffer = tf2_py.BufferCore(5.0)
        followers = [
            Follower(buffer, *numbers.sample(["map", "odom", "base", "arm", "mast"], 2)) for _ in range(6)
        ]
        for step in range(80):
            parent, child = numbers.choice(links)
            time = 10 + step // 4 + numbers.choice((0, 0.5, -0.3))
            insert(buffer, parent, child, time, numbers.randrange(3), static=child == "mast")
            if numbers.random() < 0.03:
                buffer.clear()
            buffer._self_check()
        for follower in followers:
            seen = [(stamp_ns(one), translation(one), rotation(one)) for one in follower.seen]
            assert all(one != other for one, other in zip(seen, seen[1:], strict=False))
            followed += len(seen)
            try:
                now = buffer.lookup_transform_core(*follower.names, LATEST)
            except tf2_py.TransformException:
                continue
            assert stamp_ns(now) == seen[-1][0]
    assert followed > 1000

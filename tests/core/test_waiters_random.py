# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
After whatever happens to a buffer, no waiter is pending whose lookup would answer.

`pytest --seed` searches from another seed.
"""

import copy
import itertools
from contextlib import suppress

import pytest
import random_runs
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from messages_with_or_without_ros import Duration
from times_and_transforms import at_ns, transform

from tf2_py import BufferCore, ExtrapolationException, LookupException
from tf2_py._internal import policy_of

pytestmark = pytest.mark.usefixtures("no_refusals_logged")

RUNS = random_runs.times(50, 300)
FRAMES = ("a", "b", "c", "d", "e")
MOST_PENDING = 8

frames = st.sampled_from(FRAMES)
names = st.sampled_from((*FRAMES, *FRAMES, "unknown"))
# A stamp, or a time that is asked for, in relation to what there is: see Machine.time.
times = st.tuples(
    st.sampled_from(("now", "now", "now", "frame", "oldest", "same", "zero")), st.integers(-3, 4)
)
policies = st.sampled_from(
    (
        {"tolerance": Duration(nanoseconds=2)},
        {"tolerance": Duration(nanoseconds=3), "extrapolate": True},
        {"max_gap": Duration(nanoseconds=2)},
    )
)


class Pending:
    """
    A waiter, and the answers that it was notified of, None for an error; `present`: the one that it already
    has.
    """

    def __init__(self, buffer, told, lookup, policy=None, after=None, until_refused=False):
        self.buffer, self.lookup, self.policy, self.until_refused = buffer, lookup, policy, until_refused
        self.answers = answers = []
        self.present = None if after is None else after.take()

        def notify(answer, error=None):  # it must not keep this alive
            answers.append(answer)
            told.append(answers)

        self.wait = buffer._wait(
            *lookup, policy=policy, after=after, notify=notify, until_refused=until_refused
        )

    def now(self, buffer=None):
        """What a lookup answers now, or None."""
        return (buffer or self.buffer)._wait(*self.lookup, policy=self.policy).take()

    def first_answer(self, buffer, links, static):
        """What is answered first while these are inserted one by one, or None."""
        for link in links:
            buffer.set_transforms([link], "random", static)
            now = self.now(buffer)
            if now not in (None, self.present):
                return now
        return None


class Machine(RuleBasedStateMachine):
    """Frames that mostly move on, and stay below one parent; some jump, turn static, close loops."""

    def __init__(self):
        super().__init__()
        self.begin(10)

    def begin(self, cache_ns):
        self.cache_ns = cache_ns
        self.buffer = BufferCore(Duration(nanoseconds=cache_ns))
        self.now, self.newest, self.last, self.parents = 10, {}, {}, {}
        self.pending, self.told, self.saved = [], [], None

    @initialize(
        cache_ns=st.sampled_from((5, 10, 20)),
        loops=st.sampled_from((False, False, True)),
        homes=st.lists(frames, min_size=5, max_size=5),
        restless=st.sampled_from((FRAMES[-1:], FRAMES[2:3], FRAMES[3:4], FRAMES)),
        statics=st.booleans(),
    )
    def start(self, cache_ns, loops, homes, restless, statics):
        self.begin(cache_ns)
        # Where all frames change their parents, each insert changes the tree, and hides what is missed.
        self.restless, self.statics, self.loops = restless, statics, loops
        for child, parent in zip(FRAMES, homes, strict=True):
            self.parents[child] = self.below(child, parent)
            if not loops:
                self.put([self.link(child, parent, ("now", 0))])

    def below(self, child, other):
        """A parent: without loops, one that comes before the child."""
        if self.loops:
            return other
        index = FRAMES.index(child)
        return FRAMES[FRAMES.index(other) % index] if index else "root"

    def link(self, child, other, time, x=0):
        parent = self.below(child, other) if child in self.restless else self.parents[child]
        return transform(parent, child, ns=self.time(child, *time), xyz=(x, 0, 0))

    def time(self, frame, relation, offset):
        newest = self.newest.get(frame, self.now)
        base = {
            "now": self.now,
            "frame": newest,
            "oldest": newest - self.cache_ns,
            "same": self.last.get(frame, newest) - offset,
            "zero": -offset,
        }[relation]
        return max(0, base + offset)

    # What happens to the buffer. Those without `rule` take plain arguments.

    def insert(self, parent, child, ns, x=0, static=False):
        self.put([transform(parent, child, ns=ns, xyz=(x, 0, 0))], static)

    def put(self, links, static=False):
        for link in links:
            child, ns = link.child_frame_id, link.header.stamp.nanosec
            self.last[child] = ns
            self.newest[child] = max(ns, self.newest.get(child, 0))
            self.now = max(ns, self.now)
        first = [
            one.first_answer(copy.copy(self.buffer), links, static) if len(links) > 1 else None
            for one in self.pending
        ]
        self.buffer.set_transforms(links, "random", static)
        answered = [one for one in self.pending if one.answers]
        # In the order in which they began to wait.
        assert [id(answers) for answers in self.told] == [id(one.answers) for one in answered]
        if len(links) == 1:
            assert all(one.answers[0] == one.now() for one in answered)
        for one, answer in zip(self.pending, first if len(links) > 1 else (), strict=False):
            is_refused = one.until_refused and one.answers == [None]
            assert (one.answers or [None])[0] == answer or is_refused, (one.lookup, answer)
        assert all(one.answers[0] != one.present for one in answered if one.present is not None)
        self.settle()

    def rewrite(self, links, static=False):
        """All waits are judged once, after the whole call."""
        known = self.newest.copy()
        self.buffer.set_transforms(links, "random", static, replace=True)
        for name, info in self.buffer.frames().items():
            if info.newest_ns is not None:
                self.newest[name] = max(info.newest_ns, known.get(name, 0))
                self.now = max(self.now, info.newest_ns)
        answered = [one for one in self.pending if one.answers]
        assert [id(answers) for answers in self.told] == [id(one.answers) for one in answered]
        for one in answered:
            assert one.answers[0] == one.now() and one.answers[0] != (one.present or 0), one.lookup
        self.settle()

    def settle(self):
        assert all(len(one.answers) <= 1 for one in self.pending)
        answered = [one for one in self.pending if one.answers]
        self.pending = [one for one in self.pending if not one.answers]
        self.told.clear()
        for one in answered:
            if one.present is not None:  # as whoever follows changes does
                self.ask(one.lookup, after=one.wait)

    @rule(child=frames, other=frames, time=times, x=st.integers(0, 2), static=st.integers(0, 9))
    def move(self, child, other, time, x, static):
        self.put([self.link(child, other, time, x)], self.statics and static == 9)

    @rule(child=frames, other=frames, ahead=st.integers(1, 3))
    def move_on(self, child, other, ahead):
        self.put([self.link(child, other, ("frame", ahead))])

    @rule(links=st.lists(st.tuples(frames, frames, times), min_size=2, max_size=4), static=st.integers(0, 9))
    def move_several(self, links, static):
        self.put([self.link(*link) for link in links], self.statics and static == 9)

    @rule(links=st.lists(st.tuples(frames, frames, times), min_size=1, max_size=5), static=st.integers(0, 9))
    def replace(self, links, static):
        self.rewrite([self.link(*link) for link in links], self.statics and static == 9)

    @rule(child=frames, others=st.lists(frames, min_size=1, max_size=4), x=st.integers(1, 2))
    def replace_the_newest(self, child, others, x):
        self.rewrite([self.link(child, other, ("frame", -i), x) for i, other in enumerate(others)])

    @rule(child=frames, other=frames, steps=st.lists(st.integers(0, 25), min_size=2, max_size=5))
    def move_far(self, child, other, steps):
        # One call spans more than the cache time: later inserts prune what earlier ones have answered.
        self.put([self.link(child, other, ("frame", ahead)) for ahead in itertools.accumulate(steps)])

    @rule(
        other=frames,
        parents=st.lists(frames, min_size=2, max_size=3),
        offsets=st.lists(st.integers(-20, 20), min_size=1, max_size=3),
    )
    def tie(self, other, parents, offsets):
        # Of several samples of one stamp, it depends on their neighbors which parent answers.
        child, ns = self.restless[-1], self.now + 1
        parents = [self.below(child, parent) for parent in parents]
        for parent in parents:
            self.insert(parent, child, ns)
        self.put([self.link(other, "a", ("now", 0))])
        self.ask((parents[-1], child, at_ns(0)))
        self.ask((other, child, at_ns(0)))
        for offset in offsets:
            self.insert(parents[0], child, max(0, ns + offset))
            self.nobody_waits_for_what_is_there()

    @rule(child=frames, other=frames, offset=st.integers(0, 2))
    def prune(self, child, other, offset):
        # A frame is silent for longer than the cache time, and then a message from before that comes late.
        late = self.link(child, other, ("frame", offset))
        self.put([self.link(child, other, ("frame", self.cache_ns + 3))])
        self.put([late])

    @precondition(lambda self: len(self.newest) > 3)
    @rule()
    def clear(self):
        self.buffer.clear()
        self.newest.clear()
        self.settle()

    @precondition(lambda self: len(self.newest) > 3)
    @rule(child=frames)
    def forget(self, child):
        with suppress(LookupException):
            self.buffer.forget(child)
        self.settle()  # less data may end a loop

    @rule()
    def save(self):
        self.saved = self.buffer.__getstate__(), dict(self.newest)

    @precondition(lambda self: self.saved is not None)
    @rule()
    def restore(self):
        state, self.newest = self.saved[0], dict(self.saved[1])
        self.buffer.__setstate__(state)
        self.settle()

    # Waiters.

    def ask(self, lookup, **options):
        one = Pending(self.buffer, self.told, lookup, **options)
        assert not self.told  # but has the answer at once
        try:
            if one.wait.take() is None:
                self.pending.append(one)
        except ExtrapolationException:
            assert one.until_refused and one.now() is None
        if len(self.pending) > MOST_PENDING:
            assert self.pending.pop(0).wait.cancel()

    @rule(child=frames, time=times, latest=st.booleans(), refused=st.booleans())
    def wait_for_link(self, child, time, latest, refused):
        time = at_ns(0 if latest else self.time(child, *time))
        self.ask((self.parents[child], child, time), until_refused=refused)

    @rule(ends=st.tuples(names, names), time=times, latest=st.booleans(), refused=st.booleans())
    def wait(self, ends, time, latest, refused):
        self.ask((*ends, at_ns(0 if latest else self.time(ends[1], *time))), until_refused=refused)

    @rule(ends=st.tuples(names, names, names), at=times, target_at=times, latest=st.integers(0, 3))
    def wait_full(self, ends, at, target_at, latest):
        target, source, fixed = ends
        at, target_at = self.time(source, *at), self.time(target, *target_at)
        self.ask((target, source, at_ns(at * (latest & 1)), fixed, at_ns(target_at * (latest >> 1))))

    @rule(ends=st.tuples(names, names), time=times, latest=st.booleans(), policy=policies)
    def wait_under(self, ends, time, latest, policy):
        time = 0 if latest else self.time(ends[1], *time)
        self.ask((*ends, at_ns(time)), policy=policy_of("wait", True, **policy))

    @rule(child=frames, ahead=st.integers(1, 4), policy=st.none() | policies)
    def wait_for_next(self, child, ahead, policy):
        lookup = self.parents[child], child, at_ns(self.time(child, "frame", ahead))
        self.ask(lookup, policy=policy and policy_of("wait", True, **policy))

    @rule(ends=st.tuples(frames, frames))
    def wait_for_another(self, ends):
        lookup = (*ends, at_ns(0))
        present = self.buffer._wait(*lookup)
        if present.take() is not None:
            self.ask(lookup, after=present)

    @precondition(lambda self: self.pending)
    @rule(index=st.integers(0, MOST_PENDING), drop=st.booleans())
    def end(self, index, drop):
        one = self.pending.pop(index % len(self.pending))
        if not drop:
            assert one.wait.cancel()
            assert not one.wait.cancel()
            assert one.wait.take() is None

    @invariant()
    def nobody_waits_for_what_is_there(self):
        assert not self.told
        for one in self.pending:
            assert not one.answers
            assert one.now() in (None, one.present), one.lookup
        assert self.buffer.statistics()["waiters"] == len(self.pending)
        self.buffer._self_check()


Machine.TestCase.settings = settings(max_examples=RUNS, stateful_step_count=60)
TestMachine = pytest.mark.repeated(Machine.TestCase)


# Where a waiter was once forgotten, or a rule of its own wakes it: the cache time, and what happens until
# nobody waits. "m>o 50": a sample of o in m at 50 ns. "?m>o 30": a wait; time 0 is the latest.
# "?m>o 30 f 0": a wait for o at 30 ns seen from m at the latest time, fixed in f.
SCRIPTS = {
    "a late sample answers for earlier data": "100: m>o 50, m>o 60, ?m>o 30, m>o 40, m>o 20",
    "a late sample with another parent answers for times behind it": (
        "100: m>o static, n>b 10, p>b 20, ?m>b 15, o>b 16, o>b 12"
    ),
    "of the newest stamp the last sample answers, of the oldest the first": (
        "100: m>b 10, o>b 10, ?m>b 10, o>b 20"
    ),
    "two histories grow towards each other": "100: m>o 10, o>b 20, ?m>b 0, o>b 12, m>o 13",
    "a first stamp that is not 0 makes the latest common time earlier": (
        "100: m>o 1, n>o 5, m>o 9, o>b 0, b>c 1, b>c 5, ?m>c 0, o>b 1"
    ),
    "a frame becomes static": "100: m>o 5, ?m>o 7, m>o static",
    "the latest common time passes the change of a parent": (
        "10: a>c 101, c>d 102, ?b>d 0, b>c 116, c>d 118"
    ),
    "a refused sample prunes the last one of another parent": "10: b>e 18, ?a>e 36, a>e 31, a>e 19, a>e 44",
    "the sample before several of one stamp is pruned": (
        "5: b>d 27, b>c 29, b>d 29, a>d 29, b>d 33, ?c>d 0, b>d 36"
    ),
    "a frame with data at 0 s only becomes static": "10: b>e 0, ?b>e 0 a 0, e>a 14, b>e static",
    "at another common time a frame has another parent": (
        "40: m>o static, n>b 10, o>b 10, o>b 30, b>c 10, ?m>c 0, b>c 11"
    ),
}


@pytest.mark.parametrize("script", SCRIPTS)
def test_waiters_are_answered(script):
    cache_ns, _, steps = SCRIPTS[script].partition(": ")
    machine = Machine()
    machine.begin(int(cache_ns))
    for step in steps.split(", "):
        names, time, *fixed = step.removeprefix("?").split()
        parent, child = names.split(">")
        if step.startswith("?"):
            machine.ask((parent, child, at_ns(int(time)), *fixed[:1], *[at_ns(int(ns)) for ns in fixed[1:]]))
        elif time == "static":
            machine.insert(parent, child, 0, 3, static=True)
        else:
            machine.insert(parent, child, int(time))
        machine.nobody_waits_for_what_is_there()
    assert not machine.pending

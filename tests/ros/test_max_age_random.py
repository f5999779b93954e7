# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What random trees, clocks and waits answer under a `max_age`, against the model."""

import random

import pytest
import random_runs
from buffer_beside_model import as_model_tells, of_buffer, of_model, same_answer, same_kind
from geometry_msgs.msg import PointStamped
from model import Model
from model_terms import Policy
from questions_beside_model import arguments_of, begun
from rclpy.duration import Duration
from simulated_clock import simulate
from times_and_transforms import S, transform

from tf2_py import BufferCore
from tf2_ros import MessageFilter
from tf2_ros._wait import futures

RUNS = random_runs.times(120, 10_000)
STEPS = 40
CACHE_NS = 30
FRAMES = ("map", "odom", "base", "arm", "lidar", "hand")  # each is below one that comes before it
NOT_BEGUN = 0
MOST_PENDING = 6


class Question:
    """A lookup of the latest transform, simple or at two times, under limits."""

    def __init__(self, dice):
        self.target, self.source, self.fixed = dice.choices(FRAMES, k=3)
        self.is_full = dice.random() < 0.2
        if dice.random() < 0.4:
            self.limits = dice.randrange(12)
        else:
            names = dice.sample(FRAMES, dice.randrange(4))
            if dice.random() < 0.1:
                names.append("odm")
            self.limits = tuple((name, dice.randrange(12)) for name in names)

    @property
    def policy(self):
        return arguments_of(Policy(max_age=self.limits))

    @property
    def arguments(self):
        if self.is_full:
            return (self.target, 0, self.source, 0, self.fixed)
        return (self.target, self.source, 0)

    def outcome(self, model, limits=None):
        """("answer", it) or ("error", kind, texts) of the model."""
        policy = Policy(max_age=self.limits if limits is None else limits)
        look_up = model.lookup_full_under if self.is_full else model.lookup_under
        return of_model(look_up, policy, *self.arguments)

    def is_over(self, model):
        """
        Whether a wait for it ends: with an answer, because that is there and a limit is void, or because a
        frame on the path is limited although it is static.
        """
        outcome = self.outcome(model)
        if outcome[1] != "ValueError":
            return outcome[0] == "answer"
        if "is static" in outcome[2][0]:
            return True
        valid = tuple(pair for pair in self.limits if pair[0] in model.frames)
        return self.outcome(model, valid)[0] == "answer"

    def __repr__(self):
        between = f"{self.source} in {self.target}" + (f" by way of {self.fixed}" if self.is_full else "")
        return f"<{between}, limits {self.limits}>"


class Filtered:
    """A message of a filter, with the methods of the future of its transform."""

    def __init__(self, run, question):
        self.dropped = []  # the text, once it was
        self.filter = MessageFilter(
            None, run.buffer, question.target, 0, node=run.node, policy=question.policy
        )
        self.filter.registerFailureCallback(lambda *given: self.dropped.append(given[2]), with_text=True)
        self.passed = self.filter.__aiter__()
        message = PointStamped()
        message.header.frame_id = question.source
        self.filter.add(message)

    def done(self):
        return self.filter.statistics()["waiting"] == 0

    def result(self):
        if self.dropped:
            raise ValueError(*self.dropped)
        return begun(anext(self.passed))[1][1]

    def cancel(self):
        self.filter.close()


class Followed:
    """A subscription to the changes of a lookup, and what it was called with since that was looked at."""

    def __init__(self, run, question):
        self.question, self.seen, self.has_ended = question, [], False
        self.last = None  # of the model
        names = question.target, question.source
        self.subscription = run.buffer.on_change(*names, self.seen.append, **limits_of(question))

    def settle(self, model):
        """Whether it goes on, after what wakes waits: it was called with what is new, if that is fresh."""
        question, outcome = self.question, self.question.outcome(model)
        is_new = outcome[0] == "answer" and outcome != self.last
        if is_new and self.last and same_answer(outcome[1], self.last[1]):
            is_new = bool(self.seen)  # rounding decides
        assert len(self.seen) == is_new, (question, self.seen, outcome, self.last)
        if is_new:
            self.last = outcome
            assert same_answer(as_model_tells(self.seen.pop()), outcome[1]), question
        return outcome[1] != "ValueError" or not question.is_over(model)


def limits_of(question):
    return {"max_age": question.policy["max_age"]}


class Run:
    """One random run; `node` and `buffer` are used by all of them."""

    def __init__(self, node, buffer, seed):
        self.node, self.buffer, self.dice = node, buffer, random.Random(seed)
        # A buffer that is initialized again is empty.
        BufferCore.__init__(buffer, Duration(nanoseconds=CACHE_NS))
        self.model = Model(CACHE_NS)
        self.pending, self.followed = [], []
        dice = self.dice
        self.homes = {child: dice.choice(FRAMES[:i]) for i, child in enumerate(FRAMES) if i}
        self.restless = dice.sample(FRAMES[1:], dice.choice((0, 0, 1, 2)))
        self.statics = dice.sample(FRAMES[1:], dice.choice((0, 1, 2)))
        self.begin_ns = dice.choice((10 * S, 10 * S, 40))
        self.set_clock(dice.choice((self.begin_ns, self.begin_ns, self.begin_ns, NOT_BEGUN)))

    @property
    def now_ns(self):
        return self.model.now_ns

    def set_clock(self, ns):
        self.model.now_ns = ns
        simulate(self.node, ns=ns)

    # Steps.

    def insert(self):
        dice = self.dice
        child = dice.choice(FRAMES[1:])
        parent = self.homes[child]
        if child in self.restless and dice.random() < 0.3:
            parent = dice.choice(FRAMES[: FRAMES.index(child)])
        ns = max((self.now_ns or self.begin_ns) + dice.choice((0, 0, 0, -1, -2, -4, -8, -20, 1)), 0)
        static = child in self.statics and dice.random() < 0.9
        xyz = (dice.randrange(3), 0, 0)
        self.buffer.set_transforms([transform(parent, child, ns=ns, xyz=xyz)], "x", static)
        self.model.insert(parent, child, ns, xyz, (0, 0, 0, 1), "x", static)
        self.settle()

    def go_on(self):
        begins = not self.now_ns
        self.set_clock((self.now_ns or self.begin_ns) + self.dice.choice((0, 1, 1, 2, 3, 6, 12, 25)))
        for future, question in self.pending:
            assert not future.done(), question
        assert not any(one.seen for one in self.followed)
        if begins:
            self.insert()  # the next insert tries what waits since before the clock began

    def step_back(self):
        if self.now_ns:
            back = self.dice.choice((1, 2, 5))
            self.set_clock(max(self.now_ns - back, 1))
            self.settle()

    def jump_back(self):
        if self.now_ns > 2 * S:
            self.set_clock(self.now_ns - S - self.dice.randrange(3))
            self.model.clear()
            self.settle()

    def empty(self):
        if self.dice.random() < 0.5:
            self.buffer.clear()
            self.model.clear()
        else:
            frame = self.dice.choice(FRAMES)
            if self.model.exists(frame):
                self.buffer.forget(frame)
                self.model.forget(frame)
        self.settle()

    def ask(self):
        question = Question(self.dice)
        way = self.buffer.lookup_transform_full if question.is_full else self.buffer.lookup_transform
        got = of_buffer(way, *question.arguments, **question.policy)
        self.compare(question, got)
        if not question.is_full:
            names = question.target, question.source
            assert of_buffer(self.buffer.ages, *names)[:2] == of_model(self.model.ages, *names)[:2], names
            if got[1] != "ValueError":
                can = self.buffer.can_transform(*question.arguments, **question.policy)
                assert can == (got[0] == "answer"), question

    def compare(self, question, got):
        wanted = question.outcome(self.model)
        if got[0] == "error":
            assert same_kind(got, wanted), (question, got, wanted)
        else:
            assert same_answer(as_model_tells(got[1]), wanted[1]), (question, got, wanted)

    def filter(self):
        question = Question(self.dice)
        if question.is_full:
            return
        message = Filtered(self, question)
        if question.outcome(self.model)[1] == "ValueError":
            self.compare(question, of_buffer(message.result))
        else:
            self.add(message, question)

    def follow(self):
        question = Question(self.dice)
        if question.is_full:
            return
        made = of_buffer(Followed, self, question)
        if question.outcome(self.model)[1] == "ValueError":
            assert made[:2] == ("error", "ValueError"), question
        else:
            self.followed.append(made[1])
            self.settle()

    def wait(self):
        question = Question(self.dice)
        begin = self.buffer.wait_for_transform_async
        if question.is_full:
            begin = self.buffer.wait_for_transform_full_async
        kind = question.outcome(self.model)[1]
        try:
            future = begin(*question.arguments, **question.policy)
        except ValueError:
            assert kind == "ValueError", question
            return
        assert kind != "ValueError", question
        self.add(future, question)

    def add(self, future, question):
        self.pending.append((future, question))
        self.settle()
        if len(self.pending) > MOST_PENDING:
            self.pending.pop(0)[0].cancel()

    def settle(self):
        """After what wakes waits: those that have an answer now are done, and no others."""
        pending, self.pending = self.pending, []
        for future, question in pending:
            assert future.done() == question.is_over(self.model), (question, question.outcome(self.model))
            if future.done():
                self.compare(question, of_buffer(future.result))
            else:
                self.pending.append((future, question))
        self.followed = [one for one in self.followed[-MOST_PENDING:] if one.settle(self.model)]
        assert self.buffer.statistics()["waiters"] == len(self.pending) + len(self.followed)

    def run(self):
        steps = (
            [self.insert] * 12
            + [self.go_on] * 4
            + [self.ask] * 3
            + [self.wait] * 3
            + [self.filter, self.follow]
        )
        steps += [self.step_back, self.jump_back, self.empty]
        for _ in range(STEPS):
            self.dice.choice(steps)()
        for future, _ in self.pending:
            future.cancel()
        for one in self.followed:
            one.subscription.cancel()
        self.buffer._self_check()


@pytest.fixture(scope="module")
def quiet():
    """No log lines of refused transforms, of jumps, and of subscriptions that an error ends."""
    from rclpy.logging import LoggingSeverity, set_logger_level

    names = "tf2_py", "tf2_buffer", "tf2_ros"
    for name in names:
        set_logger_level(name, LoggingSeverity.FATAL)
    yield
    for name in names:
        set_logger_level(name, LoggingSeverity.UNSET)


@pytest.mark.repeated
@pytest.mark.timeout(7200)
def test_random_trees_clocks_and_waits_answer_as_the_model_says(tf2_ros, node, quiet, monkeypatch):
    # In another thread, either check may end waits between a jump of the clock and what clears the buffer.
    monkeypatch.setattr(futures, "CLOCK_CHECK_NS", futures.NEVER_NS)

    class Unchecked(tf2_ros.Buffer):
        def _tf2_check(self):
            pass

    buffer = Unchecked(node=node)
    first = random_runs.first_seed()
    for seed in range(first, first + RUNS):
        try:
            Run(node, buffer, seed).run()
        except AssertionError as error:
            raise AssertionError(f"--seed {seed}") from error

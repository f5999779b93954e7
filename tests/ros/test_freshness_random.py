"""
What random trees, clocks and waits answer under a `max_age`, against a model in plain Python.

The environment variable FRESHNESS_RUNS sets how many runs there are. A failure names its seed, and
FRESHNESS_SEED repeats that run alone.
"""

import os
import random

import pytest
import repetitions
from clocks import simulate
from making import S, at_ns, stamp_ns, transform, translation
from model import NEWEST, Model, ModelError
from rclpy.duration import Duration

from tf2_py import BufferCore, TransformException

pytestmark = pytest.mark.ours

RUNS = int(os.environ.get("FRESHNESS_RUNS", repetitions.times(400, 10_000)))
STEPS = 40
CACHE_NS = 30
FRAMES = ("map", "odom", "base", "arm", "lidar", "hand")  # each is below one that comes before it
LATEST = at_ns(0)
NOT_BEGUN = 0
MOST_PENDING = 6


class Question:
    """A lookup of the latest transform, simple or at two times, under limits."""

    def __init__(self, dice):
        self.target, self.source, self.fixed = dice.choices(FRAMES, k=3)
        self.is_full = dice.random() < 0.2
        if dice.random() < 0.4:
            limits = dice.randrange(12)
        else:
            limits = {name: dice.randrange(12) for name in dice.sample(FRAMES, dice.randrange(4))}
            if dice.random() < 0.1:
                limits["odm"] = 3
        self.limits = limits

    @property
    def policy(self):
        limits = self.limits
        if isinstance(limits, dict):
            return {"max_age": {name: Duration(nanoseconds=ns) for name, ns in limits.items()}}
        return {"max_age": Duration(nanoseconds=limits)}

    def limit_ns(self, frame):
        return self.limits.get(frame) if isinstance(self.limits, dict) else self.limits

    def names_unknown(self, model):
        return isinstance(self.limits, dict) and not all(map(model.exists, self.limits))

    @property
    def arguments(self):
        if self.is_full:
            return (self.target, LATEST, self.source, LATEST, self.fixed)
        return (self.target, self.source, LATEST)

    def __repr__(self):
        between = f"{self.source} in {self.target}" + (f" by way of {self.fixed}" if self.is_full else "")
        return f"<{between}, limits {self.limits}>"


class Answers:
    """What the model says."""

    def __init__(self, model):
        self.model, self.now_ns = model, NOT_BEGUN

    def newest_path(self, target, source):
        """The frames whose newest samples connect two frames; None: they do not."""
        above = [self.upwards(frame) for frame in (source, target)]
        common = [frame for frame in above[0] if frame in above[1]]
        return (
            None
            if not common
            else [
                *above[0][: above[0].index(common[0])],
                *reversed(above[1][: above[1].index(common[0])]),
            ]
        )

    def upwards(self, frame):
        chain = []
        while frame is not None:
            chain.append(frame)
            one = self.model.frames.get(frame)
            frame = None if one is None else one.newest_parent()
        return chain

    def ages(self, frames):
        """By name, of those that move; in nanoseconds."""
        newest = {frame: self.model.frames[frame].newest_ns() for frame in frames}
        never = float("inf")
        return {
            frame: self.now_ns - ns if self.now_ns > NOT_BEGUN else never
            for frame, ns in newest.items()
            if ns
        }

    def stalest(self, frames, question):
        """The frames that are furthest beyond their limits."""
        limits = {frame: question.limit_ns(frame) for frame in frames}
        ages = self.ages(frame for frame in frames if limits[frame] is not None)
        beyond = {frame: age - limits[frame] for frame, age in ages.items() if age > limits[frame]}
        most = max(beyond.values(), default=0)
        return {frame for frame, excess in beyond.items() if excess == most}

    def half(self, target, source, question):
        """The kind of the outcome; the frames that it may name, or the answer."""
        try:
            found = self.model.lookup(target, source, 0)
        except ModelError as error:
            if error.kind != "ExtrapolationException":
                return error.kind, None
            stale = self.stalest(self.newest_path(target, source), question)
            return ("stale", stale) if stale else (error.kind, None)
        if target == source:
            return "ok", found
        stamp_ns = self.model.latest(target, source)
        _, chain, top = self.model._walk(target, source, stamp_ns or NEWEST)
        stale = self.stalest(chain[:top] + chain[top + 1 :], question)
        return ("stale", stale) if stale else ("ok", found)

    def outcome(self, question):
        target, source, fixed = question.target, question.source, question.fixed
        if not question.is_full:
            kind, what = self.half(target, source, question)
        else:
            try:
                self.model._check_names("", target_frame=target, source_frame=source, fixed_frame=fixed)
            except ModelError as error:
                return error.kind, None
            first, second = self.half(fixed, source, question), self.half(target, fixed, question)
            kind, what = first if first[0] != "ok" else second
            if kind == "ok":
                what = self.model.lookup_full(target, 0, source, 0, fixed)
        if kind in ("ok", "stale", "ExtrapolationException") and question.names_unknown(self.model):
            return "ValueError", kind
        return kind, what


class Run:
    """One random run; `node` and `buffer` are used by all of them."""

    def __init__(self, node, buffer, seed):
        self.node, self.buffer, self.dice = node, buffer, random.Random(seed)
        # A buffer that is initialised again is empty.
        BufferCore.__init__(buffer, Duration(nanoseconds=CACHE_NS))
        self.model = Model(CACHE_NS)
        self.answers = Answers(self.model)
        self.pending = []
        dice = self.dice
        self.homes = {child: dice.choice(FRAMES[:i]) for i, child in enumerate(FRAMES) if i}
        self.restless = dice.sample(FRAMES[1:], dice.choice((0, 0, 1, 2)))
        self.statics = dice.sample(FRAMES[1:], dice.choice((0, 1, 2)))
        self.begin_ns = dice.choice((10 * S, 10 * S, 40))
        self.set_clock(dice.choice((self.begin_ns, self.begin_ns, self.begin_ns, NOT_BEGUN)))

    @property
    def now_ns(self):
        return self.answers.now_ns

    def set_clock(self, ns):
        self.answers.now_ns = ns
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
        self.set_clock((self.now_ns or self.begin_ns) + self.dice.choice((0, 1, 1, 2, 3, 6, 12, 25)))
        for future, question in self.pending:
            assert not future.done(), question

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
        self.compare(question, lambda: way(*question.arguments, **question.policy))
        if not question.is_full:
            self.compare_ages(question)
            can = self.buffer.can_transform
            if not question.names_unknown(self.model):
                expected = self.answers.outcome(question)[0] == "ok"
                assert can(*question.arguments, **question.policy) == expected

    def compare_ages(self, question):
        target, source = question.target, question.source
        if self.model.exists(target) and self.model.exists(source):
            path = self.answers.newest_path(target, source)
            if path is not None:
                wanted = {name: age / 1e9 for name, age in self.answers.ages(path).items()}
                assert self.buffer.ages(target, source) == wanted
                return
        with pytest.raises(TransformException):
            self.buffer.ages(target, source)

    def compare(self, question, call):
        kind, what = self.answers.outcome(question)
        try:
            found = call()
        except (TransformException, ValueError) as error:
            text = str(error)
            is_stale = "is too old; the newest sample of " in text
            assert ("stale" if is_stale else type(error).__name__) == kind, (question, text)
            if is_stale:
                assert text.partition("newest sample of ")[2].split(" ")[0] in what, (question, text)
            return
        assert kind == "ok", (question, kind, what)
        self.compare_answer(found, what)

    def compare_answer(self, found, what):
        assert (stamp_ns(found), found.header.frame_id, found.child_frame_id) == what[:3]
        assert translation(found) == pytest.approx(what[3])

    def wait(self):
        question = Question(self.dice)
        begin = self.buffer.wait_for_transform_async
        if question.is_full:
            begin = self.buffer.wait_for_transform_full_async
        kind, what = self.answers.outcome(question)
        try:
            future = begin(*question.arguments, **question.policy)
        except ValueError:
            assert kind == "ValueError", question
            return
        assert kind != "ValueError", question
        assert future.done() == (kind == "ok"), (question, kind)
        if kind == "ok":
            self.compare_answer(future.result(), what)
        else:
            self.pending.append((future, question))
        if len(self.pending) > MOST_PENDING:
            self.pending.pop(0)[0].cancel()

    def settle(self):
        """After what wakes waits: those that have an answer now are done, and no others."""
        pending, self.pending = self.pending, []
        for future, question in pending:
            kind, what = self.answers.outcome(question)
            ends = kind == "ok" or (kind, what) == ("ValueError", "ok")
            assert future.done() == ends, (question, kind, what)
            if not ends:
                self.pending.append((future, question))
            elif kind == "ValueError":
                assert isinstance(future.exception(), ValueError)
            else:
                self.compare_answer(future.result(), what)
        assert self.buffer.statistics()["waiters"] == len(self.pending)

    def run(self):
        steps = [self.insert] * 12 + [self.go_on] * 4 + [self.ask] * 3 + [self.wait] * 3
        steps += [self.step_back, self.jump_back, self.empty]
        for _ in range(STEPS):
            self.dice.choice(steps)()
        for future, _ in self.pending:
            future.cancel()
        self.buffer._self_check()


@pytest.fixture(scope="module")
def quiet():
    """No log lines of refused transforms and of jumps."""
    from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level

    names = "tf2_py", "tf2_buffer"
    levels = [get_logger_level(name) for name in names]
    for name in names:
        set_logger_level(name, LoggingSeverity.FATAL)
    yield
    for name, level in zip(names, levels, strict=True):
        set_logger_level(name, level)


@pytest.mark.repeated
@pytest.mark.timeout(7200)
def test_random_trees_clocks_and_waits_answer_as_the_model_says(tf2_ros, node, quiet):
    buffer = tf2_ros.Buffer(node=node)
    seeds = range(repetitions.first_seed(), repetitions.first_seed() + RUNS)
    if "FRESHNESS_SEED" in os.environ:
        seeds = (int(os.environ["FRESHNESS_SEED"]),)
    for seed in seeds:
        try:
            Run(node, buffer, seed).run()
        except AssertionError as error:
            raise AssertionError(f"FRESHNESS_SEED={seed}") from error

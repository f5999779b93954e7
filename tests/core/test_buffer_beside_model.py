# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The buffer and a slow model of tf2, side by side; and the model beside the recordings of the real tf2."""

import inspect
import itertools
import random
import re

import pytest
import random_runs
from buffer_beside_model import (
    AUTHORITIES,
    FRAMES,
    GOOD_PLACES,
    GOOD_TURNS,
    ODD_NAMES,
    PLACES,
    TURNS,
    WAYS,
    Pair,
)
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from model import Model
from model_terms import STAMPS_END, ModelError, S
from pickles_and_copies import WAYS as WAYS_TO_TRAVEL
from questions_beside_model import CHANGES, QUESTIONS, ask, compare_ranges
from recorded_answers import SCENARIOS, check_answer, number

from tf2_py.typing import LookupPolicy
from tf2_ros import Buffer

pytestmark = pytest.mark.usefixtures("no_refusals_logged")


def insert(model, static, authority, parent, child, sec, nanosec, xyz, xyzw):
    xyz, xyzw = (tuple(float(number(a)) for a in vector) for vector in (xyz, xyzw))
    model.insert(parent, child, sec * S + nanosec, xyz, xyzw, authority, static)


def as_recorded(answer):
    stamp, target, source, xyz, xyzw = answer
    return [*divmod(stamp, S), target, source, list(xyz), list(xyzw)]


# What the operations of the recordings are of a model.
CALLS = {
    "set": insert,
    "lookup": lambda model, *args: as_recorded(model.lookup(*args)),
    "lookup_full": lambda model, *args: as_recorded(model.lookup_full(*args)),
    "can": lambda model, *args: list(model.can(*args)),
    "can_full": lambda model, *args: list(model.can_full(*args)),
    "latest": Model.latest,
    "dot": lambda model, _: "".join(f'"{parent}" -> "{child}"' for parent, child in model.edges()),
    "frames": lambda model: sorted(model.names),
    "exists": Model.exists,
    "yaml": lambda model: repr(model.yaml()),
    "string": Model.string,
    "clear": Model.clear,
}


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario["name"])
def test_the_model_answers_as_tf2_did(scenario):
    model = Model(scenario["cache_ns"])
    for (op, *args), want in zip(scenario["ops"], scenario["want"], strict=True):
        check_answer(CALLS, model, op, args, want, ModelError)


def with_six_decimals(text):
    return re.sub(r"\d+\.\d{9}", lambda found: f"{float(found[0]):.6f}", text)


def test_the_model_knows_which_time_tf2_quotes_in_an_extrapolation_error():
    compared = 0
    for scenario in SCENARIOS:
        model = Model(scenario["cache_ns"])
        for (op, *args), want in zip(scenario["ops"], scenario["want"], strict=True):
            try:
                CALLS[op](model, *args)
            except ModelError as error:
                # tf2 says nothing about a frame without samples.
                if error.of_tf2 is None or want["msg"].startswith(","):
                    continue
                sentence, _, _ = with_six_decimals(error.of_tf2).partition(";")
                assert sentence == want["msg"], (scenario["name"], op, args)
                compared += 1
    assert compared > 4000


# The buffer beside the model.

frames = st.sampled_from(FRAMES)
names = frames | frames | st.sampled_from(ODD_NAMES)
# Near each other, at the edges of a cache of 10 ns, and where the arithmetic of stamps ends.
stamps = (
    st.integers(0, 40) | st.integers(0, 40) | st.integers(-2, 1) | st.integers(STAMPS_END - 15, STAMPS_END)
)
good_links = st.tuples(
    frames, frames, stamps, st.integers(0, GOOD_PLACES - 1), st.integers(0, GOOD_TURNS - 1)
)
links = good_links | st.tuples(
    names, names, stamps, st.integers(0, len(PLACES) - 1), st.integers(0, len(TURNS) - 1)
)


class Machine(RuleBasedStateMachine):
    """A buffer and the model take random steps; after each, the answers of both are compared."""

    def __init__(self):
        super().__init__()
        self.pair = Pair()
        self.steps = 0
        self.last = None

    @initialize(cache_ns=st.sampled_from([10, 10, 3, 3, 0, 10 * S, 2**62]), lived_ns=st.integers(0, 20))
    def begin(self, cache_ns, lived_ns):
        """Frames have mostly been received for longer than the cache time, so their rings have wrapped."""
        self.pair.init(cache_ns)
        lived = [
            (parent, child, ns, ns % GOOD_PLACES, 0)
            for ns in range(lived_ns)
            for parent, child in ("ab", "bc")
        ]
        self.pair.insert("list", tuple(lived), "first")

    @rule(way=st.sampled_from(WAYS), link=links, authority=st.sampled_from(AUTHORITIES))
    def insert(self, way, link, authority):
        self.last = link
        self.pair.insert(way, (link,), authority)

    @rule(way=st.sampled_from(WAYS[:3]), links=st.lists(good_links, min_size=2, max_size=6))
    def insert_many(self, way, links):
        self.last = links[-1]
        self.pair.insert(way, tuple(links), "many")

    @rule(links=st.lists(good_links | links, min_size=1, max_size=6), static=st.integers(0, 4))
    def replace(self, links, static):
        self.pair.replace(links, "replacer", static == 4)

    @rule(child=frames, given=st.lists(st.tuples(frames, st.integers(0, 9)), min_size=1), ns=stamps)
    def replace_in_one_frame(self, child, given, ns):
        stamps = [min(max(0, ns + i), STAMPS_END - 1) for _, i in given]
        links = [(one, child, at, i % GOOD_PLACES, i) for (one, i), at in zip(given, stamps, strict=True)]
        self.pair.replace(links, "replacer")

    @precondition(lambda self: self.last is not None)
    @rule(later_ns=st.integers(-12, 12), parent=st.none() | frames)
    def insert_next(self, later_ns, parent):
        """Another sample of the frame of the last one."""
        old_parent, child, ns, x, turn = self.last
        self.last = (parent or old_parent, child, max(0, ns + later_ns), (x + 1) % GOOD_PLACES, turn)
        self.pair.insert("set", (self.last,), "next")

    @rule(change=st.sampled_from([Pair.clear, Pair.save, Pair.restore]))
    def change(self, change):
        change(self.pair)

    @rule(now_ns=st.none() | st.sampled_from([0, 5, 20, 45, STAMPS_END - 1]))
    def set_clock(self, now_ns):
        self.pair.set_clock(now_ns)

    @rule()
    def init_again(self):
        self.pair.init(10)

    @rule(name=frames | names)
    def forget(self, name):
        self.pair.forget(name)

    @rule(how=st.sampled_from(sorted(WAYS_TO_TRAVEL)))
    def travel(self, how):
        self.pair.travel(how)

    @invariant()
    def all_queries_are_answered_as_by_the_model(self):
        self.steps += 1
        ask(self.pair, random.Random(self.steps))


TestBufferAndModel = pytest.mark.repeated(Machine.TestCase)
TestBufferAndModel.settings = settings(
    max_examples=random_runs.times(8, 60),
    stateful_step_count=25,
    phases=[Phase.generate, Phase.shrink],
    suppress_health_check=list(HealthCheck),
)


# Where memory ends.


def full_pair(dice, cache_ns):
    """Both have a sample of each frame, and the buffer has little memory for more."""
    links = [(FRAMES[i - 1], FRAMES[i], 1, 0, 0) for i in range(len(FRAMES))]
    pair = Pair(cache_ns)
    pair.insert("set", links, "first")
    room = dice.choice((0, 300, 1000, 5000))
    pair = Pair(cache_ns, max_bytes=pair.buffer.statistics()["bytes"] + room)
    pair.insert("set", links, "first")
    return pair


def random_link(dice, child, now):
    parent = dice.choice([name for name in FRAMES if name != child] if dice.random() < 0.2 else ["a", "b"])
    ns = now - (dice.randrange(40) * 1000 if dice.random() < 0.3 else 0)
    return (parent, child, max(0, ns), dice.randrange(GOOD_PLACES), dice.randrange(GOOD_TURNS))


def displaced_at_random(dice, cache_ns):
    """How many samples were displaced in random steps."""
    pair, now = full_pair(dice, cache_ns), 10_000
    for step in range(600):
        now += dice.choice((0, 1000, 1000, 3000))
        child, choice = dice.choice("cccde"), dice.random()
        if choice < 0.01:
            pair.forget(child)
        elif choice < 0.012:
            pair.clear()
        elif choice < 0.08:
            links = [random_link(dice, child, now) for _ in range(dice.randint(1, 6))]
            pair.replace_where_memory_ends(links, "first")
        else:
            pair.insert_where_memory_ends(random_link(dice, child, now), "first", static=choice < 0.09)
        if step % 20 == 0:
            pair.buffer._self_check()
            pair.listings()
            pair.histories()
    ask(pair, dice)
    return pair.buffer.statistics()["displaced"]


@pytest.mark.repeated
@pytest.mark.parametrize("cache_ns", [40_000, 2**62])
def test_where_memory_ends_the_oldest_sample_of_a_frame_makes_room(cache_ns):
    runs = range(random_runs.times(4, 100))
    dice = [random.Random(f"{random_runs.first_seed()} {cache_ns} {run}") for run in runs]
    assert sum(map(displaced_at_random, dice, [cache_ns] * len(runs))) > len(runs)


# Small trees, in which frames loop, change their parents and become static.

pairs_of_frames = st.sampled_from(list(itertools.permutations(FRAMES, 2)))
small_stamps = st.integers(0, 11)
small_links = st.tuples(pairs_of_frames, small_stamps, st.sampled_from([False, False, False, True]))


@given(st.lists(small_links, max_size=25))
@example([("ac", 3, False), ("bc", 3, False), ("ac", 5, False)])
@example([("ac", 2, False), ("ac", 3, False), ("bc", 3, False), ("ac", 5, False), ("ab", 0, True)])
@example([("ba", 5, False), ("ab", 2, False), ("be", 8, False), ("eb", 7, False), ("be", 2, False)])
@example([("ea", 0, True), ("ad", 1, False), ("de", 1, False)])
@example([("ab", 3, False), ("ac", 0, False), ("db", 5, False), ("ba", 0, True), ("be", 0, True)])
@settings(max_examples=random_runs.times(50, 3000), deadline=None)
def test_ranges_and_ages_of_small_trees(transforms):
    pair = Pair()
    pair.init(2**62)
    for (parent, child), ns, static in transforms:
        pair.insert("static" if static else "set", ((parent, child, ns, 1, 0),), "x")
    for query in itertools.product(pair.model.names, repeat=2):
        compare_ranges(pair, *query)


# That nothing is left out.


class Asked:
    """A buffer that notes which arguments each of its methods was called with."""

    def __init__(self, buffer):
        self.buffer, self.arguments = buffer, {}

    def __contains__(self, name):
        return name in self.buffer

    def __getattr__(self, name):
        value = getattr(self.buffer, name)
        if not inspect.ismethod(value) and not inspect.isbuiltin(value):
            return value

        def call(*arguments, **more):
            given = inspect.signature(value).bind(*arguments, **more).arguments
            given |= given.pop("policy", {})
            self.arguments.setdefault(name, set()).update(given)
            return value(*arguments, **more)

        return call


def parameters(method):
    named = set(inspect.signature(method).parameters) - {"self"}
    return named - {"policy"} | set(LookupPolicy.__annotations__) if "policy" in named else named


METHODS = {
    name: value
    for name in sorted(set(dir(Buffer)) - set(dir(object)))
    if not name.startswith("_") and callable(value := getattr(Buffer, name))
}


def test_every_public_method_is_asked_or_changes_the_buffer():
    assert set(METHODS) == set(QUESTIONS) | CHANGES
    assert not set(QUESTIONS) & CHANGES


@pytest.mark.parametrize("name", sorted(QUESTIONS))
def test_every_parameter_is_asked(name):
    pair, dice = Pair(), random.Random(1)
    pair.insert("list", tuple(("ab"[i % 2], "bc"[i % 2], 40 + i, i % 3, i % 4) for i in range(6)), "x")
    pair.buffer = Asked(pair.buffer)
    for one in QUESTIONS[name] * 100:
        one(pair, dice)
    assert pair.buffer.arguments[name] == parameters(METHODS[name])


class Misasked(Asked):
    """The same, but each call of one method gets an object of another type as one of its arguments."""

    def __init__(self, buffer, method, parameter):
        super().__init__(buffer)
        self.method, self.parameter = method, parameter

    def __getattr__(self, name):
        if name != self.method:
            return getattr(self.buffer, name)
        value = getattr(self.buffer, name)

        def call(*arguments, **more):
            bound = inspect.signature(value).bind(*arguments, **more)
            named = self.parameter in inspect.signature(value).parameters
            given = bound.arguments if named else bound.arguments.setdefault("policy", {})
            given[self.parameter] = object()
            answer = value(*bound.args, **bound.kwargs)
            if name == "changes":
                answer = answer.__anext__()
            if inspect.iscoroutine(answer):
                answer = answer.send(None)
            pytest.fail(f"{name} accepts an object as {self.parameter}: {answer!r}")

        return call


# These have Python's truth, as in tf2, or are refused with another error.
OF_ANY_TYPE = {"return_debug_tuple", "new_type", "object_stamped", "on_missing", "points"}


@pytest.mark.parametrize("name", sorted(QUESTIONS))
def test_every_parameter_has_a_type(name):
    for parameter in parameters(METHODS[name]) - OF_ANY_TYPE:
        pair, dice = Pair(), random.Random(1)
        pair.insert("list", tuple(("ab"[i % 2], "bc"[i % 2], 40 + i, i % 3, i % 4) for i in range(6)), "x")
        pair.buffer = Misasked(pair.buffer, name, parameter)
        with pytest.raises(TypeError):
            for one in QUESTIONS[name] * 100:
                one(pair, dice)

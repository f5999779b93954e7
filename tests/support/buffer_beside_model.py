# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
A buffer beside the model: what changes both, and queries that both must answer alike.

A link is a transform that both receive, (parent, child, ns, x, turn): `x` and `turn` say which transform.
"""

import copy
import math
import operator
import re
import tempfile
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import yaml
from cdr_encoder import encode
from model import Model
from model_terms import STAMPS_END, ModelError
from pickles_and_copies import WAYS as WAYS_TO_TRAVEL
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rclpy.time import Time
from times_and_transforms import S, rotation, stamp_ns, transform, translation

from tf2_py import BufferCore, TransformException
from tf2_ros import Buffer

FRAMES = ("a", "b", "c", "d", "e")
ODD_NAMES = ("", "/a", "//b", "/", "NO_PARENT", "nowhere")
AUTHORITIES = ("one", "two")
# Some are others times -1, 2 or -2: whoever normalizes those gets the same bits, so they repeat a sample.
TURNS = (
    (0.0, 0.0, 0.0, 1.0),
    (0.0, 0.0, 0.0, -2.0),
    (0.1, 0.2, 0.3, 0.4),
    (-0.2, -0.4, -0.6, -0.8),
    (0.0, 1.0, 0.0, 0.0),
    (0.6, 0.0, -0.8, 0.1),
    (-0.5, 0.1, 0.7, -0.3),
    (0.0, 0.0, -1e-150, 2e-150),
    (0.0, 0.0, 1.5e-154, -0.0),
    (1e150, 0.0, 0.0, 1e153),
    (0.0, 0.0, 0.0, 0.0),
    (0.0, math.nan, 0.0, 1.0),
    (1e200, 0.0, 0.0, 0.0),
    (0.0, 0.0, 1e-162, 1.6e-162),  # the square is subnormal
    (0.0, 1e-155, 0.0, 1e-155),
)
GOOD_TURNS = 10  # the first ones
PLACES = (0.0, 1.0, -2.5, 0.125, 1e3, math.nan, math.inf)
GOOD_PLACES = 5
WAYS = ("set", "static", "list", "static list", "cdr", "static cdr")


def place(x):
    """The translation that a link names."""
    return (PLACES[x], 2 * PLACES[x] + 0.5, -PLACES[x])


def message(link):
    parent, child, ns, x, turn = link
    made = transform(parent, child, xyz=place(x), xyzw=TURNS[turn], ns=min(ns, STAMPS_END - 1))
    if ns < STAMPS_END:
        return made
    # A message cannot carry it.
    header = SimpleNamespace(stamp=SimpleNamespace(nanoseconds=ns), frame_id=parent)
    return SimpleNamespace(header=header, child_frame_id=child, transform=made.transform)


RELATIVE = 1e-9


def as_model_tells(answer):
    header, child = answer.header, answer.child_frame_id
    return (stamp_ns(answer), header.frame_id, child, translation(answer), rotation(answer))


def same_numbers(got, want, scale):
    return all(abs(a - b) <= RELATIVE * scale for a, b in zip(got, want, strict=True))


def same_rotation(got, want):
    if same_numbers(got, want, 1.0):
        return True
    # On the edge between the two signs rounding decides.
    x, y, z, w = want
    low, high = sorted((abs(x), abs(y), abs(z)))[1:]
    on_edge = abs(4 * w * w - 1) < 1e-6 or (4 * w * w < 1 and high - low < 1e-6)
    return on_edge and same_numbers(got, tuple(-a for a in want), 1.0)


def same_answer(got, want):
    scale = max(1e3, *(abs(a) for a in want[3]))
    return got[:3] == want[:3] and same_numbers(got[3], want[3], scale) and same_rotation(got[4], want[4])


def without_advice(text):
    """The model does not judge which names resemble each other."""
    text = re.sub(r"\.?(?<=[.?]) Transforms of \[[^]]*\] were refused, because [^.]*", "", text)
    return re.sub(r"\.? Did you mean \[.*\]\?$", "", text)


def of_buffer(call, *arguments, **more):
    """("answer", it), or ("error", class, text)."""
    try:
        return ("answer", call(*arguments, **more))
    except (TransformException, ValueError, OverflowError) as error:
        return as_error(error)


def as_error(error):
    return ("error", type(error).__name__, without_advice(str(error)))


def of_model(call, *arguments):
    """The same, with all texts that are right."""
    try:
        return ("answer", call(*arguments))
    except ModelError as error:
        return ("error", error.kind, error.texts)


def same_error(got, want):
    return got[:2] == want[:2] and got[2] in want[2]


STALE = "is too old; the newest sample of"


def same_kind(got, want):
    """As same_error; but under a policy, the model does not know which of several gaps is described."""
    is_exact = want[1] != "ExtrapolationException" or STALE in want[2][0]
    return same_error(got, want) if is_exact else got[:2] == want[:2] and STALE not in got[2]


def same_velocity(got, want):
    linear, angular, duration = want
    if duration == 0:
        return all(map(math.isnan, (*got[0], *got[1])))
    # Places lie up to kilometers apart; of their difference a part of 10⁻⁹ is divided by the time between.
    tolerance = 1e-6 / duration
    pairs = zip((*got[0], *got[1]), (*linear, *angular), strict=True)
    return all(abs(a - b) <= max(tolerance, RELATIVE * abs(b)) for a, b in pairs)


class SetClock:
    """The clock of a buffer, which shows what it was set to."""

    clock_type = ClockType.ROS_TIME
    ros_time_is_active = True

    def __init__(self, ns):
        self.ns = ns

    def now(self):
        return Time(nanoseconds=self.ns, clock_type=self.clock_type)


class Pair:
    """A buffer and a model that receive the same transforms."""

    def __init__(self, cache_ns=10, **limits):
        self.buffer, self.model = Buffer(Duration(nanoseconds=cache_ns), **limits), Model(cache_ns)
        self.saved = None  # a state of the buffer, and the model of that moment
        self.shown_ns = 0  # by the last clock that was read
        self.set_clock(45)

    def init(self, cache_ns):
        BufferCore.__init__(self.buffer, Duration(nanoseconds=cache_ns))
        self.model = Model(cache_ns)
        self.set_clock(self.now_ns)

    def set_clock(self, now_ns):
        """
        None: the buffer has no clock. A clock that goes back by a second clears the buffer when it is read.
        """
        self.now_ns = self.model.now_ns = now_ns
        self.buffer.clock = None if now_ns is None else SetClock(now_ns)
        if now_ns is not None:
            if self.shown_ns - now_ns >= S:
                self.clear()
            self.shown_ns = now_ns
            with suppress(ValueError, TransformException):
                self.buffer.ages("a", "b")  # reads the clock

    def insert(self, way, links, authority):
        """In one call, or one call for each link."""
        static, messages = way.startswith("static"), list(map(message, links))
        taken = [
            self.model.insert(parent, child, ns, place(x), TURNS[turn], authority, static)
            for parent, child, ns, x, turn in links
        ]
        if way.endswith("cdr") and all(hasattr(made.header.stamp, "sec") for made in messages):
            counted = self.buffer.set_transforms_cdr(encode(messages), authority, static)
        elif way.endswith(("list", "cdr")):
            counted = self.buffer.set_transforms(iter(messages), authority, static)
        else:
            put = self.buffer.set_transform_static if static else self.buffer.set_transform
            assert [put(made, authority) for made in messages] == [None] * len(links)
            return
        assert counted == sum(taken)

    def replace(self, links, authority, static=False):
        """In one call; a single dynamic link by set_transform."""
        messages = list(map(message, links))
        given = [(parent, child, ns, place(x), TURNS[turn]) for parent, child, ns, x, turn in links]
        taken = self.model.replace(given, authority, static)
        if len(links) == 1 and not static:
            assert self.buffer.set_transform(messages[0], authority, replace=True) is None
        else:
            assert self.buffer.set_transforms(messages, authority, static, replace=True) == taken

    def insert_where_memory_ends(self, link, authority, static=False):
        """As insert, of one link between known names; the buffer tells the model that it is full."""
        parent, child, ns, x, turn = link
        was = self.limited()
        taken = self.buffer.set_transforms([message(link)], authority, static)
        is_full = self.limited() != was
        assert taken == self.model.insert(
            parent, child, ns, place(x), TURNS[turn], authority, static, is_full
        )

    def replace_where_memory_ends(self, links, authority):
        """As insert_where_memory_ends, of the links of one frame in one call of replace."""
        given = [(parent, child, ns, place(x), TURNS[turn]) for parent, child, ns, x, turn in links]
        was_displaced, was_refused = self.limited()
        taken = self.buffer.set_transforms(list(map(message, links)), authority, replace=True)
        displaced, refused = self.limited()
        if refused > was_refused:
            self.model.refuse_all(given, "too_many_bytes")
        else:
            assert self.model.replace(given, authority, displaced=displaced - was_displaced) == taken

    def limited(self):
        """How many samples were displaced and refused, because memory ended."""
        statistics = self.buffer.statistics()
        return statistics["displaced"], statistics["refused"]["too_many_bytes"]

    def clear(self):
        self.buffer.clear()
        self.model.clear()

    def forget(self, name):
        got, wanted = of_buffer(self.buffer.forget, name), of_model(self.model.forget, name)
        self.compare(("forget", name), got, wanted)

    def travel(self, how):
        """Go on with a copy."""
        before = self.buffer
        with tempfile.TemporaryDirectory() as folder:
            self.buffer = WAYS_TO_TRAVEL[how](before, Path(folder))
        self.model.travel()
        self.set_clock(self.now_ns)
        before.clear()  # what the copy has is its own
        before._self_check()

    def save(self):
        self.saved = (self.buffer.__getstate__(), copy.deepcopy(self.model))

    def restore(self):
        """The buffer becomes what was saved."""
        if self.saved is not None:
            state, model = self.saved
            self.buffer.__setstate__(state)
            self.model = copy.deepcopy(model)
            self.model.travel()
            self.set_clock(self.now_ns)

    # Queries.

    def compare(self, query, got, wanted, same=operator.eq, same_error=same_error):
        is_error = got[0] == wanted[0] == "error"
        agree = same_error(got, wanted) if is_error else got[0] == wanted[0] and same(got[1], wanted[1])
        assert agree, (query, got, wanted)

    def told(self, call, *arguments, **more):
        return of_buffer(lambda: as_model_tells(call(*arguments, **more)))

    def lookup(self, *query):
        """Of target, source, ns."""
        wanted = of_model(self.model.lookup, *query)
        self.compare(query, self.told(self.buffer.lookup_transform_core, *query), wanted, same_answer)
        self._compare_reason(query, self.buffer.can_transform_core, self.model.can)

    def lookup_full(self, *query):
        """Of target, target_ns, source, source_ns, fixed."""
        wanted = of_model(self.model.lookup_full, *query)
        self.compare(query, self.told(self.buffer.lookup_transform_full_core, *query), wanted, same_answer)
        self._compare_reason(query, self.buffer.can_transform_full_core, self.model.can_full)
        chain = of_buffer(self.buffer._chain, *query)
        self.compare(("chain", *query), chain, of_model(self.model.chain, *query))

    def _compare_reason(self, query, can, can_of_model):
        def same_reason(got, wanted):
            return got[0] == wanted[0] and without_advice(got[1]) in wanted[1:]

        self.compare(query, of_buffer(can, *query), of_model(can_of_model, *query), same_reason)

    def latest(self, *query):
        got = of_buffer(lambda: self.buffer.get_latest_common_time(*query).nanoseconds)
        self.compare(("latest", *query), got, of_model(self.model.latest, *query))

    def listings(self):
        buffer, model = self.buffer, self.model
        statistics = buffer.statistics()
        counted = {name: statistics[name] for name in ("taken", "frames", "samples", "displaced")}
        counted["refused"] = {reason: count for reason, count in statistics["refused"].items() if count}
        dot = buffer._allFramesAsDot()
        pairs = {
            "statistics": (counted, model.statistics()),
            "names": (buffer._getFrameStrings(), model.names),
            "frames": ({name: tuple(info) for name, info in buffer.frames().items()}, model.infos()),
            "order of frames": (list(buffer.frames()), model.names),
            "string": (buffer.all_frames_as_string(), model.string()),
            "yaml": (yaml.load(buffer.all_frames_as_yaml(), yaml.CSafeLoader) or {}, model.yaml()),
            "dot": (sorted(re.findall(r'"([^"]+)" -> "([^"]+)"', dot)), model.edges()),
            "tree": (buffer.tree(), model.tree()),
        }
        for name in (*model.names, *ODD_NAMES):
            pairs[f"exists {name}"] = (bool(buffer._frameExists(name)), model.exists(name))
            pairs[f"{name} in"] = (name in buffer, name in model.names)
        for name, (got, wanted) in pairs.items():
            assert got == wanted, name

    def histories(self):
        found = self.buffer.histories()
        held = {name: frame for name, frame in self.model.frames.items() if frame.samples}
        assert set(found) == set(held)
        for name, frame in held.items():
            one, (stamps, parents, places, turns) = found[name], zip(*frame.samples, strict=True)
            got = (one.frame, one.static, one.parents.tolist(), one.stamps_ns.tolist())
            assert got == (name, frame.static, [*parents], [*stamps])
            assert one.translations.tolist() == [*map(list, places)], name
            pairs = zip(one.rotations.tolist(), turns, strict=True)
            assert all(same_rotation(q, turn) for q, turn in pairs), (name, turns)

    def times(self):
        """All times at which an answer may change, and some between them; no stamp can hold the outermost."""
        stamps = {sample[0] for frame in self.model.frames.values() for sample in frame.samples}
        near = {ns + step for ns in stamps for step in (-1, 0, 1)}
        return sorted(near | {-STAMPS_END - 1, -STAMPS_END, -1, 0, 1, STAMPS_END - 1, STAMPS_END})

"""
A buffer beside the model: what changes both, and queries that both must answer alike.

A link is a transform that both receive, (parent, child, ns, x, turn): `x` and `turn` say which transform.
"""

import copy
import itertools
import math
import operator
import re
import tempfile
from pathlib import Path
from types import SimpleNamespace

import yaml
from encoding import encode
from making import S, rotation, stamp_ns, transform, translation
from model import STAMPS_END, Model, ModelError, Policy
from rclpy.duration import Duration
from travelling import BY_FILE
from travelling import WAYS as WAYS_TO_TRAVEL

from tf2_py import BufferCore, TransformException
from tf2_ros import Buffer

FRAMES = ("a", "b", "c", "d", "e")
ODD_NAMES = ("", "/a", "//b", "/", "NO_PARENT", "nowhere")
AUTHORITIES = ("one", "two")
# Some are others times -1, 2 or -2: whoever normalises those gets the same bits, so they repeat a sample.
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


POLICIES = (Policy(2), Policy(3, True), Policy(max_gap=2), Policy(50, True, 4))
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
    return re.sub(r"(does not exist)\. Did you mean \[.*\]\?$", r"\1", text)


def of_buffer(call, *arguments):
    """("answer", it), or ("error", class, text)."""
    try:
        return ("answer", call(*arguments))
    except TransformException as error:
        return ("error", type(error).__name__, without_advice(str(error)))


def of_model(call, *arguments):
    """The same, with all texts that are right."""
    try:
        return ("answer", call(*arguments))
    except ModelError as error:
        return ("error", error.kind, error.texts)


def same_error(got, want):
    return got[:2] == want[:2] and got[2] in want[2]


def same_velocity(got, want):
    linear, angular, duration = want
    if duration == 0:
        return all(map(math.isnan, (*got[0], *got[1])))
    # Places lie up to kilometres apart; of their difference a part of 10⁻⁹ is divided by the time between.
    tolerance = 1e-6 / duration
    pairs = zip((*got[0], *got[1]), (*linear, *angular), strict=True)
    return all(abs(a - b) <= max(tolerance, RELATIVE * abs(b)) for a, b in pairs)


class Pair:
    """A buffer and a model that receive the same transforms."""

    def __init__(self):
        self.buffer, self.model = Buffer(Duration(nanoseconds=10)), Model(10)
        self.saved = None  # a state of the buffer, and the model of that moment

    def init(self, cache_ns):
        BufferCore.__init__(self.buffer, Duration(nanoseconds=cache_ns))
        self.model = Model(cache_ns)

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
        if how in BY_FILE:  # which do not name the frames in their order
            names = self.buffer._getFrameStrings()
            assert sorted(names) == sorted(self.model.names)
            self.model.order = names
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

    # Queries.

    def compare(self, query, got, wanted, same=operator.eq):
        is_error = got[0] == wanted[0] == "error"
        agree = same_error(got, wanted) if is_error else got[0] == wanted[0] and same(got[1], wanted[1])
        assert agree, (query, got, wanted)

    def _told(self, call, *arguments):
        return of_buffer(lambda: as_model_tells(call(*arguments)))

    def lookup(self, *query):
        """Of target, source, ns."""
        wanted = of_model(self.model.lookup, *query)
        self.compare(query, self._told(self.buffer.lookup_transform_core, *query), wanted, same_answer)
        self._compare_reason(query, self.buffer.can_transform_core(*query), self.model.can(*query))

    def lookup_full(self, *query):
        """Of target, target_ns, source, source_ns, fixed."""
        wanted = of_model(self.model.lookup_full, *query)
        self.compare(query, self._told(self.buffer.lookup_transform_full_core, *query), wanted, same_answer)
        self._compare_reason(query, self.buffer.can_transform_full_core(*query), self.model.can_full(*query))
        chain = of_buffer(self.buffer._chain, *query)
        self.compare(("chain", *query), chain, of_model(self.model.chain, *query))

    def _compare_reason(self, query, got, wanted):
        agree = got[0] == wanted[0] and without_advice(got[1]) in wanted[1:]
        assert agree, (query, got, wanted)

    def latest(self, *query):
        got = of_buffer(lambda: self.buffer.get_latest_common_time(*query).nanoseconds)
        self.compare(("latest", *query), got, of_model(self.model.latest, *query))

    def series(self, target, source, times, fixed=None, target_ns=None, policy=None):
        """
        The answers for several times, one by one and in one call.

        The rows of one call are the answers one by one, what is missing is NaN, or the first error. Under a
        policy, only the kind of an error is that of the model.
        """
        query = ("series", target, source, times, fixed, target_ns, policy)
        more = {} if fixed is None else {"fixed_frame": fixed, "target_time": target_ns}
        if policy is not None:
            more["tolerance"] = Duration(nanoseconds=policy.tolerance)
            more["extrapolate"] = policy.extrapolate
            more["max_gap"] = None if policy.max_gap is None else Duration(nanoseconds=policy.max_gap)
        options = {} if policy is None else more
        rows, all_or_error = [
            of_buffer(
                lambda how=how: self.buffer.lookup_transforms(target, source, times, on_missing=how, **more)
            )
            for how in ("nan", "raise")
        ]
        failed = None
        for i, ns in enumerate(times):
            if fixed is None:
                got = self._told(lambda ns=ns: self.buffer.lookup_transform(target, source, ns, **options))
                if policy is None:
                    wanted = of_model(self.model.lookup, target, source, ns)
                else:
                    wanted = of_model(self.model.lookup_under, policy, target, source, ns)
            else:
                arguments = (target, target_ns, source, ns, fixed)
                got = self._told(self.buffer.lookup_transform_full, *arguments)
                wanted = of_model(self.model.lookup_full, *arguments)
            if policy is not None and wanted[0] == "error":
                wanted = (*wanted[:2], got[2:])
            self.compare(query, got, wanted, same_answer)
            if got[0] == "error" and failed is None:
                text = got[2] if "passed to" in got[2] else f"times[{i}]: {got[2]}"
                failed = (*got[:2], text)
            if rows[0] == "error":
                assert got[:2] == rows[:2], query
                continue
            row = (*rows[1][0][i], *rows[1][1][i])
            agree = all(map(math.isnan, row)) if got[0] == "error" else row == (*got[1][3], *got[1][4])
            assert agree, (query, row, got)
        agree = all_or_error[0] == "answer" if failed is None else all_or_error == failed
        assert agree, (query, all_or_error, failed)

    def _ask_at_the_ends_of_policies(self, dice):
        for name, frame in self.model.frames.items():
            for older, newer in itertools.pairwise(frame.samples[-4:]):
                policy = Policy(max_gap=max(0, newer[0] - older[0] - dice.randrange(2)))
                self.series(older[1], name, ((older[0] + newer[0]) // 2,), policy=policy)
            if frame.samples and frame.newest_ns() < STAMPS_END - 10:
                policy = Policy(dice.randrange(1, 5), dice.random() < 0.5)
                end = frame.newest_ns() + policy.tolerance
                self.series(frame.newest_parent(), name, (end - 1, end, end + 1), policy=policy)

    def relatives(self, name, other, ns):
        for call, *query in (("parent", name, ns), ("children", name), ("path", other, name, ns)):
            wanted = of_model(getattr(self.model, call), *query)
            self.compare((call, *query), of_buffer(getattr(self.buffer, call), *query), wanted)

    def velocity(self, *query):
        """Of tracking, observation, reference frame, point, point's frame, ns, interval in ns."""
        *arguments, interval_ns = query
        got = of_buffer(self.buffer.lookupVelocityFullCore, *arguments, Duration(nanoseconds=interval_ns))
        errors, answers = self.model.velocity(*query)
        if got[0] == "error":
            agree = any(same_error(got, ("error", error.kind, error.texts)) for error in errors)
        else:
            agree = any(same_velocity(got[1], answer) for answer in answers)
        assert agree, (query, got, errors or answers)

    def listings(self):
        buffer, model = self.buffer, self.model
        statistics = buffer.statistics()
        counted = {name: statistics[name] for name in ("taken", "frames", "samples")}
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

    # Many queries at once.

    def times(self):
        """All times at which an answer may change, and some between them."""
        stamps = {sample[0] for frame in self.model.frames.values() for sample in frame.samples}
        near = {ns + step for ns in stamps for step in (-1, 0, 1)}
        return sorted(
            ns for ns in near | {-STAMPS_END, -1, 0, 1, STAMPS_END - 1} if -STAMPS_END <= ns < STAMPS_END
        )

    def ask(self, dice):
        """Listings and every pair of frames, at some of the times."""
        self.buffer._self_check()
        self.listings()
        self.histories()
        times, names = self.times(), [*self.model.names, "nowhere"]
        for target, source in itertools.product(names, repeat=2):
            self.latest(target, source)
            for ns in {0, *dice.sample(times, min(len(times), 2))}:
                self.lookup(target, source, ns)
        names.append(dice.choice(ODD_NAMES))
        for _ in range(6 * len(names)):
            target, source, fixed = (dice.choice(names) for _ in range(3))
            target_ns, source_ns = dice.choice([0, *times]), dice.choice([0, *times])
            self.lookup_full(target, target_ns, source, source_ns, fixed)
        for _ in range(6):
            target, source, fixed = (dice.choice(names) for _ in range(3))
            some = tuple(dice.choices([0, *times], k=5))
            self.lookup(target, source, some[0])
            self.series(target, source, some)
            self.series(target, source, some, fixed, some[0])
            self.series(target, source, some, policy=dice.choice(POLICIES))
            self.relatives(source, target, some[2])
            point = (dice.choice((0.0, 1.0)), -2.0, 0.5)
            references = (dice.choice(names), point, dice.choice(names))
            self.velocity(target, source, *references, some[0], dice.choice((0, 1, 2, 3, 10, 1000, S)))
        self._ask_at_the_ends_of_policies(dice)

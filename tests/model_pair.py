"""
Owns a buffer beside the model: the steps that both take, and the queries that both must answer alike.

A step is a tuple: the name of a method `do_...` of `Pair`, and its arguments. Dropping any step leaves a
sequence that can be run. A link is (parent, child, ns, x, turn): `x` and `turn` say which transform.
"""

import copy
import math
import pickle
import random
import re
from collections import Counter
from types import SimpleNamespace

import numpy as np
import yaml
from geometry_msgs.msg import PointStamped
from making import S, rotation, stamp_ns, transform, translation
from model import STAMPS_END, Model, ModelError, added, turned
from processes import until
from rclpy.duration import Duration
from test_tf2_py_cdr import encode
from waiters_random import shrink

from tf2_py import BufferCore, TransformException
from tf2_ros import Buffer

FRAMES = ("a", "b", "c", "d", "e", "f", "g", "h")
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
    (0.0, 0.0, 0.0, 0.0),
    (0.0, math.nan, 0.0, 1.0),
    (1e200, 0.0, 0.0, 0.0),
)
GOOD_TURNS = 7  # the first ones
PLACES = (0.0, 1.0, -2.5, 0.125, 1e3, math.nan, math.inf)
GOOD_PLACES = 5
WAYS = ("set", "static", "list", "static list", "cdr", "static cdr")
WAITS = ("notified", "blocking", "future", "called")
MOST_PENDING = 12  # the oldest waiter makes room for a new one
RELATIVE = 1e-9
POINT = (0.5, -1.0, 2.0)


class Broken(AssertionError):
    """Buffer and model disagree, or an invariant does not hold."""

    def __init__(self, text, query=None):
        super().__init__(text)
        self.query = query  # a step that shows it again


def require(condition, what, *facts):
    if not condition:
        raise Broken(f"{what}: {', '.join(map(repr, facts))}" if facts else what)


# Messages, and what is made of answers.


def place(x):
    """The translation that a link names by an index of PLACES, or by a larger number."""
    x = PLACES[x] if x < len(PLACES) else float(x)
    return (x, 2 * x + 0.5, -x)


def message(link):
    parent, child, ns, x, turn = link
    xyz = place(x)
    if -STAMPS_END <= ns < STAMPS_END:
        return transform(parent, child, xyz=xyz, xyzw=TURNS[turn], ns=ns)
    # A message cannot carry it.
    made = transform(parent, child, xyz=xyz, xyzw=TURNS[turn])
    header = SimpleNamespace(stamp=SimpleNamespace(nanoseconds=ns), frame_id=parent)
    return SimpleNamespace(header=header, child_frame_id=child, transform=made.transform)


def as_model_tells(answer):
    return (
        stamp_ns(answer),
        answer.header.frame_id,
        answer.child_frame_id,
        translation(answer),
        rotation(answer),
    )


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


def of_buffer(call):
    """("answer", it), or ("error", class, text)."""
    try:
        return ("answer", call())
    except TransformException as error:
        return ("error", type(error).__name__, without_advice(str(error)))


def of_model(call):
    """The same, with all texts that are right."""
    try:
        return ("answer", call())
    except ModelError as error:
        return ("error", error.kind, error.texts)


def same_error(got, want):
    return got[:2] == want[:2] and got[2] in want[2]


class Waiter:
    """One waiter by one of the interfaces, and what it has received; see `waiters_random.Waiter`."""

    def __init__(self, kind, lookup, buffer, deliveries):
        self.kind, self.lookup, self.received = kind, lookup, []
        self._deliveries = deliveries
        target, source, ns, *rest = lookup
        if kind in ("notified", "blocking"):
            notify = self._receive if kind == "notified" else None
            self.handle = buffer._wait(target, source, ns, *rest, notify=notify)
        elif rest:
            fixed, target_ns = rest
            self.handle = buffer.wait_for_transform_full_async(target, target_ns, source, ns, fixed)
        else:
            self.handle = buffer.wait_for_transform_async(target, source, ns)
        if kind == "called" and not self.handle.done():
            self.handle.add_done_callback(self._called)

    def _called(self, future):
        if not future.cancelled():
            self._receive(future.result())

    def _receive(self, answer):
        self.received.append(answer)
        self._deliveries.append(self)

    @property
    def notifies(self):
        return self.kind in ("notified", "called")

    def immediate(self):
        if self.kind in ("notified", "blocking"):
            return self.handle.answer
        return self.handle.result() if self.handle.done() else None

    def answer(self):
        if self.notifies:
            return self.received[0] if self.received else None
        return self.immediate()

    def cancel(self):
        if self.kind in ("notified", "blocking"):
            require(self.handle.cancel() is True, "cancel() says that a pending wait was over", self)
        else:
            self.handle.cancel()
            require(self.handle.cancelled(), "a pending future cannot be cancelled", self)

    def __repr__(self):
        return f"{self.kind} waiter for {self.lookup}"


class Pair:
    """A buffer and a model that receive the same transforms, and the buffer's waiters."""

    def __init__(self, make_buffer=Buffer):
        self.buffer = make_buffer(Duration(nanoseconds=10))
        self.model = Model(10)
        self.pending = []
        self.deliveries = []  # waiters that were told, and that nobody has accounted for
        self.saved = None  # a state of the buffer, and the model of that moment
        self.counts = Counter()  # of queries, and of what came of them

    def take(self, step):
        name, *arguments = step
        getattr(self, f"do_{name}")(*arguments)

    # Transforms.

    def do_init(self, cache_ns):
        def change():
            BufferCore.__init__(self.buffer, Duration(nanoseconds=cache_ns))
            self.model = Model(cache_ns)

        self._change(change, [lambda: None])

    def do_insert(self, way, links, authority):
        """In one call, or one call for each link."""
        static = way.startswith("static")
        if way.endswith(("list", "cdr")):
            self._insert_many(way, links, authority, static)
            return
        for link in links:

            def change(link=link):
                put = self.buffer.set_transform_static if static else self.buffer.set_transform
                require(put(message(link), authority) is None, "an insert returned something")

            self._change(change, [self._modelled(link, authority, static, [])])

    def _insert_many(self, way, links, authority, static):
        messages, taken, counted = list(map(message, links)), [], []

        def change():
            if way.endswith("cdr") and all(hasattr(made.header.stamp, "sec") for made in messages):
                counted.append(self.buffer.set_transforms_cdr(encode(messages), authority, static))
            else:
                counted.append(self.buffer.set_transforms(messages, authority, static))

        self._change(change, [self._modelled(link, authority, static, taken) for link in links])
        require(counted == [sum(taken)], "an insert counted otherwise", counted, taken)

    def _modelled(self, link, authority, static, taken):
        parent, child, ns, x, turn = link

        def insert():
            taken.append(self.model.insert(parent, child, ns, place(x), TURNS[turn], authority, static))

        return insert

    def do_clear(self):
        self._change(self.buffer.clear, [lambda: self.model.clear()])

    # Travelling.

    def do_travel(self, how):
        """Go on with a copy; waiters do not travel."""
        before = self.buffer
        if how == "pickle":
            self.buffer = pickle.loads(pickle.dumps(before))
        else:
            self.buffer = copy.deepcopy(before) if how == "deepcopy" else copy.copy(before)
        while self.pending:
            self.pending.pop().cancel()
        before.clear()  # what the copy has is its own
        before._self_check()
        require(not self.deliveries, "told of a clear()", self.deliveries)
        self._check_waiters()

    def do_save(self):
        self.saved = (self.buffer.__getstate__(), copy.deepcopy(self.model))

    def do_restore(self):
        """The buffer becomes what was saved; its waiters go on."""
        if self.saved is not None:
            state, model = self.saved

            def change():
                self.buffer.__setstate__(state)
                self.model = copy.deepcopy(model)

            self._change(change, [lambda: None])

    # Waiters.

    def do_wait(self, kind, lookup):
        wanted = of_model(lambda: self._model_lookup(lookup))
        refused = of_model(lambda: self.model.check_wait(*lookup[:2], *lookup[3:4]))
        got = of_buffer(lambda: self._begin(kind, lookup))
        require(not self.deliveries, "an answer that was available at once was delivered, too", lookup)
        if refused[0] == "error" or got[0] == "error":
            require(same_error(got, refused), "refused otherwise", lookup, got, refused)
            self._check_waiters()
            return
        waiter = got[1]
        immediate = waiter.immediate()
        require((immediate is not None) == (wanted[0] == "answer"), "a wait began wrongly", waiter, wanted)
        if immediate is None:
            self.pending.append(waiter)
        else:
            require(same_answer(as_model_tells(immediate), wanted[1]), "another answer", waiter, wanted)
        if len(self.pending) > MOST_PENDING:
            self.do_cancel(0)
        self._check_waiters()

    def _begin(self, kind, lookup):
        waiter = Waiter(kind, lookup, self.buffer, self.deliveries)
        waiter.immediate()  # the error of a future
        return waiter

    def do_cancel(self, index):
        if self.pending:
            self.pending.pop(index % len(self.pending)).cancel()
        self._check_waiters()

    def do_drop(self, index):
        if self.pending:
            index %= len(self.pending)
            if self.pending[index].kind != "called":  # that one lives by its callback
                del self.pending.pop(index).handle
        self._check_waiters()

    def _change(self, change, parts):
        """Whoever can be answered after a part is answered, is told once, and in the order of the waits."""
        change()
        possible = {waiter: [] for waiter in self.pending}
        for part in parts:
            part()
            for waiter in self.pending:
                kind, *answer = of_model(lambda waiter=waiter: self._model_lookup(waiter.lookup))
                possible[waiter] += [*answer] if kind == "answer" else []
        answered = []
        for waiter in self.pending:
            answer = waiter.answer()
            require(
                (answer is not None) == bool(possible[waiter]), "forgotten, or answered without data", waiter
            )
            if answer is not None:
                got = as_model_tells(answer)
                fits = any(same_answer(got, want) for want in possible[waiter])
                require(fits, "an answer that no lookup gives", waiter, got, possible[waiter])
                answered.append(waiter)
        told = [waiter for waiter in answered if waiter.notifies]
        heard = list(self.deliveries)
        if len(parts) > 1:
            told, heard = sorted(told, key=id), sorted(heard, key=id)
        require(told == heard, "those who are answered are not those who were told", told, heard)
        self.counts["waits answered"] += len(answered)
        self.pending = [waiter for waiter in self.pending if waiter not in answered]
        self.deliveries.clear()
        self._check_waiters()

    def _model_lookup(self, lookup):
        target, source, ns, *rest = lookup
        if not rest:
            return self.model.lookup(target, source, ns)
        fixed, target_ns = rest
        return self.model.lookup_full(target, target_ns, source, ns, fixed)

    def _check_waiters(self):
        for waiter in self.pending:
            wanted = of_model(lambda waiter=waiter: self._model_lookup(waiter.lookup))
            require(wanted[0] == "error", "pending, and its lookup would answer", waiter)
            if waiter.kind in ("notified", "blocking"):
                reason = waiter.handle.reason()
                got = ("error", type(reason).__name__, without_advice(str(reason)))
                require(same_error(got, wanted), "another reason", waiter, got, wanted)
        waiters = self.buffer.statistics()["waiters"]
        require(waiters == len(self.pending), "statistics() counts other waiters", waiters, self.pending)
        listed = sorted(line.partition("]")[0] for line in self.buffer._pending_waits())
        wanted = sorted(f"waits for the transform from frame [{w.lookup[1]}" for w in self.pending)
        require(listed == wanted, "other pending waits are listed", listed, wanted)
        require(not self.deliveries, "told, and not pending", self.deliveries)
        self.buffer._self_check()

    # Queries.

    def do_lookup(self, target, source, ns):
        query = ("lookup", target, source, ns)
        wanted = of_model(lambda: self.model.lookup(target, source, ns))
        got = of_buffer(lambda: as_model_tells(self.buffer.lookup_transform_core(target, source, ns)))
        self._compare(query, got, wanted, same_answer)
        can, reason = self.buffer.can_transform_core(target, source, ns)
        self._compare_reason(query, (can, reason), self.model.can(target, source, ns))

    def do_lookup_full(self, target, target_ns, source, source_ns, fixed):
        arguments = (target, target_ns, source, source_ns, fixed)
        query = ("lookup_full", *arguments)
        wanted = of_model(lambda: self.model.lookup_full(*arguments))
        got = of_buffer(lambda: as_model_tells(self.buffer.lookup_transform_full_core(*arguments)))
        self._compare(query, got, wanted, same_answer)
        reason = self.buffer.can_transform_full_core(*arguments)
        self._compare_reason(query, reason, self.model.can_full(*arguments))

    def _compare_reason(self, query, got, wanted):
        if got[0] != wanted[0] or without_advice(got[1]) not in wanted[1:]:
            raise Broken(f"other reasons of {query}: {got}, the model {wanted}", query)
        self.counts["queries"] += 1

    def _compare(self, query, got, wanted, same):
        self.counts["queries"] += 1
        self.counts[wanted[0] if wanted[0] == "answer" else wanted[1]] += 1
        if got[0] != wanted[0]:
            agree = False
        elif got[0] == "error":
            agree = same_error(got, wanted)
        else:
            agree = same(got[1], wanted[1])
        if not agree:
            raise Broken(f"{query}: {got}, the model {wanted}", query)

    def do_latest(self, target, source):
        got = of_buffer(lambda: self.buffer.get_latest_common_time(target, source).nanoseconds)
        wanted = of_model(lambda: self.model.latest(target, source))
        self._compare(("latest", target, source), got, wanted, lambda a, b: a == b)

    def do_series(self, target, source, times, fixed=None, target_ns=None):
        """The rows are the answers of single lookups; what is missing is NaN, or the first error."""
        query = ("series", target, source, times, fixed, target_ns)
        more = {} if fixed is None else {"fixed_frame": fixed, "target_time": target_ns}
        lookups = [
            (target, source, ns) if fixed is None else (target, source, ns, fixed, target_ns) for ns in times
        ]
        wanted = [of_model(lambda lookup=lookup: self._model_lookup(lookup)) for lookup in lookups]
        errors = [(i, *want[1:]) for i, want in enumerate(wanted) if want[0] == "error"]
        rows = np.array(times, dtype=np.int64)
        got = of_buffer(lambda: self.buffer.lookup_transforms(target, source, rows, **more))
        if errors:
            i, kind, texts = errors[0]
            is_name = "passed to" in texts[0]
            first = ("error", kind, texts if is_name else [f"times[{i}]: {text}" for text in texts])
            self._compare(query, got, first, None)
            if is_name:
                return
            arrays = self.buffer.lookup_transforms(target, source, rows, on_missing="nan", **more)
        else:
            require(got[0] == "answer", "a series without an answer", query, got)
            arrays = got[1]
        self.counts["queries"] += 1
        for i, want in enumerate(wanted):
            row = tuple(arrays[0][i]), tuple(arrays[1][i])
            if want[0] == "error":
                agree = all(math.isnan(a) for a in (*row[0], *row[1]))
            else:
                agree = same_answer((*want[1][:3], *row), want[1])
            if not agree:
                raise Broken(f"{query}, row {i}: {row}, the model {want}", query)

    def do_chain(self, target, target_ns, source, source_ns, fixed):
        arguments = (target, target_ns, source, source_ns, fixed)
        got = of_buffer(lambda: self.buffer._chain(*arguments))
        wanted = of_model(lambda: self.model.chain(*arguments))
        self._compare(("chain", *arguments), got, wanted, lambda a, b: a == b)

    def do_velocity(self, tracking, observation, reference, point, point_frame, ns, interval_ns):
        arguments = (tracking, observation, reference, point, point_frame, ns)
        query = ("velocity", *arguments, interval_ns)
        interval = Duration(nanoseconds=interval_ns)
        got = of_buffer(lambda: self.buffer.lookupVelocityFullCore(*arguments, interval))
        errors, answers = self.model.velocity(*arguments, interval_ns)
        self.counts["queries"] += 1
        if got[0] == "error":
            agree = any(same_error(got, ("error", error.kind, error.texts)) for error in errors)
        else:
            agree = any(same_velocity(got[1], answer) for answer in answers)
        if not agree:
            raise Broken(f"{query}: {got}, the model {errors or answers}", query)

    # What a Buffer has beyond a BufferCore.

    def do_timeout(self, lookup, timeout_ns):
        """Nothing is inserted meanwhile, so that whoever waits gets what a lookup gives."""
        buffer, timeout = self.buffer, Duration(nanoseconds=timeout_ns)
        query = ("timeout", lookup, timeout_ns)
        target, source, ns, *rest = lookup
        if rest:
            fixed, target_ns = rest
            arguments = (target, target_ns, source, ns, fixed)
            calls = buffer.lookup_transform_full, buffer.wait_for_transform_full_async
            can = buffer.can_transform_full
            reasons = self.model.can_full(*arguments)
        else:
            arguments = (target, source, ns)
            calls = buffer.lookup_transform, buffer.wait_for_transform_async
            can, reasons = buffer.can_transform, self.model.can(*arguments)
        wanted = of_model(lambda: self._model_lookup(lookup))
        refused = of_model(lambda: self.model.check_wait(target, source, *rest[:1]))
        got = of_buffer(lambda: as_model_tells(calls[0](*arguments, timeout)))
        waits = timeout_ns > 0 and refused[0] == "error"
        self._compare(query, got, refused if waits else wanted, same_answer)
        self._compare_reason(query, can(*arguments, timeout, return_debug_tuple=True), reasons)
        future = calls[1](*arguments, timeout=timeout)
        until(future.done)
        if refused[0] == "error":
            wanted = refused
        elif wanted[0] == "error":
            texts = [f"Waited 0 s for the transform: {text}" for text in wanted[2]]
            wanted = ("error", "TimeoutException", texts)
        self._compare(query, of_buffer(lambda: as_model_tells(future.result())), wanted, same_answer)

    def do_transform(self, target, source, ns):
        """A registered type."""
        point = PointStamped()
        point.header.frame_id = source
        point.header.stamp.sec, point.header.stamp.nanosec = divmod(ns, S)
        point.point.x, point.point.y, point.point.z = POINT
        wanted = of_model(lambda: self.model.lookup(target, source, ns))
        if wanted[0] == "answer":
            stamp, _, _, xyz, xyzw = wanted[1]
            wanted = ("answer", (stamp, target, added(turned(xyzw, POINT), xyz)))
        elif source == "":
            texts = [f"{text}. The header.frame_id of the PointStamped is empty" for text in wanted[2]]
            wanted = (*wanted[:2], texts)

        def transformed():
            found = self.buffer.transform(point, target)
            return (stamp_ns(found), found.header.frame_id, (found.point.x, found.point.y, found.point.z))

        def same(got, want):
            return got[:2] == want[:2] and same_numbers(got[2], want[2], max(1e3, *map(abs, want[2])))

        self._compare(("transform", target, source, ns), of_buffer(transformed), wanted, same)

    def do_listings(self):
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
            "yaml": (yaml_of(buffer.all_frames_as_yaml()), model.yaml()),
            "dot": (sorted(re.findall(r'"([^"]+)" -> "([^"]+)"', dot)), model.edges()),
            "tree": (buffer.tree(), model.tree()),
        }
        for name in (*model.names, *ODD_NAMES):
            pairs[f"exists {name}"] = (bool(buffer._frameExists(name)), model.exists(name))
            pairs[f"{name} in"] = (name in buffer, name in model.names)
        self.counts["queries"] += len(pairs)
        for name, (got, wanted) in pairs.items():
            if got != wanted:
                raise Broken(f"{name}: {got!r}, the model {wanted!r}", ("listings",))

    # Many queries at once.

    def times(self):
        """All times at which an answer may change, and some between them."""
        stamps = {sample[0] for frame in self.model.frames.values() for sample in frame.samples}
        near = {ns + step for ns in stamps for step in (-1, 0, 1)}
        return sorted(ns for ns in near | {0, -1, 1} if -STAMPS_END <= ns < STAMPS_END)

    def ask(self, dice, full=False):
        """Listings and every pair of frames, at some of the times or at all of them."""
        self.do_listings()
        times, names = self.times(), [*self.model.names, "nowhere"]
        for target in names:
            for source in names:
                self.do_latest(target, source)
                for ns in times if full else {0, *dice.sample(times, min(len(times), 2))}:
                    self.do_lookup(target, source, ns)
        names.append(dice.choice(ODD_NAMES))
        for _ in range(6 * len(names)):
            target, source, fixed = (dice.choice(names) for _ in range(3))
            target_ns, source_ns = dice.choice([0, *times]), dice.choice([0, *times])
            self.do_lookup_full(target, target_ns, source, source_ns, fixed)
        for _ in range(6):
            target, source, fixed = (dice.choice(names) for _ in range(3))
            some = tuple(dice.choices([0, *times], k=5))
            self.do_lookup(target, source, some[0])
            self.do_series(target, source, some)
            self.do_series(target, source, some, fixed, some[0])
            self.do_chain(target, some[0], source, some[1], fixed)
            point = (dice.choice((0.0, 1.0)), -2.0, 0.5)
            references = (dice.choice(names), point, dice.choice(names))
            self.do_velocity(target, source, *references, some[0], dice.choice((0, 1, 2, 3, 10, 1000, S)))
        for _ in range(2):
            lookup = (
                (target, source, some[1])
                if dice.random() < 0.5
                else (target, source, some[1], fixed, some[2])
            )
            self.do_timeout(lookup, dice.choice((0, 1)))
            self.do_transform(target, source, some[1])
            target, source = source, target


def same_velocity(got, want):
    linear, angular, duration = want
    if duration == 0:
        return all(map(math.isnan, (*got[0], *got[1])))
    # Places lie up to kilometres apart; of their difference a part of 10⁻⁹ is divided by the time between.
    tolerance = 1e-6 / duration
    pairs = zip((*got[0], *got[1]), (*linear, *angular), strict=True)
    return all(abs(a - b) <= max(tolerance, RELATIVE * abs(b)) for a, b in pairs)


def yaml_of(text):
    return yaml.load(text, yaml.CSafeLoader) or {}


class Author:
    """Writes one sequence of steps: frames that move on, and mostly stay where they belong."""

    def __init__(self, dice):
        self._dice = dice
        self._frames = FRAMES[: dice.choice((3, 4, 5, 6, 8))]
        self._loops = dice.random() < 0.3
        roots = 0 if self._loops else dice.choice((1, 2, 2, 3))
        self._homes = {child: self._any_parent(child) for child in self._frames[roots:]} or {"b": "a"}
        self._static_share = dice.choice((0.0, 0.05, 0.3))
        self._restless = dice.choice((0.0, 0.05, 0.3))  # how often a frame has another parent
        self._odd = dice.choice((0.0, 0.02, 0.2))  # how often something is invalid
        self._cache_ns = dice.choice((0, 1, 5, 10, 10, 20, 10 * S, 2**62))
        unit = dice.choice((1, 1, 1, self._cache_ns // 10 + 1))  # of the distance between stamps
        self._unit = min(unit, S)
        self._now = dice.choice((0, 1, 30, 30, 1000 * S, STAMPS_END - 100 * self._unit))
        self._newest = {}
        self._last = {}
        self._child = self._frames[-1]

    def steps(self, count):
        yield ("init", self._cache_ns)
        kinds = {
            self._insert: 50,
            self._wait: 25,
            self._end_wait: 6,
            self._clear: 2,
            self._travel: 2,
            self._save: 1,
            self._init: 0.5,
            self._crowd: 0.3,
        }
        for make in self._dice.choices(list(kinds), list(kinds.values()), k=count - 1):
            yield make()

    def _any_parent(self, child):
        # Without loops each frame hangs from one that comes before it.
        index = self._frames.index(child)
        before = self._frames[:index]
        return self._dice.choice(
            before if before and not self._loops else [f for f in self._frames if f != child]
        )

    def _insert(self):
        dice = self._dice
        count = 1 if dice.random() < 0.8 else dice.randint(0, 6)
        kind = dice.choice(("set", "set", "list", "cdr"))
        way = kind
        if dice.random() < self._static_share:
            way = "static" if kind == "set" else f"static {kind}"
        if count > 1 and way in ("set", "static"):
            way = "list"
        return ("insert", way, tuple(self._link() for _ in range(count)), dice.choice(AUTHORITIES))

    def _crowd(self):
        """More samples of one stamp than are kept."""
        parent, child, ns, _, turn = self._link()
        some = self._dice.sample(range(100, 200), self._dice.randint(60, 70))
        return ("insert", "list", tuple((parent, child, ns, x, turn) for x in some), "crowd")

    def _link(self):
        dice = self._dice
        if dice.random() < 0.5:
            self._child = dice.choice(list(self._homes))
        child = self._child
        parent = self._homes.get(child, self._frames[0])
        if dice.random() < self._restless:
            parent = self._any_parent(child)
        if child in self._last and dice.random() < 0.1:
            link = self._last[child]  # repeated, or another of the same stamp
            return link if dice.random() < 0.5 else (*link[:3], dice.randrange(GOOD_PLACES), link[4])
        x, turn = dice.randrange(GOOD_PLACES), dice.randrange(GOOD_TURNS)
        ns = self._stamp(child)
        if dice.random() < self._odd:
            what = dice.randrange(5)
            if what == 0:
                child = dice.choice((*ODD_NAMES, parent))
            elif what == 1:
                parent = dice.choice(ODD_NAMES)
            elif what == 2:
                x = dice.randrange(len(PLACES))
            elif what == 3:
                turn = dice.randrange(len(TURNS))
            else:
                ns = dice.choice((-1, 0, -S, STAMPS_END - 1, STAMPS_END, 2**63 - 1))
        link = self._last[child] = (parent, child, ns, x, turn)
        return link

    def _stamp(self, child):
        dice, unit = self._dice, self._unit
        newest = self._newest.get(child, self._now)
        edge = newest - self._cache_ns
        kind = dice.random()
        if kind < 0.65:
            self._now = ns = self._now + unit * dice.randint(0, 2)
        elif kind < 0.7 and self._cache_ns < 100 * S:
            self._now = ns = self._now + self._cache_ns + dice.randint(-1, 2)  # leaves nothing but this one
        elif kind < 0.8:
            ns = dice.randint(max(edge, newest - 20 * unit), newest)  # late
        elif kind < 0.9:
            ns = edge + dice.randint(-2, 2)
        else:
            ns = newest - unit * dice.randint(0, 20)
        self._now = min(self._now, STAMPS_END - 1)
        ns = max(0, min(ns, STAMPS_END - 1))
        self._newest[child] = max(ns, newest)
        return ns

    def _wait(self):
        dice = self._dice
        lookup = (self._name(), self._name(), self._time())
        if dice.random() < 0.5:
            lookup = (self._homes.get(self._child, "a"), self._child, self._time())
        if dice.random() < 0.3:
            lookup = (*lookup, self._name(), self._time())
        return ("wait", dice.choice(WAITS), lookup)

    def _name(self):
        return self._dice.choice(ODD_NAMES if self._dice.random() < 0.03 else self._frames)

    def _time(self):
        dice, unit = self._dice, self._unit
        ns = self._now + dice.choice(
            (0, unit * dice.randint(0, 4), unit * dice.randint(0, 4), -unit * dice.randint(0, 20), 1)
        )
        return 0 if dice.random() < 0.3 else max(-5, min(ns, STAMPS_END - 1))

    def _end_wait(self):
        return (self._dice.choice(("cancel", "drop")), self._dice.randrange(MOST_PENDING))

    def _clear(self):
        return ("clear",)

    def _travel(self):
        return ("travel", self._dice.choice(("pickle", "copy", "deepcopy")))

    def _save(self):
        return (self._dice.choice(("save", "restore")),)

    def _init(self):
        return ("init", self._cache_ns)


def run(steps, make_pair=Pair):
    """Take the steps in a new pair: None, or what is broken after the last one that was taken."""
    pair = make_pair()
    for number, step in enumerate(steps):
        try:
            pair.take(step)
        except Exception as broken:
            told = broken if isinstance(broken, AssertionError) else repr(broken)
            return f"after step {number}, {step}: {told}"
    return None


def search(seed, is_over, make_pair=Pair, steps_of_one=80):
    """
    Take sequences of steps, and ask after each step, until `is_over()`.

    Returns
    -------
    counts : Counter
        Of sequences, steps, queries and their outcomes.
    broken : None or (str, list)
        What is broken, and the shortest sequence found that shows it.
    """
    counts = Counter()
    while not is_over():
        dice = random.Random(f"{seed}, {counts['sequences']}")
        pair, taken = make_pair(), []
        for step in Author(dice).steps(steps_of_one):
            taken.append(step)
            try:
                pair.take(step)
                pair.ask(random.Random(len(taken)), full=len(taken) == steps_of_one)
            except Exception as broken:
                found = shortest(taken, broken, make_pair)
                return counts + pair.counts, (f"seed {seed}, {found[0]}", found[1])
            counts["steps"] += 1
        counts["sequences"] += 1
        counts += pair.counts
    return counts, None


def shortest(taken, broken, make_pair=Pair):
    """What is broken, and the shortest sequence found that shows it, of the steps that led there."""
    steps = taken + [broken.query] if getattr(broken, "query", None) else taken
    if not run(steps, make_pair):
        return f"not again: {broken!r}", steps
    single = singles(steps)
    steps = shrink(single if run(single, make_pair) else steps, lambda steps: run(steps, make_pair))
    return run(steps, make_pair), steps


def singles(steps):
    """The same with one link in each insert."""
    single = []
    for step in steps:
        if step[0] == "insert":
            single += [("insert", step[1], (link,), step[3]) for link in step[2]]
        else:
            single.append(step)
    return single

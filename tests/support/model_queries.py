"""Queries that a buffer and the model must answer alike; each is a step of a pair."""

import itertools
import math
import re
from functools import partial

import numpy as np
import yaml
from geometry_msgs.msg import PointStamped
from making import S, stamp_ns
from model import STAMPS_END, Policy
from model_answers import (
    Broken,
    as_model_tells,
    of_buffer,
    of_model,
    require,
    same_answer,
    same_error,
    same_numbers,
    same_rotation,
    same_velocity,
    without_advice,
)
from model_links import ODD_NAMES
from model_math import added, turned
from processes import until
from rclpy.duration import Duration

POINT = (0.5, -1.0, 2.0)
POLICIES = (Policy(2), Policy(3, True), Policy(max_gap=2), Policy(50, True, 4))


class Queries:
    """A buffer and a model; what takes steps and waits is a `Pair`."""

    def __init__(self, buffer, model):
        self.buffer, self.model = buffer, model

    def _model_lookup(self, lookup):
        target, source, ns, *rest = lookup
        if not rest:
            return self.model.lookup(target, source, ns)
        fixed, target_ns = rest
        return self.model.lookup_full(target, target_ns, source, ns, fixed)

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

    def _compare(self, query, got, wanted, same):
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
            got = of_buffer(
                lambda: self.buffer.lookup_transforms(target, source, rows, on_missing="nan", **more)
            )
            if is_name:
                self._compare(query, got, first, None)
                return
            arrays = got[1]
        else:
            require(got[0] == "answer", "a series without an answer", query, got)
            arrays = got[1]
        for i, want in enumerate(wanted):
            row = tuple(arrays[0][i]), tuple(arrays[1][i])
            if want[0] == "error":
                agree = all(math.isnan(a) for a in (*row[0], *row[1]))
            else:
                agree = same_answer((*want[1][:3], *row), want[1])
            if not agree:
                raise Broken(f"{query}, row {i}: {row}, the model {want}", query)

    def do_policy(self, policy, target, source, times):
        """Lookups that accept more than tf2's, one by one and in one call; of errors the kind is compared."""
        options = {
            "tolerance": Duration(nanoseconds=policy.tolerance),
            "extrapolate": policy.extrapolate,
            "max_gap": None if policy.max_gap is None else Duration(nanoseconds=policy.max_gap),
        }
        query = ("policy", policy, target, source, times)
        rows = of_buffer(
            lambda: self.buffer.lookup_transforms(target, source, times, on_missing="nan", **options)
        )
        for i, ns in enumerate(times):
            wanted = of_model(lambda ns=ns: self.model.lookup_under(policy, target, source, ns))
            got = of_buffer(
                lambda ns=ns: as_model_tells(self.buffer.lookup_transform(target, source, ns, **options))
            )
            self._compare(query, got, (*wanted[:2], got[2:]) if wanted[0] == "error" else wanted, same_answer)
            if rows[0] == "error":
                require(got[:2] == rows[:2], "another error of many times", query, rows, got)
                continue
            row = (*rows[1][0][i], *rows[1][1][i])
            agree = all(map(math.isnan, row)) if got[0] == "error" else row == (*got[1][3], *got[1][4])
            require(agree, "other numbers of many times", query, row, got)

    def _ask_at_the_ends_of_policies(self, dice):
        for name, frame in self.model.frames.items():
            for older, newer in itertools.pairwise(frame.samples[-4:]):
                policy = Policy(max_gap=max(0, newer[0] - older[0] - dice.randrange(2)))
                self.do_policy(policy, older[1], name, ((older[0] + newer[0]) // 2,))
            if frame.samples and frame.newest_ns() < STAMPS_END - 10:
                policy = Policy(dice.randrange(1, 5), dice.random() < 0.5)
                end = frame.newest_ns() + policy.tolerance
                self.do_policy(policy, frame.newest_parent(), name, (end - 1, end, end + 1))

    def do_relatives(self, name, other, ns):
        for call, *arguments in (("parent", name, ns), ("children", name), ("path", other, name, ns)):
            got = of_buffer(partial(getattr(self.buffer, call), *arguments))
            wanted = of_model(partial(getattr(self.model, call), *arguments))
            self._compare(("relatives", name, other, ns), got, wanted, lambda a, b: a == b)

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
        else:
            arguments = (target, source, ns)
            calls = buffer.lookup_transform, buffer.wait_for_transform_async
            can = buffer.can_transform
        wanted = of_model(lambda: self._model_lookup(lookup))
        refused = of_model(lambda: self.model.check_wait(target, source, *rest[:1]))
        got = of_buffer(lambda: as_model_tells(calls[0](*arguments, timeout)))
        told = refused if timeout_ns > 0 and refused[0] == "error" else wanted
        self._compare(query, got, told, same_answer)
        reasons = (True, "") if told[0] == "answer" else (False, *told[2])
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
        for name, (got, wanted) in pairs.items():
            if got != wanted:
                raise Broken(f"{name}: {got!r}, the model {wanted!r}", ("listings",))

    def do_histories(self):
        found = self.buffer.histories()
        held = {name: frame for name, frame in self.model.frames.items() if frame.samples}
        require(set(found) == set(held), "histories of other frames", set(found), set(held))
        for name, frame in held.items():
            one, (stamps, parents, places, turns) = found[name], zip(*frame.samples, strict=True)
            got = (one.frame, one.static, one.parents.tolist(), one.stamps_ns.tolist())
            require(got == (name, frame.static, [*parents], [*stamps]), "another history", got, frame.samples)
            require(one.translations.tolist() == [*map(list, places)], "other places", name, places)
            pairs = zip(one.rotations.tolist(), turns, strict=True)
            require(all(same_rotation(q, turn) for q, turn in pairs), "other turns", name, turns)

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
        self.do_listings()
        self.do_histories()
        times, names = self.times(), [*self.model.names, "nowhere"]
        for target in names:
            for source in names:
                self.do_latest(target, source)
                for ns in {0, *dice.sample(times, min(len(times), 2))}:
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
            self.do_policy(dice.choice(POLICIES), target, source, some)
            self.do_relatives(source, target, some[2])
            point = (dice.choice((0.0, 1.0)), -2.0, 0.5)
            references = (dice.choice(names), point, dice.choice(names))
            self.do_velocity(target, source, *references, some[0], dice.choice((0, 1, 2, 3, 10, 1000, S)))
        self._ask_at_the_ends_of_policies(dice)
        for _ in range(2):
            lookup = (
                (target, source, some[1])
                if dice.random() < 0.5
                else (target, source, some[1], fixed, some[2])
            )
            self.do_timeout(lookup, dice.choice((0, 1)))
            self.do_transform(target, source, some[1])
            target, source = source, target


def yaml_of(text):
    return yaml.load(text, yaml.CSafeLoader) or {}

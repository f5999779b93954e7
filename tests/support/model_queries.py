"""Queries that a buffer and the model must answer alike."""

import itertools
import math
import operator
import re

import yaml
from making import S
from model import STAMPS_END, Policy
from model_answers import (
    as_model_tells,
    of_buffer,
    of_model,
    require,
    same_answer,
    same_error,
    same_rotation,
    same_velocity,
    without_advice,
)
from model_links import ODD_NAMES
from rclpy.duration import Duration

POLICIES = (Policy(2), Policy(3, True), Policy(max_gap=2), Policy(50, True, 4))


class Queries:
    """A buffer and a model; what changes them is a `Pair`."""

    def __init__(self, buffer, model):
        self.buffer, self.model = buffer, model

    def compare(self, query, got, wanted, same=operator.eq):
        is_error = got[0] == wanted[0] == "error"
        agree = same_error(got, wanted) if is_error else got[0] == wanted[0] and same(got[1], wanted[1])
        require(agree, "the model answers otherwise", query, got, wanted)

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
        require(agree, "other reasons", query, got, wanted)

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
                require(got[:2] == rows[:2], "another error of many times", query, rows, got)
                continue
            row = (*rows[1][0][i], *rows[1][1][i])
            agree = all(map(math.isnan, row)) if got[0] == "error" else row == (*got[1][3], *got[1][4])
            require(agree, "other numbers of many times", query, row, got)
        agree = all_or_error[0] == "answer" if failed is None else all_or_error == failed
        require(agree, "the first error is not that of many times", query, all_or_error, failed)

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
        require(agree, "the model has another velocity", query, got, errors or answers)

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
            require(got == wanted, "the model lists otherwise", name, got, wanted)

    def histories(self):
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

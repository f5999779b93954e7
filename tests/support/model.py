# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Owns a slow and obvious model of a tf2 buffer: lists, dicts and tuples.

It follows the C++ of ROS 2 Jazzy (`buffer_core.cpp`, `cache.cpp`) and what `docs/differences.md` says is
different here, and shares nothing with this project's own code. Times are nanoseconds, vectors x y z,
rotations x y z w.
"""

import math
import sys

from model_explanations import Explanations
from model_listings import Listings
from model_math import (
    IDENTITY,
    added,
    canonical,
    composed,
    conjugate,
    cross,
    difference,
    inverse,
    product,
    slerp,
    turned,
)
from model_policies import Policies
from model_terms import (
    NEWEST,
    RESERVED,
    STAMPS_END,
    TF2,
    ModelError,
    S,
    limit_of,
    require_stamps,
    seconds,
    span,
)

MOST_OF_ONE_STAMP = 64  # samples; then the newest replaces the one before it
MOST_HOPS = 1000  # from a frame up to the common ancestor
REASONS = (
    "self_transform",
    "no_frame_id",
    "no_child_frame_id",
    "nan_input",
    "denormalized_quaternion",
    "infinite_input",
    "negative_stamp",
    "reserved_frame_id",
    "old_data",
    "stamp_too_late",
    "too_many_bytes",
    "other_kind",
    "replaced_together",
)


class Gap(Exception):
    """A frame has no data at a time: the text of tf2, and what is said after it."""

    def __init__(
        self,
        text,
        addition,
        missing=math.inf,
        newest_ns=0,
        from_1970=False,
        is_late=False,
        time=None,
        data_from_1970=False,
        stamp=None,
    ):
        super().__init__(text, addition)
        self.text, self.addition, self.time = text, addition, time
        self.missing, self.newest_ns, self.from_1970 = missing, newest_ns, from_1970
        self.data_from_1970, self.stamp = data_from_1970, stamp
        self.is_late = is_late  # the sample follows the time


def gap(name, time, sample, text, which, newest_ns):
    """That of a frame without data at a time, which a sample is next to."""
    stamp, parent = sample[:2]
    missing = abs(time - stamp)
    how = "too new" if stamp > time else "too old"
    sample_text = f"the {which} sample of {name} (parent {parent}) at {seconds(stamp)}"
    addition = f"{sample_text} is {span(missing)} {how}"
    year = 365 * 86400 * 10**9
    from_1970 = 0 < time < year and stamp > 30 * year
    data_from_1970 = 0 <= stamp < year and time > 30 * year
    return Gap(
        f"extrapolation {text}",
        addition,
        missing,
        newest_ns,
        from_1970,
        stamp > time,
        time,
        data_from_1970,
        stamp,
    )


def interpolated(older, newer, ns):
    stamp, parent, xyz, xyzw = older
    next_stamp, _, next_xyz, next_xyzw = newer
    ratio = (ns - stamp) / (next_stamp - stamp)
    between = tuple(a + ratio * (b - a) for a, b in zip(xyz, next_xyz, strict=True))
    return (parent, (between, slerp(xyzw, next_xyzw, ratio)))


class Frame:
    """A frame that was ever a child."""

    def __init__(self, static):
        self.static = static
        self.samples = []  # (stamp, parent, xyz, xyzw): by stamp, those of equal stamp as they arrived

    def newest_ns(self):
        return 0 if self.static or not self.samples else self.samples[-1][0]

    def oldest_ns(self):
        return 0 if self.static or not self.samples else self.samples[0][0]

    def newest_parent(self):
        return self.samples[-1][1] if self.samples else None

    def used_ns(self, name, time, policy):
        """The stamp of the data for a time, and whether it is carried on from there."""
        tolerance = limit_of(policy.tolerance, name, 0)
        late = not self.static and self.samples and 0 < time - self.newest_ns() <= tolerance
        return (self.newest_ns(), policy.extrapolate) if late else (time, False)

    def data_under(self, name, time, policy):
        used_ns, carried_on = (time, False) if time == NEWEST else self.used_ns(name, time, policy)
        if not carried_on:
            return self.data_at(name, used_ns)
        before, last = self.samples[-2:] if len(self.samples) > 1 else self.samples * 2
        if before[0] == last[0] or before[1] != last[1]:
            return (last[1], last[2:])
        return interpolated(before, last, time)

    def is_torn(self, name, time, policy):
        """Whether the samples around the time are further apart than accepted."""
        if self.static or policy.max_gap is None:
            return False
        time, _ = self.used_ns(name, time, policy)
        stamps = [sample[0] for sample in self.samples]
        before, after = [ns for ns in stamps if ns <= time], [ns for ns in stamps if ns > time]
        return time not in stamps and after[0] - before[-1] > policy.max_gap

    def data_at(self, name, time):
        """The parent, and the transform to it. Raises a Gap."""
        samples = self.samples
        if not samples:
            text = "" if time == NEWEST else f" at time {seconds(time)}"
            raise Gap(f"extrapolation{text}", f"the buffer has no sample of {name}")
        first, last = samples[0], samples[-1]
        if self.static or time in (NEWEST, last[0]):
            return (last[1], last[2:])
        if len(samples) == 1:
            tf2s = f"at time {seconds(time)}, but only time {seconds(last[0])} is in the buffer"
            raise gap(name, time, last, tf2s, "only", last[0])
        if time == first[0]:
            return (first[1], first[2:])
        requested = f"Requested time {seconds(time)} but the"
        if time > last[0]:
            tf2s = f"into the future.  {requested} latest data is at time {seconds(last[0])}"
            raise gap(name, time, last, tf2s, "newest", last[0])
        if time < first[0]:
            tf2s = f"into the past.  {requested} earliest data is at time {seconds(first[0])}"
            raise gap(name, time, first, tf2s, "oldest", last[0])
        older = [sample for sample in samples if sample[0] <= time][-1]
        newer = [sample for sample in samples if sample[0] > time][0]
        if older[1] == newer[1]:
            return interpolated(older, newer, time)
        return (older[1], older[2:])

    def parents(self):
        return {sample[1] for sample in self.samples}


class Model(Listings, Policies, Explanations):
    def __init__(self, cache_ns=10 * S):
        self.cache_ns = cache_ns
        self.order = []  # names, by first use
        self.hidden = set()  # those that nothing mentions since a frame was forgotten
        self.frames = {}  # by name; those that were ever a child
        self.authorities = {}
        self.taken = self.displaced = 0
        self.refused = dict.fromkeys(REASONS, 0)
        self._found = {}  # what data_at() answered since the last change

    # Inserting.

    def insert(self, parent, child, ns, xyz, xyzw, authority, static=False, is_full=False):
        """Whether it is taken. A full buffer knows all names, and has no memory for another sample."""
        self._found.clear()
        parent, child = parent.removeprefix("/"), child.removeprefix("/")
        wrong = self._wrong(parent, child, ns, xyz, xyzw)
        if wrong:
            self._refuse(wrong)
            return False
        self._name(child)
        frame = self.frames.get(child)
        self._name(parent)
        if frame is None or frame.static != static:
            if is_full:
                self._refuse(["too_many_bytes"])
                return False
            frame = self.frames[child] = Frame(static)
        sample = self._sample(parent, ns, xyz, xyzw)
        if static:
            frame.samples = [sample]
        elif why := self._insert_dynamic(frame, sample, is_full):
            self._refuse([why])
            return False
        self.authorities[child] = authority
        self.taken += 1
        return True

    def replace(self, links, authority, static=False, displaced=0):
        """
        How many are taken of some (parent, child, ns, xyz, xyzw), which replace what lies between them; and
        the oldest ``displaced`` of all samples make room.
        """
        self._found.clear()
        by_child = {}
        for parent, child, *rest in links:
            by_child.setdefault(child.removeprefix("/"), []).append((parent.removeprefix("/"), *rest))
        self.displaced += displaced
        return sum(
            self._replace(child, given, authority, static, displaced) for child, given in by_child.items()
        )

    def _replace(self, child, given, authority, static, displaced):
        wrong = [self._wrong(parent, child, *rest) for parent, *rest in given]
        if not any(wrong) and self._is_of_other_kind(self.frames.get(child), static):
            wrong = [["other_kind"]] * len(given)  # before the names become known
        if not any(wrong):
            given = given if static else sorted(given, key=lambda one: one[1])
            for name in (child, *[one[0] for one in given]):
                self._name(name)
            wrong = self._wrong_beside(self.frames.get(child), given, static)
        if any(wrong):
            for reasons in wrong:
                self._refuse(reasons or ["replaced_together"])
            return 0
        samples = {0 if static else one[1]: self._sample(*one) for one in given}  # of equal stamps, the last
        frame = self.frames.get(child)
        if frame is None or not frame.samples:
            frame = self.frames[child] = Frame(static)
        if static:
            frame.samples = [*samples.values()]
        else:
            first, last = given[0][1], given[-1][1]
            kept = [one for one in frame.samples if not first <= one[0] <= last]
            frame.samples = sorted(kept + [*samples.values()], key=lambda one: one[0])
            oldest_kept = frame.newest_ns() - self.cache_ns
            frame.samples = [one for one in frame.samples if one[0] >= oldest_kept]
            assert displaced < len(frame.samples)
            frame.samples = frame.samples[displaced:]
        self.authorities[child] = authority
        self.taken += len(given)
        return len(given)

    def _is_of_other_kind(self, frame, static):
        return frame is not None and bool(frame.samples) and frame.static != static

    def _wrong_beside(self, frame, given, static):
        """What is wrong with each of them, because of what the frame has."""
        if static:
            return []
        has_some = frame is not None and frame.samples
        newest_ns = max(given[-1][1], frame.newest_ns() if has_some else 0)
        return [["old_data"] if one[1] < newest_ns - self.cache_ns else [] for one in given]

    def refuse_all(self, links, reason):
        """Their names become known."""
        for parent, child, *_ in links:
            self._name(child)
            self._name(parent)
            self._refuse([reason])

    def _refuse(self, reasons):
        for reason in reasons:
            self.refused[reason] += 1

    def _sample(self, parent, ns, xyz, xyzw):
        length = math.sqrt(sum(a * a for a in xyzw))
        return (ns, parent, tuple(xyz), canonical(tuple(a / length for a in xyzw)))

    def _wrong(self, parent, child, ns, xyz, xyzw):
        """Why every buffer refuses it."""
        squared = sum(a * a for a in xyzw)
        numbers = (*xyz, *xyzw)
        wrong = {
            "self_transform": parent == child,
            "no_frame_id": parent == "",
            "no_child_frame_id": child == "",
            "nan_input": any(map(math.isnan, numbers)),
            "denormalized_quaternion": not sys.float_info.min <= squared < math.inf,
            "infinite_input": any(map(math.isinf, xyz)) and not any(map(math.isnan, numbers)),
            "negative_stamp": ns < 0,
            "reserved_frame_id": RESERVED in (parent, child),
            "stamp_too_late": ns >= STAMPS_END,
        }
        return [reason for reason, applies in wrong.items() if applies]

    @property
    def names(self):
        return [name for name in self.order if name not in self.hidden]

    def _name(self, name):
        self.hidden.discard(name)
        if name not in self.order:
            self.order.append(name)

    def _insert_dynamic(self, frame, sample, is_full):
        """Why it is refused, or None."""
        oldest_kept = frame.newest_ns() - self.cache_ns
        frame.samples = [kept for kept in frame.samples if kept[0] >= oldest_kept]
        ns = sample[0]
        if frame.samples and ns < oldest_kept:
            return "old_data"
        before = [kept for kept in frame.samples if kept[0] < ns]
        same = [kept for kept in frame.samples if kept[0] == ns]
        after = [kept for kept in frame.samples if kept[0] > ns]
        if is_full and not before + same:
            return "too_many_bytes"
        if sample not in same:
            if len(same) >= MOST_OF_ONE_STAMP:
                same.pop()
            same.append(sample)
        frame.samples = (before + same + after)[is_full:]
        self.displaced += is_full
        return None

    def clear(self):
        self._found.clear()
        for frame in self.frames.values():
            if not frame.static:
                frame.samples = []

    def forget(self, name):
        """Whether the frame had samples."""
        if name not in self.names:
            return False
        self._found.clear()
        forgotten = self.frames.pop(name, None)
        named = set().union(*[frame.parents() for frame in self.frames.values()])
        self.hidden |= set(self.order) - named - set(self.frames)
        return forgotten is not None and forgotten.samples != []

    def travel(self):
        """Become what a copy is: the samples, and the names that these need."""
        self._found.clear()
        self.frames = {
            name: self.frames[name]
            for name in self.names
            if name in self.frames and self.frames[name].samples
        }
        parents = {sample[1] for frame in self.frames.values() for sample in frame.samples}
        self.order = [name for name in self.order if name in parents or name in self.frames]
        self.hidden = set()
        self.taken, self.displaced = sum(len(frame.samples) for frame in self.frames.values()), 0
        self.refused = dict.fromkeys(REASONS, 0)

    # Names.

    def exists(self, name):
        return name == RESERVED or name in self.names

    def _unknown(self):
        if self.names:
            return ""
        why = "" if self.taken else ": it has no TransformListener and nothing was inserted"
        return f". The buffer is empty{why}"

    def _check_name(self, call, name):
        if name == "":
            wrong = "cannot be empty"
            if call.endswith(" source_frame"):
                wrong += "; was header.frame_id of a message never set?"
        elif name.startswith("/"):
            wrong = "cannot start with a '/'"
        elif name not in self.names:
            raise ModelError("LookupException", f'"{name}" passed to {call} does not exist{self._unknown()}')
        else:
            return
        raise ModelError(
            "InvalidArgumentException",
            f'Invalid argument "{name}" passed to {call} - in tf2 frame_ids {wrong}',
        )

    def _check_names(self, call, **names):
        for argument, name in names.items():
            self._check_name(f"{call} argument {argument}", name)

    def _require_frame(self, call, name):
        """Also a name that lookups refuse, such as that of the frame "//b", which is known as "/b"."""
        if name not in self.names:
            self._check_names(call, frame=name)

    # Looking up.

    def lookup(self, target, source, ns):
        """(stamp, target, source, translation, rotation)."""
        require_stamps(ns)
        if target == source:
            frame = self.frames.get(target)
            stamp = frame.newest_ns() if ns == 0 and frame is not None else ns
            return (stamp, target, source, *IDENTITY)
        self._check_names("lookupTransform", target_frame=target, source_frame=source)
        stamp, found = self._transform(target, source, ns)
        return self._answer(stamp, target, source, found)

    def lookup_full(self, target, target_ns, source, source_ns, fixed):
        require_stamps(target_ns, source_ns)
        self._check_names("lookupTransform", target_frame=target, source_frame=source, fixed_frame=fixed)
        _, fixed_from_source = self._transform(fixed, source, source_ns)
        stamp, target_from_fixed = self._transform(target, fixed, target_ns)
        return self._answer(stamp, target, source, composed(target_from_fixed, fixed_from_source))

    def _answer(self, stamp, target, source, found):
        return (stamp, target, source, found[0], canonical(found[1]))

    def _transform(self, target, source, ns):
        """Of names that are known: the stamp and the transform."""
        if target == source:
            frame = self.frames.get(target)
            return (frame.newest_ns() if ns == 0 and frame is not None else ns), IDENTITY
        stamp, found, *_ = self._walk_asked(target, source, ns)
        return stamp, found

    def can(self, target, source, ns):
        return self._reason(lambda: self.lookup(target, source, ns))

    def can_full(self, target, target_ns, source, source_ns, fixed):
        def look_up():
            require_stamps(target_ns, source_ns)
            self._check_names("lookupTransform", target_frame=target, source_frame=source, fixed_frame=fixed)
            self._transform(target, fixed, target_ns)
            self._transform(fixed, source, source_ns)

        return self._reason(look_up)

    def _reason(self, look_up):
        """(1, ""), or 0 and the texts in the form of a canTransform."""
        try:
            look_up()
        except ModelError as error:
            if error.kind == "OverflowError":
                raise
            return (0, *map(as_reason, error.texts))
        return (1, "")

    def latest(self, target, source):
        names = {"target_frame": target, "source_frame": source}
        self._check_names("get_latest_common_time", **names)
        if target == source:
            return self.frames[target].newest_ns() if target in self.frames else 0
        try:
            return self._latest(target, source)
        except ModelError as error:
            raise ModelError("TransformException", *error.texts) from None

    def _latest(self, target, source):
        """tf2's getLatestCommonTime, which leaves out the stamp 0."""
        stamps = [self.frames[name].newest_ns() for name in self._newest_hops(target, source)]
        return min([ns for ns in stamps if ns != 0], default=0)

    def time_range(self, target, source):
        """Of the times from 1 on, those without a break up to the latest; and 0, if there is data since."""
        self._check_names("time_range", target_frame=target, source_frame=source)
        if target == source:
            return 0, STAMPS_END - 1
        latest = self._latest(target, source)
        _, _, *hops = self._walk_asked(target, source, 0)
        last = latest if self._oldest_stamps(*hops) else STAMPS_END - 1
        if last == 0:
            return 0, 0
        first = last
        for time in sorted(self._times_of_changes(), reverse=True):
            if time <= last:
                try:
                    _, *hops = self._walk(target, source, time)
                except ModelError:
                    break
                first = time
        if first == 1 and not any(self._oldest_stamps(*hops)):
            first = 0
        return first, last

    def _oldest_stamps(self, chain, top):
        """Of the moving frames on a path."""
        hops = [self.frames[name] for name in chain[:top] + chain[top + 1 :]]
        return [frame.oldest_ns() for frame in hops if not frame.static]

    def _times_of_changes(self):
        """Times between which every frame keeps its parent, or the lack of one."""
        stamps = {sample[0] for frame in self.frames.values() for sample in frame.samples}
        near = {1, STAMPS_END - 1} | {ns + step for ns in stamps for step in (-1, 0, 1)}
        return [ns for ns in near if 0 < ns < STAMPS_END]

    def _newest_hops(self, target, source):
        """The frames from the source up and down to the target, by the newest sample of each."""
        upwards, frame = [], source
        while self._newest_parent(frame) is not None:
            upwards.append(frame)
            frame = self._newest_parent(frame)
            if frame == target:
                return upwards
            if frame in upwards:
                raise self._loop(target, source)
        parents = [self._newest_parent(frame) for frame in upwards]
        downwards, frame = [], target
        while self._newest_parent(frame) is not None:
            downwards.append(frame)
            frame = self._newest_parent(frame)
            if frame in parents:
                return upwards[: parents.index(frame) + 1] + downwards[::-1]
            if frame == source:
                return downwards[::-1]
            if frame in downwards:
                raise self._loop(target, source)
        raise self._unconnected(target, source, frame, [source, *parents][-1])

    def data_at(self, name, time, policy=TF2):
        """(parent, transform to it), None for a root, or the Gap."""
        key = (name, time, policy)
        if key not in self._found:
            try:
                found = self.frames[name].data_under(name, time, policy) if name in self.frames else None
            except Gap as gap:
                found = gap
            self._found[key] = found
        return self._found[key]

    def _walk_asked(self, target, source, ns, policy=TF2):
        """The stamp and the walk at a time that a program passed; 0 is the latest common time."""
        stamp = ns or self._latest(target, source)
        return stamp, *self._walk(target, source, stamp or NEWEST, policy, is_latest=ns == 0)

    def _walk(self, target, source, time, policy=TF2, is_latest=False):
        """tf2's walkToTopParent: the transform, the frames from source to target, the index of the top."""
        # From the source to its root, or to its first gap.
        to_top, frame, passed, source_gap = IDENTITY, source, [], None
        while True:
            passed.append(frame)
            data = self.data_at(frame, time, policy)
            if data is None or isinstance(data, Gap):
                source_gap = data
                break
            if frame == target:
                return self._found_path(target, source, to_top, passed, [])
            to_top = composed(data[1], to_top)
            frame = data[0]
            if frame in passed:
                raise self._loop(target, source)
        # From the target to there.
        top, source_to_top = frame, to_top
        to_top, frame, passed_down = IDENTITY, target, []
        while frame != top:
            passed_down.append(frame)
            data = self.data_at(frame, time, policy)
            if data is None:
                break
            if isinstance(data, Gap):
                raise self._extrapolation(target, source, time, [source_gap, data], is_latest)
            if frame == source:
                return self._found_path(target, source, inverse(to_top), [], passed_down)
            to_top = composed(data[1], to_top)
            frame = data[0]
            if frame in passed_down:
                raise self._loop(target, source)
        if frame != top:
            if source_gap is not None:
                raise self._extrapolation(target, source, time, [source_gap, None], is_latest)
            raise self._unconnected(target, source, frame, top)
        transform = composed(inverse(to_top), source_to_top)
        return self._found_path(target, source, transform, passed, passed_down)

    def _found_path(self, target, source, transform, upwards, downwards):
        chain = without_detours(upwards + downwards[::-1])
        top = [frame for frame in chain if frame in upwards][-1:] or chain[:1]
        index = chain.index(top[0])
        if index > MOST_HOPS or len(chain) - 1 - index > MOST_HOPS:
            raise self._loop(target, source)
        return transform, chain, index

    # Errors.

    def _loop(self, target, source):
        return ModelError(
            "LookupException",
            f"The tf tree is invalid because it contains a loop, or more than {MOST_HOPS} hops in a row, "
            f"between frame [{source}] and frame [{target}]",
        )

    def _unconnected(self, target, source, target_root, source_root):
        return ModelError(
            "ConnectivityException",
            f"Could not find a connection between '{target}' and '{source}' because they are not part of "
            "the same tree. Tf has two or more unconnected trees. "
            f"The root of {target} is {target_root}; the root of {source} is {source_root}.",
        )

    def _extrapolation(self, target, source, time, gaps, is_latest):
        """tf2 names one of the gaps of its walks; here they are those on the path, if that is known."""
        met = [[gap] if gap else [] for gap in gaps]
        limiting = self._limiting(target, source, time) if is_latest else None
        of_tf2 = extrapolation_text(target, source, *met, limiting, self.now_ns)
        known = self._gaps_on_path(target, source, time)
        texts = [extrapolation_text(target, source, *known, limiting, self.now_ns)] if known else []
        if not known:
            texts.append(of_tf2)
        return ModelError("ExtrapolationException", *texts, of_tf2=of_tf2)

    def _limiting(self, target, source, time):
        """The latest common time, and the frame because of which it is no later."""
        hops = self._newest_hops(target, source)
        name = next((hop for hop in hops if self.frames[hop].newest_ns() == time), None)
        return f"The latest common time is {seconds(time)} because {name}"

    def _gaps_on_path(self, target, source, time):
        """Those from the source up, and those from the target up; None if the path is unknown."""
        up = self._known_chain(source, target, time)
        down = self._known_chain(target, source, time)
        if up is None or (up[-1] != target and (down is None or down[-1] not in (source, up[-1]))):
            return None
        if up[-1] == target:
            sides = up[:-1], []
        elif down[-1] == source:
            sides = [], down[:-1]
        else:
            common = next(frame for frame in up if frame in down)
            sides = up[: up.index(common)], down[: down.index(common)]
        found = [[self.data_at(frame, time) for frame in side] for side in sides]
        gaps = [[data for data in side if isinstance(data, Gap)] for side in found]
        return gaps if any(gaps) else None

    def _known_chain(self, frame, end, time):
        """
        Upwards to `end`, or as far as parents are known: at the time, or because a frame has never had
        another one. None: they lead round in a loop.
        """
        chain = []
        while frame is not None and end not in chain:
            if frame in chain:
                return None
            chain.append(frame)
            parents = self.frames[frame].parents() if frame in self.frames else set()
            data = self.data_at(frame, time)
            if len(parents) == 1:
                frame = min(parents)
            else:
                frame = None if data is None or isinstance(data, Gap) else data[0]
        return chain

    # Relatives, chains and velocities.

    def parent(self, name, ns):
        require_stamps(ns)
        self._require_frame("parent", name)
        data = self.data_at(name, ns or NEWEST)
        return None if data is None or isinstance(data, Gap) else data[0]

    def children(self, name):
        self._require_frame("children", name)
        return [child for child in self.names if self._newest_parent(child) == name]

    def path(self, target, source, ns):
        require_stamps(ns)
        self._check_names("lookupTransform", target_frame=target, source_frame=source)
        if target == source:
            return [target]
        return self._walk_asked(target, source, ns)[2]

    def chain(self, target, target_ns, source, source_ns, fixed):
        require_stamps(target_ns, source_ns)
        halves = []
        if source in self.names or fixed in self.names:
            halves.append((fixed, source, source_ns))
            if target in self.names:
                halves.append((target, fixed, target_ns))
        found = []
        for end, begin, ns in halves:
            self._check_names("lookupTransform", target_frame=end, source_frame=begin)
            found += [begin] if begin == end else self._walk_asked(end, begin, ns)[2]
        return without_detours(found)

    def velocity(self, tracking, observation, reference, point, point_frame, ns, interval_ns):
        """
        The errors of which one is raised, and the answers of which one is given; one of the lists is empty.

        An answer is the linear and the angular mean over the interval around the time, cut at the latest
        common time if that is later, and how many seconds that is; time 0 is not the latest. After half a
        turn there are two answers.
        """
        errors = []

        def exactly(target, source, at_ns):
            # The rotation's sign does not matter here.
            try:
                self._check_names("lookupTransform", target_frame=target, source_frame=source)
                return IDENTITY if target == source else self._walk(target, source, at_ns)[0]
            except ModelError as error:
                errors.append(error)
                return IDENTITY

        try:
            require_stamps(ns)
            self._check_names("lookupTransform", target_frame=observation, source_frame=tracking)
            find = self.latest if observation == tracking else self._latest
            latest = find(observation, tracking)
        except ModelError as error:
            return [error], []
        ns = max(ns, 1)
        start = max(ns - interval_ns // 2, 1)
        end = min(ns + interval_ns - interval_ns // 2, max(latest or math.inf, ns))
        first, last = exactly(observation, tracking, start), exactly(observation, tracking, end)
        now = exactly(observation, tracking, ns)
        point_now = added(turned((p := exactly(observation, point_frame, ns))[1], point), p[0])
        into = exactly(reference, observation, ns)[1]
        if errors:
            return errors, []
        if end == start:
            return [], [((math.nan,) * 3, (math.nan,) * 3, 0.0)]
        duration = (end - start) / S
        linear = tuple(a / duration for a in difference(last[0], first[0]))
        lever = difference(point_now, now[0])
        answers = []
        for sign in (1.0, -1.0):
            x, y, z, w = (sign * a for a in product(last[1], conjugate(first[1])))
            if w > -1e-9:
                sine = math.sqrt(x * x + y * y + z * z)
                scale = 2 * math.atan2(sine, w) / sine / duration if sine > 0 else 0.0
                angular = (x * scale, y * scale, z * scale)
                at_point = added(linear, cross(angular, lever))
                answers.append((turned(into, at_point), turned(into, angular), abs(duration)))
        return [], answers


def extrapolation_text(target, source, source_gaps, target_gaps, limiting, now_ns):
    """
    What is said of the gaps of a lookup; each side's are in the order of the hops up from its end.

    tf2 names the first one of a side: where both have one, that of the frame with the newer data, or the
    source's. The addition names the frame that lacks the most.
    """
    firsts = source_gaps[:1] + target_gaps[:1]
    quoted = max(firsts, key=lambda gap: gap.newest_ns)
    lack = max(source_gaps + target_gaps, key=lambda gap: gap.missing)
    addition = lack.addition
    if lack.time is not None and not lack.is_late and 0 < (now_ns or 0) < lack.time:
        ahead = span(lack.time - now_ns)
        addition += f"; the requested time is {ahead} ahead of the clock of the buffer"
    if quoted.from_1970 or lack.from_1970:
        addition += (
            ". The requested time is in 1970: is it in the wrong unit (an int is in nanoseconds), or "
            "simulated time?"
        )
    elif lack.data_from_1970:
        if lack.stamp == 0:
            addition += ". Its stamp is 0: was it never set?"
        else:
            addition += ". The sample is from 1970: is it in simulated time, and the requested time is not?"
    if limiting is not None and lack.is_late:
        addition += f". {limiting} has no newer data"
    return (
        f"Lookup would require {quoted.text}, when looking up transform from frame [{source}] to frame "
        f"[{target}]; {addition}"
    )


def as_reason(text):
    """What a canTransform says instead of the text of a lookupTransform."""
    if "passed to" not in text:
        return text
    text = text.removeprefix("Invalid argument ").replace("lookupTransform", "canTransform")
    return "Invalid frame ID " + text.replace(" does not exist", " - frame does not exist")


def without_detours(names):
    """Each name once: what lies between two occurrences of one name is left out."""
    chain = []
    for name in names:
        if name in chain:
            del chain[chain.index(name) + 1 :]
        else:
            chain.append(name)
    return chain

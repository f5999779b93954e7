# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ages and limits of the model."""

import math

from model_math import IDENTITY, composed
from model_terms import ModelError, limit_of, require_stamps, seconds, span

MOST_SUGGESTED = 3  # names in the text of an error
YEAR = 365 * 86400 * 10**9  # ns
NO_CLOCK = (
    "ages need a clock, which this buffer does not have: a BufferCore and the buffer of a recording have none"
)


class Policies:
    """Of a model, which has `names`, `frames`, and tf2's lookups and walks."""

    now_ns = None  # of the clock by which ages are counted; 0: it has not begun; None: there is no clock

    # Ages.

    def ages(self, target, source):
        """In seconds, by the names of the moving frames, from the source to the target."""
        self._require_clock()
        self._check_names("ages", target_frame=target, source_frame=source)
        hops = [] if target == source else self._newest_hops(target, source)
        return {name: self._age_ns(name) / 1e9 for name in hops if not self.frames[name].static}

    def _require_clock(self):
        if self.now_ns is None:
            raise ModelError("ValueError", NO_CLOCK)

    def _age_ns(self, name):
        return math.inf if self.now_ns <= 0 else self.now_ns - self.frames[name].newest_ns()

    def _judge_ages(self, target, source, hops, max_age):
        """Raise the error about the frame that is furthest beyond its limit, or one of several."""
        named = dict(max_age) if isinstance(max_age, tuple) else {}
        static = [name for name in hops if name in named and self.frames[name].static]
        if static:
            raise ModelError("ValueError", *[self._of_static(name, target, source) for name in static])
        limits = {name: limit_of(max_age, name, None) for name in hops if not self.frames[name].static}
        beyond = {
            # Of infinite ages, the lowest limit decides.
            name: (self._age_ns(name) - limit, -limit if self.now_ns <= 0 else 0)
            for name, limit in limits.items()
            if limit is not None and self._age_ns(name) > limit
        }
        if beyond:
            most = max(beyond.values())
            furthest = [name for name in beyond if beyond[name] == most]
            texts = [self._stale(target, source, name, limits[name]) for name in furthest]
            raise ModelError("ExtrapolationException", *texts)

    def _of_static(self, name, target, source):
        moving = [one for one in self._newest_hops(target, source) if not self.frames[one].static]
        some = " or ".join(f"[{one}]" for one in moving[:MOST_SUGGESTED])
        instead = f": limit {some} instead" if some else "; no frame of this lookup moves"
        return f"max_age has a limit for [{name}], which is static, and therefore has no age{instead}"

    def _stale(self, target, source, name, limit):
        frame, age = self.frames[name], self._age_ns(name)
        if age == math.inf:
            fact = (
                "has no known age: the clock of the buffer is at 0, because simulated time has not begun, "
                "or nothing spins the node"
            )
        else:
            fact = f"is {span(age)} old by the clock of the buffer, at {seconds(self.now_ns)}"
        text = (
            f"The latest transform from frame [{source}] to frame [{target}] is too old; the newest sample "
            f"of {name} in {frame.newest_parent()}, at {seconds(frame.newest_ns())}, {fact}; max_age allows "
            f"{seconds(limit)} s"
        )
        if 30 * YEAR < age < math.inf and frame.newest_ns() < YEAR:
            text += (
                ". The sample is from 1970: is it in simulated time, which this clock does not follow?"
                if frame.newest_ns()
                else ". Its stamp is 0: was it never set?"
            )
        return text

    # Lookups under a policy.

    def lookup_under(self, policy, target, source, ns):
        """As `lookup`. Of an error about the time only the kind is what it should be."""
        self._require_times(policy, time=ns)

        def look_up():
            if target == source:
                return self.lookup(target, source, ns)
            self._check_names("lookupTransform", target_frame=target, source_frame=source)
            return self._answer_under(policy, target, source, ns)

        return self._with_limits_checked(policy, target, source, look_up)

    def lookup_full_under(self, policy, target, target_ns, source, source_ns, fixed):
        self._require_times(policy, target_time=target_ns, source_time=source_ns)

        def look_up():
            names = {"target_frame": target, "source_frame": source, "fixed_frame": fixed}
            self._check_names("lookupTransform", **names)
            _, _, _, *from_source = self._answer_under(policy, fixed, source, source_ns)
            stamp, _, _, *to_target = self._answer_under(policy, target, fixed, target_ns)
            return self._answer(stamp, target, source, composed(to_target, from_source))

        return self._with_limits_checked(policy, target, source, look_up)

    def _answer_under(self, policy, target, source, ns):
        if target == source:
            return self._answer(self._transform(target, source, ns)[0], target, source, IDENTITY)
        judged = policy.max_age is not None
        try:
            stamp, found, chain, top = self._walk_asked(target, source, ns, policy)
            hops = chain[:top] + chain[top + 1 :]
            moving = {name: self.frames[name] for name in hops} if stamp else {}
            if any(frame.is_torn(name, stamp, policy) for name, frame in moving.items()):
                raise ModelError("ExtrapolationException", "a long gap")
        except ModelError as error:
            if judged and error.kind == "ExtrapolationException":
                self._judge_ages(target, source, self._newest_hops(target, source), policy.max_age)
            raise
        if judged:
            # Also those of the newest path, which may keep the common time before a frame changed its parent.
            newest = [name for name in self._newest_hops(target, source) if name not in hops]
            self._judge_ages(target, source, [*hops, *newest], policy.max_age)
        used = [frame.used_ns(name, stamp, policy) for name, frame in moving.items()]
        stamp = min([stamp, *[ns for ns, carried_on in used if not carried_on]])
        return self._answer(stamp, target, source, found)

    def _require_times(self, policy, **times):
        for argument, ns in times.items():
            require_stamps(ns)
            if policy.max_age is not None and ns != 0:
                raise ModelError(
                    "ValueError",
                    f"max_age limits the age of the latest transform, so {argument} must be 0, got "
                    f"{seconds(ns)} s; for a time, use tolerance",
                )
        if policy.max_age is not None:
            self._require_clock()

    # Limits for frames that cannot have any.

    def _with_limits_checked(self, policy, target, source, look_up):
        """Wrong ones are refused where a path is known."""
        try:
            answer = look_up()
        except ModelError as error:
            if error.kind == "ExtrapolationException":
                self._check_limits(policy, target, source)
            raise
        self._check_limits(policy, target, source)
        return answer

    def _check_limits(self, policy, target, source):
        for argument, limits in (("tolerance", policy.tolerance), ("max_age", policy.max_age)):
            for name, _ in limits if isinstance(limits, tuple) else ():
                if name not in self.names:
                    text = f"{argument} has a limit for [{name}], which does not exist"
                    if name == "" or name.startswith("/"):
                        try:
                            self._check_name(f"lookupTransform argument {argument}", name)
                        except ModelError as error:
                            text = error.texts[0]
                    raise ModelError("ValueError", text + self._unknown())
                elif name not in self.frames:
                    raise ModelError("ValueError", self._of_root(argument, name, target, source))

    def _of_root(self, argument, name, target, source):
        try:
            on_path = [] if target == source else self._newest_hops(target, source)
        except ModelError:
            on_path = []
        moving = [one for one in on_path if not self.frames[one].static]
        children = self.children(name)
        children = [one for one in children if one in moving] or children
        some = " or ".join(f"[{child}]" for child in children[:MOST_SUGGESTED])
        return (
            f"{argument} has a limit for [{name}], which has no parent. A limit applies to the transform of "
            f"a frame from its parent: limit {some or 'a child'} instead"
        )

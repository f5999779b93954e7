# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The table of questions: how each public method of a buffer is asked, beside the model.

A question is a function of a pair and of dice. tests/core/test_buffer_beside_model.py fails where a public
method or a parameter has none.
"""

import itertools
import math

import numpy as np
from buffer_beside_model import (
    FRAMES,
    ODD_NAMES,
    RELATIVE,
    as_error,
    as_model_tells,
    of_buffer,
    of_model,
    same_answer,
    same_error,
    same_kind,
    same_velocity,
)
from geometry_msgs.msg import PointStamped
from model_math import added, canonical, turned
from model_terms import STAMPS_END, TF2, Policy
from rclpy.duration import Duration
from times_and_transforms import S, stamp_ns

import tf2_geometry_msgs  # noqa: F401  registers the conversions of points
from tf2_py import TransformException

QUESTIONS = {}  # by the name of a method: what asks it
# What changes a buffer, or makes one: the steps of the tests with random buffers; see Pair.
CHANGES = {
    "set_transform",
    "set_transform_static",
    "set_transforms",
    "set_transforms_cdr",
    "add_source",  # see test_sources_without_node.py
    "clear",
    "forget",
    "freeze",
    "open",
    "time_jump_callback",  # which clears it
}
INTERVALS = (0, 1, 2, 3, 10, 1000, S)
NOT_ASKED = 1e9  # a timeout, where there is an answer, or nobody waits
PENDING = ("pending",)
WRONG_ARGUMENTS = ("ValueError", "OverflowError")


def asks(*methods):
    def enter(function):
        for name in methods:
            QUESTIONS.setdefault(name, []).append(function)
        return function

    return enter


def ask(pair, dice):
    """Listings, every pair of frames at some of the times, and each question some times."""
    pair.buffer._self_check()
    pair.listings()
    pair.histories()
    times, names = pair.times(), [*pair.model.names, "nowhere"]
    for target, source in itertools.product(names, repeat=2):
        pair.latest(target, source)
        for ns in {0, *dice.sample(times, min(len(times), 2))}:
            pair.lookup(target, source, ns)
    for _ in range(4):
        for one in dict.fromkeys(itertools.chain(*QUESTIONS.values())):
            one(pair, dice)
    ask_at_the_ends_of_policies(pair, dice)


def some_names(pair, dice, count):
    names = [*pair.model.names, "nowhere"]
    if dice.random() < 0.1:
        names.append(dice.choice(ODD_NAMES))
    return dice.choices(names, k=count)


def some_times(pair, dice, count):
    return dice.choices([0, *pair.times()], k=count)


def some_stamps(pair, dice, count):
    """Times that a message can carry."""
    return dice.choices([0, *[ns for ns in pair.times() if -STAMPS_END <= ns < STAMPS_END]], k=count)


# Policies.


def some_limits(dice, of_frame):
    """For all frames, or for some of them, seldom for one that is unknown."""
    if dice.random() < 0.4:
        return of_frame(dice)
    names = dice.sample(FRAMES, dice.randrange(4))
    if dice.random() < 0.1:
        names.append(dice.choice(ODD_NAMES))
    return tuple((name, of_frame(dice)) for name in names)


def some_policy(dice, latest=True):
    """For any time, or for a lookup of the latest transform, which may have a `max_age`."""
    tolerance = some_limits(dice, lambda dice: dice.choice((0, 1, 3, 50))) if dice.random() < 0.6 else 0
    return Policy(
        tolerance,
        dice.random() < 0.4,
        dice.choice((None, None, 0, 2, 4)),
        some_limits(dice, lambda dice: dice.choice((0, 1, 5, 30))) if latest else None,
    )


def arguments_of(policy):
    def given(limits):
        if isinstance(limits, tuple):
            return {name: Duration(nanoseconds=ns) for name, ns in limits}
        return None if limits is None else Duration(nanoseconds=limits)

    if policy == TF2:
        return {}
    return {
        "tolerance": given(policy.tolerance),
        "extrapolate": policy.extrapolate,
        "max_gap": given(policy.max_gap),
        "max_age": given(policy.max_age),
    }


def some_lookup(pair, dice):
    """Target, source, time, policy; a policy with a `max_age` is seldom that of another time than 0."""
    target, source = some_names(pair, dice, 2)
    latest = dice.random() < 0.5
    ns = 0 if latest and dice.random() < 0.95 else some_times(pair, dice, 1)[0]
    return target, source, ns, some_policy(dice, latest)


def some_full_lookup(pair, dice):
    """Target, target's time, source, source's time, fixed frame, policy."""
    target, source, fixed = some_names(pair, dice, 3)
    latest = dice.random() < 0.5
    times = (0, 0) if latest and dice.random() < 0.95 else some_times(pair, dice, 2)
    return target, times[0], source, times[1], fixed, some_policy(dice, latest)


def timeout(wanted):
    """One that does not matter."""
    return NOT_ASKED if wanted[0] == "answer" else 0


# Lookups.


@asks("lookup_transform_core", "can_transform_core")
def lookup(pair, dice):
    pair.lookup(*some_names(pair, dice, 2), *some_times(pair, dice, 1))


@asks("lookup_transform_full_core", "can_transform_full_core")
def lookup_full(pair, dice):
    for _ in range(3):
        target, source, fixed = some_names(pair, dice, 3)
        target_ns, source_ns = some_times(pair, dice, 2)
        pair.lookup_full(target, target_ns, source, source_ns, fixed)


@asks("lookup_transform", "can_transform", "wait_for_transform_async", "lookup_transform_async")
def lookup_under(pair, dice):
    *query, policy = some_lookup(pair, dice)
    wanted = of_model(pair.model.lookup_under, policy, *query)
    compare_ways(pair, lookup_under, query, policy, wanted)


@asks(
    "lookup_transform_full",
    "can_transform_full",
    "wait_for_transform_full_async",
    "lookup_transform_full_async",
)
def lookup_full_under(pair, dice):
    *query, policy = some_full_lookup(pair, dice)
    wanted = of_model(pair.model.lookup_full_under, policy, *query)
    compare_ways(pair, lookup_full_under, query, policy, wanted)


def compare_ways(pair, question, query, policy, wanted):
    """One lookup, by each of the methods that the question asks."""
    methods = [getattr(pair.buffer, name) for name, asking in QUESTIONS.items() if question in asking]
    look_up, can, future_of, coroutine_of = methods
    about, more = (*query, policy), arguments_of(policy)
    got = pair.told(look_up, *query, timeout=timeout(wanted), **more)
    pair.compare(about, got, wanted, same_answer, same_kind)
    told = of_buffer(can, *query, timeout=timeout(wanted), return_debug_tuple=True, **more)
    if got[0] == "answer":
        assert told == ("answer", (True, "")), about
    elif got[1] in WRONG_ARGUMENTS:
        assert told == got, about
    else:
        assert told[0] == "answer", about
        assert not told[1][0], about
    # A wait for what may still come is pending; there will never be an answer with a name that is invalid.
    invalid = any(name == "" or name.startswith("/") for name in query if isinstance(name, str))
    for began in (
        begun_future(future_of, *query, timeout=NOT_ASKED, **more),
        begun(coroutine_of(*query, timeout=NOT_ASKED, **more)),
    ):
        if got[0] == "answer":
            assert (began[0], as_model_tells(began[1])) == got, about
        elif got[1] in WRONG_ARGUMENTS:
            assert began == got, about
        else:
            assert began[:2] == ("error", "InvalidArgumentException") if invalid else began == PENDING, about


def begun_future(call, *arguments, **more):
    """What a future holds at once; a pending one is cancelled."""
    try:
        future = call(*arguments, **more)
        if future.done():
            return ("answer", future.result())
    except (TransformException, ValueError, OverflowError) as error:
        return as_error(error)
    future.cancel()
    return PENDING


def begun(coroutine):
    """What a coroutine returns at once; a pending one is ended."""
    try:
        coroutine.send(None)
    except StopIteration as ended:
        return ("answer", ended.value)
    except (TransformException, ValueError, OverflowError) as error:
        return as_error(error)
    coroutine.close()
    return PENDING


# Explanations.


@asks("explain")
def explained(pair, dice):
    compare_explained(pair, *some_lookup(pair, dice))


def compare_explained(pair, *query_and_policy):
    """An explanation has the answer of the lookup, or its error."""
    *query, policy = query_and_policy
    about, policed = ("explain", *query, policy), arguments_of(policy)
    got = of_buffer(pair.buffer.explain, *query, **policed)
    pair.compare(about, got, of_model(pair.model.explain, policy, *query), same_explanation, same_kind)
    answer = of_buffer(pair.buffer.lookup_transform, *query, **policed)
    assert (("answer", got[1].transform) if got[0] == "answer" else got) == answer, about


def same_explanation(got, wanted):
    answer, time_ns, hops = wanted
    return (
        same_answer(as_model_tells(got.transform), answer)
        and got.time_ns == time_ns
        and len(got.hops) == len(hops)
        and all(map(same_hop, got.hops, hops))
    )


def same_hop(got, wanted):
    stamp, *transform = wanted.transform
    told = as_model_tells(got.transform)
    facts = got._replace(transform=None, weight=0) == wanted._replace(transform=None, weight=0)
    # Only the answer has the sign that tf2 chooses.
    told, transform = ((*one[:-1], canonical(one[-1])) for one in (told, transform))
    expected = (stamp, wanted.parent, wanted.frame, *transform)
    return facts and math.isclose(got.weight, wanted.weight) and same_answer(told, expected)


# Many times.


@asks("lookup_transforms", "lookup_matrices", "transform_points", "lookup_matrix")
def series(pair, dice):
    target, source, fixed = some_names(pair, dice, 3)
    times, policy = some_stamps(pair, dice, 2), dice.choice((TF2, some_policy(dice, latest=False)))
    times += some_times(pair, dice, 3)
    if dice.random() < 0.3:
        times, policy = [0, 0], some_policy(dice)
    target_ns = 0 if policy.max_age is not None else times[0]
    compare_series(pair, target, source, times, policy=policy)
    compare_series(pair, target, source, times, fixed, target_ns, policy)


def compare_series(pair, target, source, times, fixed=None, target_ns=None, policy=TF2):
    """
    The answers for several times are those of single lookups.

    What is missing is NaN, or the first error, which names its place; that of a time that no stamp can hold
    comes before the others. A wrong name or limit is an error in any case.
    """
    query = (target, source, times, fixed, target_ns, policy)
    singles = [compare_single(pair, target, source, ns, fixed, target_ns, policy) for ns in times]
    more = arguments_of(policy)
    if fixed is not None:
        more |= {"fixed_frame": fixed, "target_time": target_ns}
    failed = [(i, one) for i, one in enumerate(singles) if one[0] == "error"]
    of_all = [one for _, one in failed if "passed to" in one[2] or one[1] == "ValueError"]
    points = [(i, 1.0, -2.0) for i in range(len(times))]
    buffer = pair.buffer
    for call, arguments, expected in (
        (buffer.lookup_transforms, (target, source, times), as_row),
        (buffer.lookup_matrices, (target, source, times), as_matrix),
        (buffer.transform_points, (points, times, target, source), as_point),
    ):
        got = of_buffer(call, *arguments, **more)
        if of_all:
            # Other errors come first, where a wrong limit is found after the lookups.
            assert got[:2] in {one[:2] for _, one in failed}, (query, got)
        elif failed:
            i, (_, kind, text) = next((one for one in failed if one[1][1] == "OverflowError"), failed[0])
            assert got == ("error", kind, f"times[{i}]: {text}"), (query, got)
        if expected is not as_point:
            got = of_buffer(call, *arguments, on_missing="nan", **more)
        elif failed:
            continue
        if of_all:
            assert got == of_all[0], (query, got, of_all)
            continue
        assert got[0] == "answer", (query, got, singles)
        arrays = got[1] if expected is as_row else (got[1],)
        for i, single in enumerate(singles):
            row = np.concatenate([array[i].ravel() for array in arrays]).tolist()
            if single[0] == "error":
                assert all(map(math.isnan, row)), (query, i, row)
            else:
                assert near(row, expected(single[1], points[i])), (query, i, row)


def compare_single(pair, target, source, ns, fixed, target_ns, policy):
    """The answer of a buffer for one of several times, which is that of the model, or its error."""
    buffer, model, more = pair.buffer, pair.model, arguments_of(policy)
    if fixed is None:
        asked, (call, wanted) = (target, source, ns), (buffer.lookup_transform, model.lookup_under)
    else:
        asked = (target, target_ns, source, ns, fixed)
        call, wanted = buffer.lookup_transform_full, model.lookup_full_under
    got = pair.told(call, *asked, **more)
    loosely = same_error if policy == TF2 else same_kind
    pair.compare((*asked, policy), got, of_model(wanted, policy, *asked), same_answer, loosely)
    if fixed is None:
        out, matrix_of = np.empty((4, 4)), of_buffer(buffer.lookup_matrix, target, source, ns, None, **more)
        buffer_out = of_buffer(buffer.lookup_matrix, target, source, ns, out=out, **more)
    else:
        more |= {"fixed_frame": fixed, "target_time": target_ns}
        out, matrix_of = None, of_buffer(buffer.lookup_matrix, target, source, ns, **more)
        buffer_out = matrix_of
    for matrix in (matrix_of, buffer_out):
        if got[0] == "error":
            assert matrix == got, (asked, policy, matrix)
        else:
            assert near(matrix[1].ravel().tolist(), as_matrix(got[1])), (asked, policy)
    return got


def as_row(answer, _=None):
    return [*answer[3], *answer[4]]


def as_matrix(answer, _=None):
    columns = [turned(answer[4], axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    rows = [[*(column[i] for column in columns), answer[3][i]] for i in range(3)]
    return [number for row in (*rows, (0, 0, 0, 1)) for number in row]


def as_point(answer, point):
    return added(turned(answer[4], point), answer[3])


def near(got, wanted):
    scale = max(1e3, *map(abs, wanted))
    return all(abs(a - b) <= RELATIVE * scale for a, b in zip(got, wanted, strict=True))


@asks("lookup_transforms", "lookup_matrices")
def many_frames(pair, dice):
    """What is asked of several frames at once is what is asked of each."""
    target, *sources = some_names(pair, dice, 3)
    times = [*some_stamps(pair, dice, 1), *some_times(pair, dice, 2)]
    for call in (pair.buffer.lookup_transforms, pair.buffer.lookup_matrices):
        each = [of_buffer(call, target, source, times, on_missing="nan") for source in sources]
        together = of_buffer(call, target, sources, times, on_missing="nan")
        wrong = [one for one in each if one[0] == "error"]
        if wrong:
            assert together == wrong[0], (target, sources, times)
            continue
        parts = together[1] if isinstance(together[1], tuple) else (together[1],)
        for i, one in enumerate(each):
            singles = one[1] if isinstance(one[1], tuple) else (one[1],)
            for part, single in zip(parts, singles, strict=True):
                assert np.array_equal(part[i], single, equal_nan=True), (target, sources, times)


def ask_at_the_ends_of_policies(pair, dice):
    for name, frame in pair.model.frames.items():
        for older, newer in itertools.pairwise(frame.samples[-4:]):
            policy = Policy(max_gap=max(0, newer[0] - older[0] - dice.randrange(2)))
            compare_series(pair, older[1], name, [(older[0] + newer[0]) // 2], policy=policy)
        if frame.samples and frame.newest_ns() < STAMPS_END - 10:
            tolerance, parent = dice.randrange(1, 5), frame.newest_parent()
            end = frame.newest_ns() + tolerance
            policy = Policy(dice.choice((tolerance, ((name, tolerance),))), dice.random() < 0.5)
            compare_series(pair, parent, name, [end - 1, end, end + 1], policy=policy)
            if pair.now_ns is not None and not frame.static:
                age = max(pair.now_ns - frame.newest_ns() - dice.randrange(2), 0)
                policy = Policy(max_age=dice.choice((age, ((name, age),))))
                compare_series(pair, parent, name, [0], policy=policy)


# Velocities.


@asks("lookupVelocityFullCore")
def velocity_of_point(pair, dice):
    *frames, point_frame = some_names(pair, dice, 4)
    point = (dice.choice((0.0, 1.0)), -2.0, 0.5)
    query = (*frames, point, point_frame, *some_times(pair, dice, 1))
    compare_velocity(pair, pair.buffer.lookupVelocityFullCore, query, query, dice.choice(INTERVALS))


@asks("lookupVelocityCore")
def velocity(pair, dice):
    """Of the origin of a frame, in the axes of the other."""
    frames, [ns], interval_ns = some_names(pair, dice, 2), some_times(pair, dice, 1), dice.choice(INTERVALS)
    of_origin = (frames[1], (0.0, 0.0, 0.0), frames[0])
    asked = (*frames, ns), (*frames, *of_origin, ns)
    compare_velocity(pair, pair.buffer.lookupVelocityCore, *asked, interval_ns)


def compare_velocity(pair, call, query, of_model, interval_ns):
    got = of_buffer(call, *query, Duration(nanoseconds=interval_ns))
    errors, answers = pair.model.velocity(*of_model, interval_ns)
    if got[0] == "error":
        agree = any(same_error(got, ("error", error.kind, error.texts)) for error in errors)
    else:
        agree = any(same_velocity(got[1], answer) for answer in answers)
    assert agree, (query, interval_ns, got, errors or answers)


# Times, ages and relatives.


@asks("get_latest_common_time")
def latest(pair, dice):
    pair.latest(*some_names(pair, dice, 2))


@asks("time_range", "ages")
def ranges(pair, dice):
    compare_ranges(pair, *some_names(pair, dice, 2))


def compare_ranges(pair, *query):
    for name in ("time_range", "ages"):
        got, wanted = (
            of_buffer(getattr(pair.buffer, name), *query),
            of_model(getattr(pair.model, name), *query),
        )
        pair.compare((name, *query), got, wanted)
        if got[0] == "answer":
            assert [*got[1]] == [*wanted[1]], query  # in their order


@asks("parent", "children", "path")
def relatives(pair, dice):
    name, other = some_names(pair, dice, 2)
    (ns,) = some_times(pair, dice, 1)
    for call, *query in (("parent", name, ns), ("children", name), ("path", other, name, ns)):
        wanted = of_model(getattr(pair.model, call), *query)
        pair.compare((call, *query), of_buffer(getattr(pair.buffer, call), *query), wanted)


@asks("statistics", "frames", "all_frames_as_string", "all_frames_as_yaml", "tree", "histories")
def listings(pair, _dice):
    pair.listings()
    pair.histories()


# Data, and transforms as they come.

POINT = (1.0, 2.0, -0.5)


@asks("transform", "transform_full", "transform_async")
def data(pair, dice):
    """A point is where the lookup at its stamp places it, and keeps this stamp if it is not 0."""
    target, source, fixed = dice.choices([*pair.model.names, "nowhere"], k=3)
    *_, ns, policy = some_lookup(pair, dice)
    ns = max(-STAMPS_END, min(ns, STAMPS_END - 1))  # of a message
    target_ns = 0 if policy.max_age is not None else some_times(pair, dice, 1)[0]
    point = PointStamped()
    point.header.frame_id, (point.point.x, point.point.y, point.point.z) = source, POINT
    point.header.stamp.sec, point.header.stamp.nanosec = divmod(ns, S)
    model, buffer, more = pair.model, pair.buffer, {"new_type": None, "prefix": "", **arguments_of(policy)}
    wanted = placed(model.lookup_under, ns, policy, target, source, ns)
    asked = (point, target, timeout(wanted))
    pair.compare(asked, as_placed(of_buffer(buffer.transform, *asked, **more)), wanted, near_point, same_kind)
    if wanted[0] == "answer":
        got = as_placed(begun(buffer.transform_async(*asked, **more)))
        pair.compare(asked, got, wanted, near_point)
    wanted = placed(model.lookup_full_under, target_ns, policy, target, target_ns, source, ns, fixed)
    asked = (point, target, target_ns, fixed, timeout(wanted))
    got = as_placed(of_buffer(buffer.transform_full, *asked, **more))
    pair.compare(asked, got, wanted, near_point, same_kind)


def placed(look_up, ns, *query):
    """The stamp, frame and place of the point in the model; `ns`: its stamp if that is not 0."""
    found = of_model(look_up, *query)
    if found[0] == "error":
        return found
    stamp, frame, *_ = found[1]
    return ("answer", (ns or stamp, frame, as_point(found[1], POINT)))


def as_placed(got):
    if got[0] != "answer":
        return got
    header, place = got[1].header, got[1].point
    return ("answer", (stamp_ns(got[1]), header.frame_id, (place.x, place.y, place.z)))


def near_point(got, wanted):
    return got[:2] == wanted[:2] and near(got[2], wanted[2])


@asks("changes", "on_change")
def changes(pair, dice):
    """The first change is the present transform, if the limits allow that."""
    query, policy = some_names(pair, dice, 2), some_policy(dice)._replace(tolerance=0, extrapolate=False)
    limits = {key: arguments_of(policy).get(key) for key in ("max_age", "max_gap")}
    wanted, found = of_model(pair.model.lookup_under, policy, *query, 0), []
    invalid = any(name == "" or name.startswith("/") for name in query)
    if invalid:
        return
    called = of_buffer(pair.buffer.on_change, *query, found.append, **limits)
    first = begun(anext(pair.buffer.changes(*query, **limits)))
    if wanted[1] == "ValueError":
        pair.compare(query, first, wanted, same_answer, same_kind)
        assert called == first, query
        return
    called[1].cancel()
    if wanted[0] == "error":
        assert found == [], query
        assert first == PENDING, query
    else:
        for answer in (found[0], first[1]):
            pair.compare(query, ("answer", as_model_tells(answer)), wanted, same_answer)

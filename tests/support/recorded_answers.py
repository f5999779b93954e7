# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The recorded answers of tf2 0.36.20 (ROS 2 Jazzy), and asking a buffer for the same."""

import gzip
import json
import math
import re

import pytest
import yaml
from messages_with_or_without_ros import Duration
from paths import TESTS
from times_and_transforms import S, at_ns, rotation, transform, translation

RECORDINGS = TESTS / "core" / "conformance" / "buffer_core.jsonl.gz"
# What programs look for in an error's text; the rest of it is ours.
PHRASES = (
    "extrapolation",
    "does not exist",
    "in tf2 frame_ids cannot be empty",
    "in tf2 frame_ids cannot start with a '/'",
    "not part of the same tree",
    "contains a loop",
)
RELATIVE = 1e-9  # of the largest magnitude in an answer

# Where other releases of tf2 answer differently. In the series of Jazzy, Kilted and Lyrical, from these on,
# an extrapolation has a reason if frames of both paths lack data; before, the text may begin with its comma.
GIVES_REASONS = {(0, 36): 20, (0, 41): 7, (0, 45): 7}
STORES_ROTATIONS_UNCHANGED = (0, 41, 0)  # Kilted
CLEARS_STATIC_FRAMES = (0, 45, 7)  # Lyrical

with gzip.open(RECORDINGS, "rt") as _lines:
    SCENARIOS = [json.loads(line) for line in _lines]


def number(recorded):
    return math.nan if recorded == "nan" else recorded


def unpacked(m):
    stamp, header = m.header.stamp, m.header
    names = [header.frame_id, m.child_frame_id]
    return [stamp.sec, stamp.nanosec, *names, [*translation(m)], [*rotation(m)]]


def insert(buffer, static, authority, parent, child, sec, nanosec, xyz, xyzw):
    xyz, xyzw = map(number, xyz), map(number, xyzw)
    message = transform(parent, child, xyz=xyz, xyzw=xyzw, ns=sec * S + nanosec)
    (buffer.set_transform_static if static else buffer.set_transform)(message, authority)


def full(target, target_ns, source, source_ns, fixed):
    return target, at_ns(target_ns), source, at_ns(source_ns), fixed


# What the operations of the recordings are of a buffer.
CALLS = {
    "set": insert,
    "lookup": lambda b, target, source, ns: unpacked(b.lookup_transform_core(target, source, at_ns(ns))),
    "lookup_full": lambda b, *args: unpacked(b.lookup_transform_full_core(*full(*args))),
    "can": lambda b, target, source, ns: list(b.can_transform_core(target, source, at_ns(ns))),
    "can_full": lambda b, *args: list(b.can_transform_full_core(*full(*args))),
    "latest": lambda b, *args: b.get_latest_common_time(*args).nanoseconds,
    "dot": lambda b, ns: b._allFramesAsDot(at_ns(ns)),
    "frames": lambda b: sorted(b._getFrameStrings()),
    "exists": lambda b, name: bool(b._frameExists(name)),
    "yaml": lambda b: b.all_frames_as_yaml(),
    "string": lambda b: b.all_frames_as_string(),
    "clear": lambda b: b.clear(),
}


def edges(dot):
    return sorted(re.findall(r'"([^"]+)" -> "([^"]+)"', dot))


def assert_same_reason(got, want):
    assert bool(got) == bool(want)
    assert [p for p in PHRASES if p in want and p not in got] == []


def assert_same_transform(got, want):
    assert got[:4] == want[:4]
    numbers = [*got[4], *got[5]]
    wanted = [number(v) for v in (*want[4], *want[5])]
    scale = max([1.0, *(abs(v) for v in wanted if not math.isnan(v))])
    for u, v in zip(numbers, wanted, strict=True):
        assert (math.isnan(u) and math.isnan(v)) or abs(u - v) <= RELATIVE * scale


def assert_same_answer(op, got, want):
    match op:
        case "lookup" | "lookup_full":
            assert_same_transform(got, want)
        case "can" | "can_full":
            assert got[0] == want[0]
            assert_same_reason(got[1], want[1])
        case "yaml":
            assert (yaml.safe_load(got) or []) == (yaml.safe_load(want) or [])
        case "dot":
            assert edges(got) == edges(want)
        case _:
            assert got == want


def check_answer(calls, subject, op, args, want, *errors):
    """Do what was recorded, with a buffer and CALLS, or another subject and its calls."""
    try:
        got = calls[op](subject, *args)
    except (*errors, TypeError, ValueError, OverflowError) as error:
        assert getattr(error, "kind", type(error).__name__) == want.get("err"), (op, args, error)
        assert_same_reason(str(error), want["msg"])
    else:
        assert "ok" in want, (op, args, got)
        assert_same_answer(op, got, want["ok"])


def check_answers(tf2_py, scenario):
    buffer = tf2_py.BufferCore(Duration(nanoseconds=scenario["cache_ns"]))
    for (op, *args), want in zip(scenario["ops"], scenario["want"], strict=True):
        check_answer(CALLS, buffer, op, args, want, tf2_py.TransformException)
    buffer._self_check()


def check_answers_of_release(tf2_py, scenario, release):
    """The same of a real tf2, up to the first step that its release takes in another way."""
    if release[2] < GIVES_REASONS.get(release[:2], 0):
        pytest.skip(f"before tf2 0.{release[1]}.{GIVES_REASONS[release[:2]]}, some texts give no reason")
    calls = CALLS
    if release >= STORES_ROTATIONS_UNCHANGED:
        calls = CALLS | {op: _with_jazzys_sign(CALLS[op]) for op in ("lookup", "lookup_full")}
    buffer = tf2_py.BufferCore(Duration(nanoseconds=scenario["cache_ns"]))
    for (op, *args), want in zip(scenario["ops"], scenario["want"], strict=True):
        if release >= STORES_ROTATIONS_UNCHANGED and op == "set" and not _is_normalized(args[-1]):
            break
        if release >= CLEARS_STATIC_FRAMES and op == "clear":
            break
        check_answer(calls, buffer, op, args, want, tf2_py.TransformException)


def _is_normalized(xyzw):
    return abs(sum(number(v) ** 2 for v in xyzw) - 1) < RELATIVE


def _with_jazzys_sign(call):
    """Of q and -q, Jazzy returns the one whose w, or else whose largest number, is positive."""

    def called(*args):
        *rest, (x, y, z, w) = call(*args)
        sign = math.copysign(1, w if 4 * w * w > 1 else max(x, y, z, key=abs))
        return [*rest, [sign * v for v in (x, y, z, w)]]

    return called

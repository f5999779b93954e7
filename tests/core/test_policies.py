"""Ways to ask for a tolerance, extrapolation or a longest gap; test_model.py holds what is answered."""

import asyncio

import pytest
from making import S, at_ns, stamp_ns, transform, translation

pytestmark = pytest.mark.ours


def test_a_gap_that_is_too_long_is_described(tf2_ros):
    buffer = tf2_ros.Buffer()
    for second in (2, 4):
        buffer.set_transform(transform("map", "base", second), "x")
    with pytest.raises(tf2_ros.ExtrapolationException) as raised:
        buffer.lookup_transform("map", "base", at_ns(3 * S), max_gap=1)
    assert str(raised.value) == (
        "Lookup at time 3.000000000 would require interpolation across 2.000000000 s, when looking up "
        "transform from frame [base] to frame [map]; the samples of base at 2.000000000 and "
        "4.000000000 are further apart than max_gap, 1.000000000 s"
    )
    with pytest.raises(tf2_ros.ExtrapolationException, match=r"^times\[1\]: Lookup at time 3"):
        buffer.lookup_transforms("map", "base", [2 * S, 3 * S], max_gap=1)


LATE = at_ns(5 * S // 2)
ONE, TWO, DATA = ("map", "base", LATE), ("map", LATE, "base", LATE, "odom"), transform("base", "data", 2.5)
WAYS = {
    "lookup_transform": lambda b, **p: b.lookup_transform(*ONE, **p),
    "with a timeout": lambda b, **p: b.lookup_transform(*ONE, 0.001, **p),
    "full": lambda b, **p: b.lookup_transform_full(*TWO, **p),
    "full, with a timeout": lambda b, **p: b.lookup_transform_full(*TWO, 0.001, **p),
    "async": lambda b, **p: asyncio.run(b.lookup_transform_async(*ONE, timeout=0.01, **p)),
    "full async": lambda b, **p: asyncio.run(b.lookup_transform_full_async(*TWO, timeout=0.01, **p)),
    "transform": lambda b, **p: b.transform(DATA, "map", **p),
    "transform_full": lambda b, **p: b.transform_full(DATA, "map", LATE, "odom", **p),
    "transform_async": lambda b, **p: asyncio.run(b.transform_async(DATA, "map", timeout=0.01, **p)),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_look_up_takes_a_policy(tf2_ros, way):
    pytest.importorskip("tf2_geometry_msgs")
    buffer = tf2_ros.Buffer()
    for second in (1, 2):
        buffer.set_transform(transform("map", "odom", second, (0, 1, 0)), "x")
        buffer.set_transform(transform("odom", "base", second, (second, 0, 0)), "x")
    with pytest.raises(tf2_ros.TransformException):
        WAYS[way](buffer)
    answer = WAYS[way](buffer, tolerance=0.5, extrapolate=True)
    assert translation(answer) == (2.5, 1, 0)
    assert stamp_ns(answer) == LATE.nanoseconds


def test_questions_and_points_take_a_policy(tf2_ros):
    buffer = tf2_ros.Buffer()
    for second in (1, 2):
        buffer.set_transform(transform("map", "base", second, (second, 0, 0)), "x")
    for ask in (
        lambda **p: buffer.can_transform("map", "base", LATE, return_debug_tuple=True, **p),
        lambda **p: buffer.can_transform("map", "base", LATE, 0.001, return_debug_tuple=True, **p),
        lambda **p: buffer.can_transform_full("map", LATE, "base", LATE, "map", 0, True, **p),
    ):
        assert ask(tolerance=0.5) == (True, "")
        can, reason = ask(tolerance=0.4)
        assert not can
        assert "into the future" in reason
    moved = buffer.transform_points([(0, 0, 1)], [LATE], "map", "base", tolerance=1, extrapolate=True)
    assert moved.tolist() == [[2.5, 0, 1]]


@pytest.mark.parametrize(
    ("policy", "error", "text"),
    [
        ({"tolerance": -1}, ValueError, "must not be negative"),
        ({"tolerance": float("nan")}, ValueError, "NaN"),
        ({"tolerance": "1"}, TypeError, "tolerance"),
        ({"max_gap": -0.1}, ValueError, "must not be negative"),
        ({"extrapolate": True}, TypeError, "needs a tolerance"),
        ({"tolerence": 1}, TypeError, r"^CALL\(\) got .* 'tolerence'. Did you mean 'tolerance'\?$"),
        ({"time_out": 1}, TypeError, r"^CALL\(\) got .* 'time_out'. Did you mean 'timeout'\?$"),
        ({"colour": 1}, TypeError, r"^CALL\(\) got an unexpected keyword .* 'colour'$"),
    ],
    ids=str,
)
def test_wrong_policies_are_refused_by_every_method_and_misspelt_ones_named_with_it(
    tf2_ros, policy, error, text
):
    buffer, given = tf2_ros.Buffer(), ("map", "base", at_ns(S))
    for call, run in (
        ("lookup_transform", lambda: buffer.lookup_transform(*given, **policy)),
        ("lookup_transform", lambda: buffer.lookup_transform(*given, timeout=1, **policy)),
        ("lookup_transforms", lambda: buffer.lookup_transforms("map", "base", [S], **policy)),
        ("transform_points", lambda: buffer.transform_points([(0, 0, 1)], [S], "map", "base", **policy)),
        ("wait_for_transform_async", lambda: buffer.wait_for_transform_async(*given, **policy)),
        ("lookup_transform_async", lambda: buffer.lookup_transform_async(*given, **policy).send(None)),
    ):
        with pytest.raises(error, match=text.replace("CALL", call)):
            run()

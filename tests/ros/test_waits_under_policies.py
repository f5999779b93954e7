"""Waits under a policy."""

import asyncio

import pytest
from making import S, at, stamp_ns, transform

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_ros):
    buffer = tf2_ros.Buffer()
    insert(buffer, 20, 21)
    return buffer


def insert(buffer, *seconds):
    for one in seconds:
        buffer.set_transform(transform("map", "base", one), "x")


def test_a_tolerance_answers_early(buffer):
    future = buffer.wait_for_transform_async("map", "base", at(25), tolerance=1.5)
    insert(buffer, 23)
    assert not future.done()
    insert(buffer, 24)
    assert stamp_ns(future.result()) == 24 * S


def test_coroutines_take_a_policy(buffer):
    answer = asyncio.run(buffer.lookup_transform_async("map", "base", at(22), tolerance=2, extrapolate=True))
    assert stamp_ns(answer) == 22 * S
    with pytest.raises(TypeError, match="tolerence"):
        asyncio.run(buffer.lookup_transform_async("map", "base", at(41), tolerence=1))

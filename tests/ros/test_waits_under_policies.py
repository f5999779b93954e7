"""Waits for a time that transforms no longer arrive for."""

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


class TestFutures:
    def test_one_ends_with_an_error_when_its_time_is_refused(self, tf2_ros, buffer):
        called = []
        future = buffer.wait_for_transform_async("map", "base", at(19), tolerance=0)
        future.add_done_callback(called.append)
        plain = buffer.wait_for_transform_async("map", "base", at(19))
        insert(buffer, 40, 41)
        assert called == [future]
        assert isinstance(future.exception(), tf2_ros.ExtrapolationException)
        assert "refused by now" in str(future.exception())
        assert not plain.done()

    def test_one_that_begins_too_late_has_its_error_at_once(self, tf2_ros, buffer):
        insert(buffer, 40, 41)
        future = buffer.wait_for_transform_async("map", "base", at(19), tolerance=0)
        assert isinstance(future.exception(), tf2_ros.ExtrapolationException)

    def test_a_tolerance_answers_early(self, buffer):
        future = buffer.wait_for_transform_async("map", "base", at(25), tolerance=1.5)
        insert(buffer, 23)
        assert not future.done()
        insert(buffer, 24)
        assert stamp_ns(future.result()) == 24 * S

    def test_coroutines_take_a_policy(self, tf2_ros, buffer):
        answer = asyncio.run(
            buffer.lookup_transform_async("map", "base", at(22), tolerance=2, extrapolate=True)
        )
        assert stamp_ns(answer) == 22 * S
        insert(buffer, 40, 41)
        with pytest.raises(tf2_ros.ExtrapolationException, match="refused by now"):
            asyncio.run(buffer.lookup_transform_async("map", "base", at(19), tolerance=0))
        with pytest.raises(TypeError, match="tolerence"):
            asyncio.run(buffer.lookup_transform_async("map", "base", at(41), tolerence=1))

"""What a pending wait says that it lacks."""

import gc
import threading

import pytest
from making import at, transform

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_py):
    buffer = tf2_py.BufferCore()
    for stamp in (2, 3):
        buffer.set_transform(transform("map", "odom", stamp), "x")
    buffer.set_transform(transform("odom", "base", 3), "x")
    buffer.set_transform_static(transform("elsewhere", "table"), "x")
    return buffer


def ignore(answer):
    pass


START = "waits for the transform from frame "


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ("map", "odom", at(4)),
            "[odom] to frame [map] at 4.000000000 s: Lookup would require extrapolation into the future.",
        ),
        (
            ("map", "cam\nra", at(0)),
            '[cam\\nra] to frame [map] at the latest common time: "cam\\nra" passed to lookupTransform',
        ),
        (
            ("odom", "base", at(3), "world", at(9)),
            "[base] at 3.000000000 s to frame [odom] at 9.000000000 s, fixed in frame [world]: "
            '"world" passed to lookupTransform argument fixed_frame does not exist',
        ),
    ],
)
def test_a_wait_shows_the_error_of_its_lookup(buffer, arguments, line):
    wait = buffer._wait(*arguments, notify=ignore)
    assert wait.answer is None
    assert wait.lacks().startswith(START + line)
    assert wait.lacks().endswith(str(wait.reason()))
    assert buffer._pending_waits() == [wait.lacks()]


def test_only_pending_waits_are_listed(buffer):
    waits = [buffer._wait("map", f"frame{i}", at(0), notify=ignore) for i in range(5)]
    assert len(buffer._pending_waits()) == 5
    assert len(buffer._pending_waits(2)) == 2
    waits[0].cancel()
    buffer.set_transform(transform("map", "frame1"), "x")
    del waits[2]  # frame 2
    assert [line.partition(":")[0][-41:] for line in buffer._pending_waits()] == [
        f"[frame{i}] to frame [map] at the latest common time"[-41:] for i in (3, 4)
    ]
    assert waits[1].lacks().endswith(": the answer is available and is being delivered")


@pytest.fixture
def collector():
    """Have the collector run when this many more objects exist that it tracks."""

    def run_after(count):
        gc.set_threshold(gc.get_count()[0] + count, 1000, 1000)
        gc.enable()

    thresholds = gc.get_threshold()
    gc.disable()
    try:
        yield run_after
    finally:
        gc.set_threshold(*thresholds)
        gc.enable()


def test_waits_that_the_collector_destroys_meanwhile_do_no_harm(buffer, collector):
    for allocation in range(1, 12):
        gc.disable()
        gc.collect()
        for i in range(20):
            cycle = []
            cycle.append(buffer._wait("map", f"frame{i}", at(5), notify=cycle.append))
        del cycle
        collector(allocation)
        lines = buffer._pending_waits()
        gc.disable()
        assert all(line.startswith(START) for line in lines)


def test_waits_that_end_meanwhile_do_no_harm(buffer):
    stop = threading.Event()

    def churn():
        i = 0
        while not stop.is_set():
            i += 1
            wait = buffer._wait("map", f"frame{i % 7}", at(1000), notify=ignore)
            wait.cancel()

    threads = [threading.Thread(target=churn) for _ in range(2)]
    for thread in threads:
        thread.start()
    for _ in range(2000):
        for line in buffer._pending_waits():
            assert line.startswith(START)
    stop.set()
    for thread in threads:
        thread.join()
    assert buffer._pending_waits() == []

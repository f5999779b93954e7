"""What has arrived waits until somebody reads the buffer, and is there when somebody does; nobody spins."""

import gc
import itertools
import os
import pickle
import subprocess
import sys
import threading
import time
import weakref

import pytest
from making import at, transform, translation
from processes import DEADLINE_S, errors_so_far, start, until
from rclpy.duration import Duration
from rclpy.time import Time

from tf2_msgs.msg import TFMessage

pytestmark = pytest.mark.ours

S = 10**9
LATEST = Time()


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer()


@pytest.fixture
def listener(tf2_ros, buffer, node):
    with tf2_ros.TransformListener(buffer, node) as listener:
        yield listener


def arrived(listener, count=1):
    """Whether so many messages of dynamic transforms have; the thread inserts what has waited for 0.1 s."""
    inbox, topic = listener._tf2_receiver.inbox, listener._tf2_topics[0]
    return lambda: inbox.has_pending() or topic.arrivals.taken()[0] >= count


def begins_a_wait(buffer, child):
    future = buffer.wait_for_transform_async("map", child, LATEST)
    return future.done() and future.result().child_frame_id == child


# Whether each way of reading a buffer finds a new frame.
READS = {
    "lookup_transform": lambda b, child: translation(b.lookup_transform("map", child, at(1)))[0] == 5,
    "lookup_transform_full": lambda b, child: b.lookup_transform_full("map", at(1), child, at(1), "map"),
    "lookup with a timeout": lambda b, child: b.lookup_transform("map", child, at(1), Duration(seconds=9)),
    "lookup_transform_core": lambda b, child: b.lookup_transform_core("map", child, at(1)),
    "can_transform": lambda b, child: b.can_transform("map", child, LATEST),
    "can_transform_core": lambda b, child: b.can_transform_core("map", child, LATEST)[0],
    "lookup_transforms": lambda b, child: b.lookup_transforms("map", child, [1 * S])[0][0][0] == 5,
    "transform_points": lambda b, child: b.transform_points([[0.0, 0, 0]], [1 * S], "map", child)[0][0] == 5,
    "get_latest_common_time": lambda b, child: b.get_latest_common_time("map", child).nanoseconds == 1 * S,
    "the first try of a wait": begins_a_wait,
    "statistics": lambda b, child: b.statistics()["taken"] > b.known,
    "frames": lambda b, child: child in b.frames(),
    "tree": lambda b, child: child in b.tree(),
    "all_frames_as_yaml": lambda b, child: child in b.all_frames_as_yaml(),
    "all_frames_as_string": lambda b, child: child in b.all_frames_as_string(),
    "_frameExists": lambda b, child: b._frameExists(child),
    "_getFrameStrings": lambda b, child: child in b._getFrameStrings(),
    "_allFramesAsDot": lambda b, child: child in b._allFramesAsDot(),
    "in": lambda b, child: child in b,
    "repr": lambda b, child: f"{b.known + 2} frames" in repr(b),
    "pickle": lambda b, child: child in pickle.loads(pickle.dumps(b)),
    "_chain": lambda b, child: b._chain("map", at(1), child, at(1), "map") == [child, "map"],
}


def test_every_read_sees_all_that_has_arrived(buffer, listener, peer):
    publisher = peer()
    for number, (read, finds) in enumerate(READS.items()):
        assert buffer.statistics()["taken"] == number
        buffer.known = number
        listener._tf2_receiver.inbox.forget_reads()
        publisher.send(("map", f"frame_{number}", 1 * S, 5))
        until(arrived(listener, number + 1))
        assert finds(buffer, f"frame_{number}"), read


def test_what_a_process_has_published_is_found_by_its_next_lookup():
    """Also where the draining thread has taken it, and has not inserted it yet."""
    # The profiles of the tests would have the middleware deliver later.
    env = {name: value for name, value in os.environ.items() if not name.endswith("_PROFILES_FILE")}
    program = start("finds_its_own.py", "5000", stdout=subprocess.PIPE, env=env)
    output, _ = program.communicate(timeout=DEADLINE_S)
    assert output == "0 of 5000 missed\n"


def test_what_arrived_before_clear_is_cleared(buffer, listener, peer):
    peer().send(("map", "robot", 1 * S, 5))
    until(arrived(listener))
    buffer.clear()
    assert not buffer.can_transform("map", "robot", LATEST)


class TestWithoutAReader:
    def test_what_is_refused_is_logged(self, listener, peer, capfd):
        peer().send(("map", "map", 1 * S, 5))
        until(lambda: "TF_SELF_TRANSFORM" in errors_so_far())

    def test_the_thread_never_needs_the_gil(self, buffer, listener, flood):
        """More messages than the queue holds twice arrive while one C call keeps the GIL."""
        import ctypes

        process = flood(100, 1, 300)
        until(lambda: listener._tf2_topics[0].arrivals.taken()[0] > 0)
        ctypes.PyDLL(None).usleep(2_500_000)
        process.wait()
        until(lambda: buffer.statistics()["taken"] == 300)


class TestWhoGetsIt:
    def test_what_arrived_before_goes_to_the_buffer_of_before(self, tf2_ros, buffer, listener, peer):
        publisher, other = peer(), tf2_ros.Buffer()
        publisher.send(("map", "early", 1 * S, 5))
        until(arrived(listener))
        listener.buffer = other
        publisher.send(("map", "late", 1 * S, 5))
        until(lambda: "late" in other)
        assert "early" in buffer and "late" not in buffer and "early" not in other

    def test_a_callback_set_on_the_listener_changes_nothing(self, buffer, listener, peer):
        """As in tf2: the subscription has the bound method."""
        listener.callback = lambda message: pytest.fail("called")
        peer().send(("map", "robot", 1 * S, 5))
        until(lambda: "robot" in buffer)
        assert listener.receives == ("/tf", "/tf_static")


class TestEventsExecutor:
    @pytest.fixture
    def events_executor(self, ros):
        experimental = pytest.importorskip("rclpy.experimental")
        executor = experimental.EventsExecutor()
        yield executor
        for node in executor.get_nodes():
            executor.remove_node(node)
        executor.spin_once(timeout_sec=0.01)

    def spin(self, executor, condition):
        # Not `until`: the rounds of this executor end when the time is over, whatever has happened.
        deadline = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.05)

    def test_a_listener_may_be_moved_to_it_and_back(
        self, buffer, listener, node, peer, executor, events_executor
    ):
        publisher, ticks = peer(), itertools.count()
        node.create_timer(0.01, lambda: next(ticks))
        publisher.send(("map", "before", 1 * S, 5))
        until(lambda: "before" in buffer, executor)
        executor.remove_node(node)
        events_executor.add_node(node)
        self.spin(events_executor, lambda: listener.receives == ())
        publisher.send(("map", "beside", 1 * S, 5))
        publisher.send(("map", "fixed", 0, 5), static=True)
        self.spin(events_executor, lambda: "beside" in buffer and "fixed" in buffer)
        events_executor.remove_node(node)
        executor.add_node(node)
        publisher.send(("map", "after", 1 * S, 5))
        until(lambda: "after" in buffer, executor)
        assert listener.receives == ()
        assert next(ticks) > 0

    def test_a_listener_that_is_made_in_it_leaves_messages_to_it(
        self, tf2_ros, buffer, listener, node, peer, events_executor
    ):
        publisher, second = peer(), tf2_ros.Buffer()
        events_executor.add_node(node)
        self.spin(events_executor, lambda: listener.receives == ())
        with tf2_ros.TransformListener(second, node) as other:
            assert other.receives == ()
            publisher.send(("map", "inside", 1 * S, 5))
            self.spin(events_executor, lambda: "inside" in buffer and "inside" in second)


class TestEnd:
    def test_buffers_are_exchanged_while_threads_read_and_wait(self, tf2_ros, node, flood):
        """The buffers stay whole, and each wait ends."""
        process, ending = flood(200, 2, 600), threading.Event()
        buffers = [tf2_ros.Buffer() for _ in range(3)]
        with tf2_ros.TransformListener(buffers[0], node) as listener:

            def exchange(first):
                for number in itertools.count(first):
                    listener.buffer = buffers[number % 3]
                    if ending.wait(0.0001):
                        break

            def wait(buffer):
                while not ending.is_set():
                    future = buffer.wait_for_transform_async("map", "f0", LATEST, timeout=0.01)
                    buffer.can_transform("map", "f1", LATEST, Duration(seconds=0.002))
                    until(future.done)
                    future.exception()

            threads = [threading.Thread(target=exchange, args=(first,)) for first in (0, 1)]
            threads += [threading.Thread(target=wait, args=(buffer,)) for buffer in buffers]
            for thread in threads:
                thread.start()
            try:
                process.wait()
            finally:
                ending.set()
                for thread in threads:
                    thread.join()
        for buffer in buffers:
            assert buffer.statistics()["taken"] > 0
            buffer._self_check()
            until(lambda buffer=buffer: buffer.statistics()["waiters"] == 0)


@pytest.fixture
def publisher(new_node):
    """Publishes in this process."""
    return new_node("sending").create_publisher(TFMessage, "/tf", 100)


def test_an_answer_is_not_lost_with_the_listener_that_received_it(tf2_ros, buffer, new_node, publisher):
    for number in range(5):
        node = new_node(f"listening_{number}")
        listener = tf2_ros.TransformListener(buffer, node)
        until(lambda: publisher.get_subscription_count() > 0)
        future = buffer.wait_for_transform_async("map", f"frame_{number}", LATEST)
        message = TFMessage(transforms=[transform("map", f"frame_{number}", 1)])
        interval = sys.getswitchinterval()
        sys.setswitchinterval(10)  # the thread that reports must wait
        try:
            publisher.publish(message)
            deadline = time.monotonic() + DEADLINE_S
            while not buffer.can_transform("map", f"frame_{number}", LATEST) and time.monotonic() < deadline:
                pass
            listener.unregister()
            node.destroy_node()
            del listener, node
            gc.collect()
        finally:
            sys.setswitchinterval(interval)
        until(future.done)
        until(lambda: publisher.get_subscription_count() == 0)


def test_garbage_is_not_drained(tf2_ros, ros, publisher):
    class Listener(tf2_ros.TransformListener):
        def __del__(self):
            """Do not call that of the base."""

    ends = threading.Event()

    def send():
        message = TFMessage(transforms=[transform("map", f"frame_{i}", 1) for i in range(20)])
        while not ends.wait(0.0003):
            publisher.publish(message)

    sender = threading.Thread(target=send)
    sender.start()
    for _ in range(20):
        node = ros.create_node("collected")
        node.buffer = tf2_ros.Buffer()
        node.listener = Listener(node.buffer, node)
        node.itself = node
        receiver = weakref.ref(node.listener._tf2_receiver)
        until(arrived(node.listener))
        del node
        gc.collect()
        assert receiver() is None
    ends.set()
    sender.join()


def test_where_the_middleware_refuses_the_executor_takes_the_messages(
    tf2_ros, buffer, node, peer, executor, monkeypatch
):
    from tf2_ros._receive import receiver

    class Refused(receiver.Subscriptions):
        def subscribe(self, *_):
            raise RuntimeError("not implemented")

    monkeypatch.setattr(receiver, "Subscriptions", Refused)
    with tf2_ros.TransformListener(buffer, node) as listener:
        assert listener.receives == ()
        peer().send(("map", "robot", 1 * S, 5))
        until(lambda: "robot" in buffer, executor)

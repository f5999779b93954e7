"""Which thread runs callbacks, and when: an executor that has the node, or a thread where none has."""

import gc
import os
import signal
import sys
import threading
import time

import pytest
from geometry_msgs.msg import PointStamped
from making import transform
from processes import DEADLINE_S, until
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time
from spinning import spinning

from tf2_ros._wait import callbacks
from tf2_ros._wait.callbacks import CallbackQueue, callback_queue

pytestmark = pytest.mark.ours

THREAD = "tf2_ros callbacks"


@pytest.fixture
def queue(node):
    return callback_queue(node)


@pytest.fixture
def names():
    return []


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(callbacks, "PATIENCE_S", 0.2)


@pytest.fixture
def note(names):
    """A call that notes in which thread it runs."""
    return lambda *_: names.append(threading.current_thread().name)


class TestWhoRunsThem:
    def test_a_thread_where_there_is_no_executor(self, queue, note, names):
        queue.put(note)
        until(lambda: names == [THREAD])

    @pytest.mark.parametrize("node", [None, object()])
    def test_a_thread_where_there_is_no_node_of_rclpy(self, node, note, names):
        callback_queue(node).put(note)
        until(lambda: names == [THREAD])

    def test_an_executor_that_has_the_node(self, queue, note, names, node, executor):
        for _ in range(3):
            queue.put(note)
        until(lambda: len(names) == 3, executor)
        assert set(names) == {threading.current_thread().name}

    def test_an_executor_that_sleeps_is_woken(self, queue, note, names, node):
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        with spinning(executor):
            until(queue.sleeps)
            queue.put(note)
            until(lambda: names)
        assert names != [THREAD]

    @pytest.mark.parametrize("way", ["rclpy.spin_once", "executor.spin_once"])
    def test_after_a_single_round_a_thread_within_seconds(self, ros, tf2_ros, node, peer, note, names, way):
        """Both a future and a filter; whether an executor keeps the node or not."""
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer, node)
        message_filter = tf2_ros.MessageFilter(None, buffer, "map", 0, node=node)
        message_filter.registerCallback(note)
        future = buffer.wait_for_transform_async("map", "robot", Time())
        future.add_done_callback(note)
        executor = SingleThreadedExecutor()
        if way == "rclpy.spin_once":
            ros.spin_once(node, executor=executor, timeout_sec=0)
        else:
            executor.add_node(node)
            executor.spin_once(timeout_sec=0)
        point = PointStamped()
        point.header.frame_id = "robot"
        message_filter.add(point)
        peer().send(("map", "robot", 1, 1))
        until(lambda: buffer.can_transform("map", "robot", Time()))
        until(lambda: len(names) == 2)
        assert names == [THREAD, THREAD]
        message_filter.close()
        listener.unregister()
        executor.shutdown()

    @pytest.mark.parametrize("destroyed", [True, False])
    def test_a_thread_where_the_node_is_dropped(self, ros, note, names, destroyed):
        node = ros.create_node("dropped")
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin_once(timeout_sec=0)
        for _ in range(3):
            callback_queue(node).put(note)
        executor.remove_node(node)
        executor.shutdown()
        if destroyed:
            node.destroy_node()
        del node, executor
        gc.collect()
        until(lambda: names == [THREAD] * 3)

    def test_no_thread_beside_a_callback_of_the_node(self, queue, note, names, node, impatient):
        executor, begun, go_on = SingleThreadedExecutor(), threading.Event(), threading.Event()

        def work():
            timer.cancel()
            begun.set()
            go_on.wait(DEADLINE_S)
            names.append("callback ends")

        timer = node.create_timer(0.0, work)
        executor.add_node(node)
        with spinning(executor):
            assert begun.wait(DEADLINE_S)
            queue.put(note)
            end = time.monotonic() + 1
            until(lambda: time.monotonic() > end)
            go_on.set()
            until(lambda: len(names) == 2)
        assert names[0] == "callback ends"
        assert names[1] != THREAD

    def test_an_executor_again_when_it_gives_a_sign(self, queue, note, names, node, impatient):
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        queue.put(note)
        until(lambda: names == [THREAD])
        for _ in range(4):
            queue.put(note)
        until(lambda: len(names) == 5)
        assert set(names) == {THREAD}
        executor.spin_once(timeout_sec=0)
        del names[:]
        queue.put(note)
        until(lambda: names, executor)
        assert names == [threading.current_thread().name]
        executor.shutdown()

    def test_an_events_executor(self, queue, note, names, node):
        """Which refuses all that has a guard condition."""
        executor = pytest.importorskip("rclpy.experimental").EventsExecutor()
        executor.add_node(node)
        queue.put(note)
        until(lambda: names, executor)
        queue.put(lambda: 1 / 0)
        queue.put(note)
        until(lambda: len(names) == 2, executor)
        executor.remove_node(node)
        ordinary = SingleThreadedExecutor()
        ordinary.add_node(node)
        queue.put(note)
        until(lambda: len(names) == 3, ordinary)
        assert set(names) == {threading.current_thread().name}
        ordinary.shutdown()
        executor.shutdown()

    def test_a_filter_and_a_future_in_an_events_executor(self, tf2_ros, node, note, names):
        executor = pytest.importorskip("rclpy.experimental").EventsExecutor()
        buffer = tf2_ros.Buffer()
        message_filter = tf2_ros.MessageFilter((PointStamped, "points", 10), buffer, "map", 0, node=node)
        message_filter.registerCallback(note)
        executor.add_node(node)
        point = PointStamped()
        point.header.frame_id = "robot"
        publisher = node.create_publisher(PointStamped, "points", 10)
        until(lambda: publisher.get_subscription_count() == 1)
        publisher.publish(point)
        until(lambda: message_filter.statistics()["waiting"] == 1, executor)
        buffer.set_transform_static(transform("map", "robot"), "me")
        until(lambda: names == [threading.current_thread().name], executor)
        message_filter.close()
        executor.remove_node(node)
        executor.shutdown()


class TestOrder:
    def test_they_run_in_the_order_in_which_they_were_put(self, queue):
        order = []
        for n in range(100):
            queue.put(lambda n=n: order.append(n))
        until(lambda: len(order) == 100)
        assert order == list(range(100))

    def test_one_at_a_time_also_where_the_executor_comes_back(self, queue, node, executor, impatient):
        """The thread is inside a call when the node is spun."""
        begun, go_on, order = threading.Event(), threading.Event(), []
        executor.remove_node(node)
        until(lambda: queue.thread_may_run())

        def block():
            begun.set()
            go_on.wait(DEADLINE_S)
            order.append(1)

        queue.put(block)
        queue.put(lambda: order.append(2))
        assert begun.wait(DEADLINE_S)
        executor.add_node(node)
        for _ in range(5):
            executor.spin_once(timeout_sec=0.01)
        assert order == []
        go_on.set()
        until(lambda: len(order) == 2, executor)
        assert order == [1, 2]

    def test_what_one_raises_is_logged_and_the_rest_are_run(self, queue, node, executor, capfd):
        order = []
        queue.put(lambda: 1 / 0)
        queue.put(lambda: order.append(1))
        until(lambda: order, executor)
        assert "ZeroDivisionError" in capfd.readouterr().err

    def test_what_ends_a_program_ends_the_spin_of_the_main_thread(self, queue, node, executor):
        order = []
        queue.put(sys.exit)
        queue.put(lambda: order.append(1))
        with pytest.raises(SystemExit):
            until(lambda: False, executor)
        until(lambda: order, executor)

    @pytest.mark.parametrize("error", [ZeroDivisionError, SystemExit])
    def test_what_one_raises_in_a_thread_is_logged(self, queue, capfd, error):
        order = []

        def fail():
            raise error

        queue.put(fail)
        queue.put(lambda: order.append(1))
        until(lambda: order)
        assert error.__name__ in capfd.readouterr().err

    def test_nothing_runs_once_it_is_closed(self, node, executor):
        order, own = [], CallbackQueue(node)
        own.put(lambda: order.append(1))
        own.close()
        own.put(lambda: order.append(2))
        for _ in range(3):
            executor.spin_once(timeout_sec=0.01)
        assert order == []
        assert own not in node.waitables


class TestFromAnywhere:
    def test_a_signal_handler_may_put(self, queue, note, names):
        before = signal.signal(signal.SIGUSR1, lambda *_: queue.put(note))
        try:
            for _ in range(20):
                os.kill(os.getpid(), signal.SIGUSR1)
            until(lambda: names)
        finally:
            signal.signal(signal.SIGUSR1, before)

    def test_a_finalizer_may_put(self, queue, note, names):
        class Ends:
            def __del__(self):
                queue.put(note)

        for _ in range(20):
            Ends()
        until(lambda: len(names) == 20)

    def test_a_thread_that_cannot_be_started_is_tried_again(self, queue, note, names):
        size = threading.stack_size(1 << 46)  # no machine has memory for such a stack
        try:
            queue.put(note)
        finally:
            threading.stack_size(size)
        queue.put(note)
        until(lambda: names == [THREAD, THREAD])

    def test_each_call_is_run_once_however_many_put(self, queue):
        done = []
        threads = [
            threading.Thread(target=lambda: [queue.put(lambda: done.append(1)) for _ in range(500)])
            for _ in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        until(lambda: len(done) == 2000)


def test_the_node_keeps_one_queue(node):
    assert callback_queue(node) is callback_queue(node)
    assert list(node.waitables).count(callback_queue(node)) == 1

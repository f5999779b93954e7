"""Listeners whose buffer is another process's: programs as they are, with TF2_SHARED_BUFFER set."""

import gc
import subprocess
import threading
import time
import weakref
from contextlib import ExitStack
from functools import partial

import pytest
import rclpy
from making_objects import S, at_ns, transform
from processes import killed, start
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.time import Time
from ros_domains import claim_domain
from shared_buffers import new_name, ring_threads
from spinning_nodes import at_once, knows
from waiting import DEADLINE_S, until

from tf2_ros import Buffer, TransformListener
from tf2_ros._forking import LOCK
from tf2_ros._shared.shared_names import segment_path

pytestmark = pytest.mark.ours


@pytest.fixture
def shared(monkeypatch):
    """Starts `programs/shares_what_it_receives.py`, and sets the variable; the name of the shared buffer."""
    with ExitStack() as at_end:

        def share(*arguments):
            name = new_name()
            at_end.callback(segment_path(name).unlink, missing_ok=True)
            owner = start("shares_what_it_receives.py", name, *arguments, stdout=subprocess.PIPE)
            share.process = at_end.enter_context(killed(owner))
            assert share.process.stdout.readline() == "shared\n"
            monkeypatch.setenv("TF2_SHARED_BUFFER", name)
            return name

        yield share


def arrive(sender, buffer, child, *transforms):
    """Send until they are known: a subscription in another process may be matched on one side only."""
    until(lambda: knows(buffer, child)() or sender.send(*transforms))


def is_attached(listener):
    """Whether it has no subscriptions."""
    return "shared buffer" in repr(listener)


def logged(capfd):
    return capfd.readouterr().err


def test_a_program_as_it_is_uses_the_shared_buffer(shared, node, peer, capfd):
    name = shared()
    sender = peer()
    buffer = Buffer()
    listener = TransformListener(buffer, node)
    assert f"uses the shared buffer '{name}' of process {shared.process.pid}" in logged(capfd)
    assert is_attached(listener) and listener.receives
    assert f"of the shared buffer '{name}' of process {shared.process.pid}" in repr(listener)
    arrive(sender, buffer, "robot", ("map", "robot", 1 * S, 1), ("map", "robot", 2 * S, 3))
    assert buffer.lookup_transform("map", "robot", at_ns(3 * S // 2)).transform.translation.x == 2
    # Its waits end when the other process receives.
    waiting = buffer.wait_for_transform_async("map", "robot", at_ns(5 * S))
    sender.send(("map", "robot", 5 * S, 7))
    assert until(waiting.done)
    assert waiting.result().transform.translation.x == 7
    threading.Timer(0.2, lambda: sender.send(("map", "robot", 6 * S, 8))).start()
    found = buffer.lookup_transform("map", "robot", at_ns(6 * S), timeout=Duration(seconds=DEADLINE_S))
    assert found.transform.translation.x == 8
    listener.unregister()
    assert not listener.receives


def test_the_end_of_the_owner_goes_unnoticed_by_waits(shared, node, peer, capfd):
    shared()
    buffer = Buffer()
    listener = TransformListener(buffer, node)
    sender = peer()
    arrive(sender, buffer, "robot", ("map", "robot", 1 * S, 1))
    sender.send_without_subscriber(("map", "mount", 0, 4), static=True)
    until(knows(buffer, "mount"))
    waiting = buffer.wait_for_transform_async("map", "robot", at_ns(9 * S))
    shared.process.kill()
    until(lambda: not is_attached(listener))
    until(lambda: listener.receives)
    assert f"process {shared.process.pid} no longer shares it" in logged(capfd)
    assert listener.receives and "/tf" in repr(listener)
    assert buffer.can_transform("map", "robot", at_ns(1 * S)) and buffer.can_transform("map", "mount", Time())
    # It takes a moment until the sender knows of the new subscription.
    assert until(lambda: sender.send(("map", "robot", 9 * S, 2)) or waiting.done())


def test_threads_that_attach_listeners_of_a_buffer_attach_it_once(shared, node):
    shared()
    until(lambda: gc.collect() >= 0 and ring_threads() == 0)  # those of earlier tests
    for _ in range(10):
        buffer = Buffer()
        listeners = at_once(*[partial(TransformListener, buffer, node)] * 3)
        assert all(is_attached(one) for one in listeners)
        until(lambda: ring_threads() == 1)
        buffer._tf2_attachment.close()


def test_a_listener_that_ends_while_its_owner_does_has_no_subscriptions(node):
    for _ in range(20):
        listener, check = listener_without_owner(node)
        at_once(check, listener.unregister)
        assert not any(one.topic_name == "/tf" for one in node.subscriptions)


def test_a_listener_that_gets_a_buffer_while_its_owner_ends_fills_that(node, peer):
    second, sender = Buffer(), peer()
    for round_ in range(10):
        listener, check = listener_without_owner(node)
        at_once(check, partial(setattr, listener, "buffer", second))
        arrive(sender, second, f"robot{round_}", ("map", f"robot{round_}", 1 * S, 1))
        listener.unregister()


def listener_without_owner(node):
    """A listener of an attached buffer whose owner has just ended, and what notices that."""
    owner = Buffer(share=new_name())
    with TransformListener(owner, node):
        listener = TransformListener(Buffer(attach=owner._tf2_sharing.name), node)
        assert is_attached(listener)
    owner._tf2_sharing.close()
    return listener, listener.buffer._tf2_attachment._tf2_check


def refusals():
    class OtherListener(TransformListener):
        def callback(self, data):
            super().callback(data)

    class OtherBuffer(Buffer):
        def set_transform(self, transform, authority):
            super().set_transform(transform, authority)

    usual = TransformListener
    return {
        "code of this program handles": [
            lambda node: OtherListener(Buffer(), node),
            lambda node: usual(OtherBuffer(), node),
        ],
        "it has a QoS profile": [
            lambda node: usual(Buffer(), node, qos=5),
            lambda node: usual(Buffer(), node, static_only=True),
        ],
        "is not filled from": [lambda node: usual(Buffer(), node, tf_topic="/other")],
        "keeps 10 s, but this buffer keeps 30 s": [lambda node: usual(Buffer(Duration(seconds=30)), node)],
    }


def test_what_the_shared_buffer_cannot_stand_for_is_received_as_ever(shared, node, capfd):
    shared()
    for reason, programs in refusals().items():
        for make in programs:
            listener = make(node)
            text = logged(capfd)
            assert "subscribes on its own" in text and reason in text
            assert listener.tf_static_sub is not None
            listener.unregister()


def test_without_an_owner_a_program_listens_itself(monkeypatch, node, capfd):
    for name, reason in (
        ("nobody", "no process"),
        ("a b", "the name of a shared buffer: expected"),
        ("auto", "no process"),
    ):
        monkeypatch.setenv("TF2_SHARED_BUFFER", name)
        assert not is_attached(TransformListener(Buffer(), node))
        assert reason in logged(capfd)
    monkeypatch.setenv("TF2_SHARED_BUFFER", "")
    assert not is_attached(TransformListener(Buffer(), node))
    assert logged(capfd) == ""


def test_an_owner_of_another_domain_or_without_a_listener(node, monkeypatch, capfd):
    owner = Buffer(share=new_name())
    monkeypatch.setenv("TF2_SHARED_BUFFER", owner._tf2_sharing.name)
    assert not is_attached(TransformListener(Buffer(), node))
    assert "has no listener" in logged(capfd)
    context = rclpy.Context()
    context.init(domain_id=claim_domain())
    other = rclpy.create_node("elsewhere", context=context)
    with TransformListener(owner, other):
        assert not is_attached(TransformListener(Buffer(), node))
        assert "is filled from ROS domain" in logged(capfd)
    other.destroy_node()
    context.try_shutdown()
    owner._tf2_sharing._tf2_check()
    with TransformListener(owner, node):
        assert is_attached(TransformListener(Buffer(), node))
    capfd.readouterr()
    owner._tf2_sharing._tf2_check()
    assert not is_attached(TransformListener(Buffer(), node))
    assert "has no listener" in logged(capfd)
    owner._tf2_sharing.close()


def test_simulated_time_must_be_the_owners_too(shared, new_node, capfd):
    shared()
    simulated = new_node("simulated", parameter_overrides=[Parameter("use_sim_time", value=True)])
    assert not is_attached(TransformListener(Buffer(node=simulated), simulated))
    assert "does not follow simulated time" in logged(capfd)
    shared("--ros-args", "-p", "use_sim_time:=true")
    buffer = Buffer(node=simulated)
    listener = TransformListener(buffer, simulated)
    assert is_attached(listener)
    # It follows its own clock, and stays attached.
    buffer.set_transform(transform("a", "b", 1.0), "me")
    buffer.time_jump_callback(None)
    assert not buffer.can_transform("a", "b", Time())
    assert is_attached(listener)


def test_spin_once_comes_back_for_what_arrives(node, executor, new_node):
    owner = Buffer(share=new_name())
    buffer = Buffer(attach=owner._tf2_sharing.name)
    with TransformListener(owner, new_node("owning")):
        assert is_attached(TransformListener(buffer, node))
        for number in range(1, 6):
            assert_comes_back(executor, owner, buffer, number)
    owner._tf2_sharing.close()


def test_each_executor_comes_back_for_what_arrives(node, executor, new_node):
    owner = Buffer(share=new_name())
    buffer = Buffer(attach=owner._tf2_sharing.name)
    other = SingleThreadedExecutor()
    other.add_node(new_node("other"))
    with TransformListener(owner, new_node("owning")):
        listeners = [TransformListener(buffer, each) for each in (node, *other.get_nodes())]
        assert all(map(is_attached, listeners))
        for number, each in enumerate((executor, other, executor, other), 1):
            assert_comes_back(each, owner, buffer, number)
    owner._tf2_sharing.close()
    other.shutdown()


def test_nothing_is_left_of_a_listener_whose_node_was_destroyed(node, new_node):
    owner = Buffer(share=new_name())
    buffer = Buffer(attach=owner._tf2_sharing.name)
    with TransformListener(owner, node):
        left, staying = rclpy.create_node("left"), new_node("staying")
        listeners = [TransformListener(buffer, each) for each in (left, left, staying)]
        assert all(map(is_attached, listeners))
        runners = [weakref.ref(each._tf2_call_queue.runner) for each in (left, staying)]
        left.destroy_node()
        until(lambda: not listeners[0].receives and not listeners[1].receives)
        assert listeners[2].receives == ("/tf", "/tf_static")
        del left, listeners[:2]
        until(lambda: gc.collect() >= 0 and runners[0]() is None)
        assert runners[1]() is not None
    owner._tf2_sharing.close()


def test_a_finalizer_waits_for_no_lock(node):
    """Whoever has the lock may wait for the thread in which the collector runs."""

    def hold():
        with LOCK:
            is_held.set()
            was_released.append(may_release.wait(DEADLINE_S))

    is_held, may_release, was_released = threading.Event(), threading.Event(), []
    owner = Buffer(share=new_name())
    with TransformListener(owner, node):
        listener = TransformListener(Buffer(attach=owner._tf2_sharing.name), node)
        assert is_attached(listener)
        exists = weakref.ref(listener)
        del listener
        holder = threading.Thread(target=hold)
        holder.start()
        is_held.wait()
        until(lambda: gc.collect() >= 0 and exists() is None)
        may_release.set()
        holder.join()
        assert was_released == [True]
    owner._tf2_sharing.close()


def assert_comes_back(executor, owner, buffer, number):
    """An executor returns from `spin_once` for a transform of this second that the owner inserts."""
    assert not knows(buffer, "robot", time=at_ns(number * S))()
    while executor_came_back(executor, 0.05):
        pass
    threading.Timer(0.1, owner.set_transform, [transform("map", "robot", number), "owner"]).start()
    assert executor_came_back(executor, DEADLINE_S)
    until(knows(buffer, "robot", time=at_ns(number * S)))


def executor_came_back(executor, timeout_s):
    begun = time.monotonic()
    executor.spin_once(timeout_sec=timeout_s)
    return time.monotonic() - begun < timeout_s * 0.9

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide a node that a thread spins, a buffer that a listener fills, and the session of both."""

# First, because their errors say in one line what is missing, or that another tf2_ros is imported.
from tf2_ros.records import Recording
from tf2_ros.transform_listener import TransformListener

# isort: split

import re
import threading
from argparse import Namespace
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import rclpy
from rclpy.exceptions import InvalidHandle, NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.signals import SignalHandlerOptions

from tf2_ros import Buffer
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.common.threads import start_and_wait
from tf2_ros_tools.diagnosis.findings import Finding
from tf2_ros_tools.listening.session import TOPICS, publisher_name

CALLBACK_END_WAIT_S = 1.0  # for a callback that runs when the program is to end
GID_BYTES = 16  # of a gid in a recording; in the graph of Humble, zeros follow them
TYPE = "tf2_msgs/msg/TFMessage"
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # of an endpoint whose node the graph does not know yet, or any more


@contextmanager
def spun_node(name: str, options: Namespace) -> Iterator[Node]:
    """
    A node for a ``with`` statement. A thread spins it, so that it knows the simulated time.

    :param options: of the command line.
    :raises UsageError: the command line contains a name or a parameter that ROS refuses.

    The main thread must not wait inside rclpy, because no signal would reach it there.
    """
    # Without the handlers of rclpy, which would shut the context down while the program uses it.
    rclpy.init(args=options.ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(name)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        thread = threading.Thread(target=_spin, args=(executor,), daemon=True)
        try:
            start_and_wait(thread)
            yield node
        finally:
            # This also ends the thread, which may use the executor until then.
            rclpy.try_shutdown()
            if thread.is_alive():  # a signal handler may have interrupted its start
                thread.join(CALLBACK_END_WAIT_S)
            if not thread.is_alive():
                executor.shutdown()
                node.destroy_node()
    except (NameValidationException, ParameterException) as refusal:
        raise UsageError(str(refusal)) from None
    finally:
        rclpy.try_shutdown()


def _spin(executor: SingleThreadedExecutor) -> None:
    while executor.context.ok():
        try:
            executor.spin()
        except InvalidHandle:
            continue  # a part of the node was destroyed while the executor gathered them
        except ExternalShutdownException:
            return
        except Exception:
            if executor.context.ok():
                raise
            # The context ended between two checks of the executor.


@contextmanager
def filled_buffer(
    node: Node,
    recording: Recording | None = None,
    *,
    topics: Sequence[str] = TOPICS,
    cache_time: float | None = None,
    qos: QoSProfile | None = None,
) -> Iterator[Buffer]:
    """
    A buffer for a ``with`` statement. A listener fills it, and it follows the clock of the node.

    :param recording: records what arrives.
    :param topics: the topic of dynamic transforms and the topic of static transforms.
    :param cache_time: how far each frame's history reaches back, in seconds. None: the default of buffers.
    :param qos: of dynamic transforms. None: the default of listeners.
    :raises UsageError: the receiver, which recording needs, does not support this release of ROS 2 or its
        middleware.
    """
    buffer = Buffer(cache_time, node)
    # A program that only observes must not answer those who ask the robot for its frames.
    if buffer.srv is not None:
        node.destroy_service(buffer.srv)
        buffer.srv = None
    try:
        listener = TransformListener(
            buffer, node, qos=qos, recording=recording, tf_topic=topics[0], tf_static_topic=topics[1]
        )
    except NotImplementedError as refusal:
        raise UsageError(str(refusal)) from None
    with listener:
        yield buffer


class NodeSession:
    """A :class:`~tf2_ros_tools.listening.session.Session` of a node."""

    def __init__(self, node: Node, buffer: Buffer, topics: tuple[str, str]) -> None:
        self.buffer = buffer
        self.names: dict[bytes, str] = {}
        self.feed = None
        self._node = node
        self._topics = [node.resolve_topic_name(name) for name in topics]

    @property
    def where(self) -> str:
        """The topics, and, while nothing was received, what is published instead."""
        where = f"on {' and '.join(self._topics)} in ROS domain {self._node.context.get_domain_id()}"
        instead = [] if self.buffer.frames() else [*self._of_other_types(), *self._in_other_namespaces()]
        return f"{where} ({'; '.join(instead)})" if instead else where

    def now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)

    def require_open(self) -> None:
        """Nothing ends a node but a signal."""

    def info(self, text: str) -> None:
        self._node.get_logger().info(text)

    def log_no_refusals(self) -> None:
        set_logger_level("tf2_py", LoggingSeverity.FATAL)

    def look_up_publishers(self) -> set[bytes]:
        return {gid for topic in self._topics for gid in self._publishers_of(topic)}

    def clock_publishers(self) -> list[str]:
        return [publisher_name(self.names, gid) for gid in self._publishers_of("/clock")]

    def findings(self) -> Iterator[Finding]:
        """Find publishers from which listeners receive nothing."""
        if self.buffer.frames():  # else `where` says so
            for text in self._of_other_types():
                yield Finding("qos", "", f"listeners receive nothing: {text}")
        for subscription in self._node.subscriptions:
            if (topic := subscription.topic_name) in self._topics:
                for gid, qos in self._publishers_of(topic).items():
                    compatibility, reasons = qos_check_compatible(qos, subscription.qos_profile)
                    if compatibility == QoSCompatibility.ERROR:
                        errors = ", ".join(re.findall("ERROR: ([^;]+)", reasons)).lower()
                        name = publisher_name(self.names, gid)
                        yield Finding(
                            "qos", "", f"listeners receive nothing from {name} on {topic}: {errors}"
                        )

    def _of_other_types(self) -> Iterator[str]:
        for topic in self._topics:
            self._publishers_of(topic)  # notes the names
            for one in self._node.get_publishers_info_by_topic(topic):
                if one.topic_type != TYPE:
                    name = publisher_name(self.names, bytes(one.endpoint_gid)[:GID_BYTES])
                    yield f"{name} publishes {one.topic_type} on {topic}, not {TYPE}"

    def _in_other_namespaces(self) -> Iterator[str]:
        usual, own = TOPICS[0], self._topics[0]
        for name, types in self._node.get_topic_names_and_types():
            is_other = name != own and name.endswith(usual) and own.endswith(usual) and TYPE in types
            if is_other and self._node.count_publishers(name):
                namespace = name[1 : -len(usual)]
                advice = f"add --namespace {namespace}" if namespace else "leave --namespace out"
                yield f"transforms are published on {name}: {advice}"

    def _publishers_of(self, topic: str) -> dict[bytes, QoSProfile]:
        """Get the gids and profiles of a topic's publishers, and note their names."""
        publishers = self._node.get_publishers_info_by_topic(topic)
        infos = {bytes(one.endpoint_gid)[:GID_BYTES]: one for one in publishers}
        for gid, one in infos.items():
            # A publisher that has exited keeps its name.
            if one.node_name != UNKNOWN_NODE:
                self.names[gid] = f"{one.node_namespace.rstrip('/')}/{one.node_name}"
        return {gid: one.qos_profile for gid, one in infos.items()}


@contextmanager
def node_session(
    name: str,
    options: Namespace,
    recording: Recording | None = None,
    *,
    topics: tuple[str, str] = TOPICS,
    cache_time: float | None = None,
    qos: QoSProfile | None = None,
) -> Iterator[NodeSession]:
    """A session of a new node, see :func:`tf2_ros_tools.listening.session_choice.session`."""
    with (
        spun_node(name, options) as node,
        filled_buffer(node, recording, topics=topics, cache_time=cache_time, qos=qos) as buffer,
    ):
        yield NodeSession(node, buffer, topics)

"""Owns how transforms come from the topics into a buffer."""

import weakref
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_py._log import malformed
from tf2_ros._qos import dynamic_overrides, listener_qos, static_listener_qos, static_overrides
from tf2_ros._receiving import ReceivedGroup, Receiving, can_receive, no_events
from tf2_ros._spinner import Spinner
from tf2_ros._tf2_names import (
    DurabilityPolicy,
    HistoryPolicy,
    Optional,
    SingleThreadedExecutor,
    Thread,
    Union,
    tf2_ros,
)
from tf2_ros.buffer import Buffer

# What `import *` gives from tf2's module.
__all__ = [
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "Buffer",
    "DurabilityPolicy",
    "HistoryPolicy",
    "Node",
    "Optional",
    "QoSProfile",
    "ReentrantCallbackGroup",
    "SingleThreadedExecutor",
    "TFMessage",
    "Thread",
    "TransformListener",
    "Union",
    "tf2_ros",
]

DEFAULT_TF_TOPIC = "/tf"
DEFAULT_STATIC_TF_TOPIC = "/tf_static"

AUTHORITY = "default_authority"  # the topics do not tell who published

SETTERS = ("set_transform", "set_transform_static", "set_transforms", "set_transforms_cdr")


class TransformListener:
    """
    Fills a buffer from the topics of tf2.

    :param buffer: a :class:`tf2_ros.Buffer`, or anything with its ``set_transform`` and
        ``set_transform_static``.
    :param node: subscribes. None: a hidden node that spins itself.
    :param spin_thread: spin the node in a thread of its own, until another executor takes it.
    :param qos: a profile, or the depth of the queue, for dynamic transforms.
    :param static_qos: the same for static transforms.
    :param static_only: do not subscribe to dynamic transforms.

    A thread of its own takes the transforms in, whether anybody spins the node or not, and while callbacks
    wait. Only where a subclass has a ``callback`` or ``static_callback`` of its own, the buffer is not a
    :class:`tf2_ros.Buffer` or has a ``set_transform*`` of its own, or the thread's code could not be built,
    whoever spins the node takes them in; ``receives`` tells.

    The node keeps the listener alive. ``unregister()`` ends it, as does the end of a ``with`` block.

    Attributes: ``buffer``, ``node``, ``group`` (the callback group of the subscriptions), ``tf_sub``,
    ``tf_static_sub``; where a thread spins the node, ``executor`` and ``dedicated_listener_thread``.
    """

    def __init__(
        self,
        buffer: Any,
        node: Node | None,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int | None = None,
        static_qos: QoSProfile | int | None = None,
        tf_topic: str = DEFAULT_TF_TOPIC,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
        static_only: bool = False,
    ) -> None:
        self.buffer = buffer
        self._owns_node = node is None
        self.node = node = _hidden_node(self) if node is None else node
        raw = self._may_take_bytes()
        receives = raw and can_receive()
        # Reentrant, so that transforms come in while another callback of the node waits for them.
        self.group = ReceivedGroup() if receives else ReentrantCallbackGroup()
        events = no_events() if receives else SubscriptionEventCallbacks()
        self._spinner: Spinner | None = None
        self._receiving: Receiving | None = None
        self.tf_sub: Subscription | None = None
        self.tf_static_sub: Subscription | None = None
        try:
            if not static_only:
                self.tf_sub = node.create_subscription(
                    TFMessage,
                    tf_topic,
                    self._take_bytes if raw else self.callback,
                    listener_qos() if qos is None else qos,
                    callback_group=self.group,
                    event_callbacks=events,
                    qos_overriding_options=dynamic_overrides(),
                    raw=raw,
                )
            self.tf_static_sub = node.create_subscription(
                TFMessage,
                tf_static_topic,
                self._take_static_bytes if raw else self.static_callback,
                static_listener_qos() if static_qos is None else static_qos,
                callback_group=self.group,
                event_callbacks=events,
                qos_overriding_options=static_overrides(),
                raw=raw,
            )
            if receives:
                self._receive()
            if spin_thread or self._owns_node:
                self._spin()
        except BaseException:
            self.unregister()
            raise

    @property
    def receives(self) -> bool:
        """Whether a thread of its own takes transforms in: not after its end, nor in a forked child."""
        return self._receiving is not None and self._receiving.alive

    def unregister(self) -> None:
        """End the subscriptions, the threads and the hidden node; what the buffer knows stays."""
        if self._spinner is not None:
            self._spinner.stop()
        if self._receiving is not None:
            self._receiving.stop()
        if self._owns_node:
            self.node.destroy_node()
            return
        for subscription in (self.tf_sub, self.tf_static_sub):
            if subscription is not None:
                self.node.destroy_subscription(subscription)

    def __enter__(self) -> "TransformListener":
        return self

    def __exit__(self, *_: object) -> None:
        self.unregister()

    def callback(self, data: TFMessage) -> None:
        """Put the transforms of a message into the buffer; a subclass may do something else."""
        for transform in data.transforms:
            self.buffer.set_transform(transform, AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """Put the static transforms of a message into the buffer; a subclass may do something else."""
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, AUTHORITY)

    def _may_take_bytes(self) -> bool:
        # Whoever wants to see the messages, or the transforms one by one, gets them so.
        mine, buffer = type(self), self.buffer
        return (
            mine.callback is TransformListener.callback
            and mine.static_callback is TransformListener.static_callback
            and isinstance(buffer, BufferCore)
            and all(getattr(type(buffer), name) is getattr(BufferCore, name) for name in SETTERS)
            and not any(name in getattr(buffer, "__dict__", {}) for name in SETTERS)
        )

    # These two also serve an executor that takes from a received subscription without asking its group.

    def _take_bytes(self, data: bytes) -> None:
        self._insert(data, self.tf_sub, False)

    def _take_static_bytes(self, data: bytes) -> None:
        self._insert(data, self.tf_static_sub, True)

    def _insert(self, data: bytes, subscription: Subscription | None, static: bool) -> None:
        try:
            self.buffer.set_transforms_cdr(data, AUTHORITY, static)
        except ValueError as error:
            topic = "a topic" if subscription is None else subscription.topic
            malformed(self.buffer._throttle, topic, str(error))

    def _receive(self) -> None:
        subscriptions = [(self.tf_static_sub, True)]
        if self.tf_sub is not None:
            subscriptions.append((self.tf_sub, False))
        receiving = self._receiving = Receiving(self.buffer, AUTHORITY, self.node.context, subscriptions)
        # Nothing of the thread's holds the listener; where the node goes without being destroyed, nobody is
        # left to call unregister(). The collector runs in any thread, so it must not wait.
        weakref.finalize(self, receiving.stop, wait=False).atexit = False

    def _spin(self) -> None:
        spinner = self._spinner = Spinner(self.node)
        self.executor = spinner.executor
        self.dedicated_listener_thread = spinner.thread


class StaticTransformListener(TransformListener):
    """
    Fills a buffer with static transforms alone; otherwise a :class:`TransformListener`.

    :param static_qos: a profile, or the depth of the queue.
    """

    def __init__(
        self,
        buffer: Any,
        node: Node | None,
        *,
        spin_thread: bool = False,
        static_qos: QoSProfile | int | None = None,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
    ) -> None:
        super().__init__(
            buffer,
            node,
            spin_thread=spin_thread,
            static_qos=static_qos,
            tf_static_topic=tf_static_topic,
            static_only=True,
        )


def _hidden_node(listener: TransformListener) -> Node:
    # Nothing of it depends on the time, and it is nobody's to configure.
    return Node(
        f"transform_listener_impl_{id(listener):010x}",
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )

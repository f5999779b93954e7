"""Owns how transforms come from the topics into a buffer."""

import weakref
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_ros._forking import NodeUse
from tf2_ros._qos import dynamic_overrides, listener_qos, static_listener_qos, static_overrides
from tf2_ros._receive.callback_group import ListenerGroup, wake_executor
from tf2_ros._receive.thread import Receiving, can_receive
from tf2_ros._spinner import END_WAIT_S, Spinner
from tf2_ros._tf2_names import (
    DurabilityPolicy,
    HistoryPolicy,
    Optional,
    ReentrantCallbackGroup,
    SingleThreadedExecutor,
    Thread,
    Union,
    tf2_ros,
)
from tf2_ros.buffer import SETTERS, Buffer

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

# Setting one of these redirects what arrives.
REDIRECTING = frozenset({"buffer", "callback", "static_callback"})


class TransformListener:
    """
    Fills a buffer from the topics of tf2.

    :param buffer: a :class:`tf2_ros.Buffer`, or anything with its ``set_transform`` and
        ``set_transform_static``.
    :param node: subscribes. None: a hidden node that spins itself.
    :param spin_thread: spin the node in a thread of its own, until another executor takes it or its context
        ends; the program goes on so long.
    :param qos: a profile, or the depth of the queue, for dynamic transforms.
    :param static_qos: the same for static transforms.
    :param static_only: do not subscribe to dynamic transforms.

    A thread of its own inserts the transforms, whether anybody spins the node or not, and while callbacks
    wait. Only where a program replaces ``callback``, ``static_callback``, the callback of a subscription or a
    ``set_transform*`` of the buffer, now or later, where the buffer is not a :class:`tf2_ros.Buffer`, where
    the node makes subscriptions of another kind than rclpy's, or where the thread's code could not be built,
    whoever spins the node inserts them; ``receives`` tells.

    Another buffer may be assigned to ``buffer`` at any time. The node keeps the listener alive.
    ``unregister()`` ends its subscriptions; the end of a ``with`` block ends the thread that spins the node,
    too.

    Attributes: ``buffer``, ``node``, ``group`` (the callback group of the subscriptions), ``tf_sub``,
    ``tf_static_sub``; where a thread spins the node, ``executor`` and ``dedicated_listener_thread``.
    """

    # Where a subclass does not call __init__.
    _owns_node = False
    _spinner: Spinner | None = None
    _receiving: Receiving | None = None
    _node_use: NodeUse | None = None
    tf_sub: Subscription | None = None
    tf_static_sub: Subscription | None = None

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
        self._node_use = NodeUse(node)
        self.group = ListenerGroup()
        try:
            if not static_only:
                overrides = {}
                if qos is None:
                    qos, overrides = listener_qos(), dynamic_overrides(node, tf_topic, "subscription")
                self.tf_sub = node.create_subscription(
                    TFMessage, tf_topic, self.callback, qos, callback_group=self.group, **overrides
                )
            overrides = {}
            if static_qos is None:
                static_qos = static_listener_qos()
                overrides = static_overrides(node, tf_static_topic, "subscription")
            self.tf_static_sub = node.create_subscription(
                TFMessage,
                tf_static_topic,
                self.static_callback,
                static_qos,
                callback_group=self.group,
                **overrides,
            )
            self.__receive()
            if spin_thread or self._owns_node:
                self.__spin()
        except BaseException:
            self.__del__()
            raise

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        if name in REDIRECTING and self._receiving is not None:
            self._receiving.changed()

    def __delattr__(self, name: str) -> None:
        super().__delattr__(name)
        if name in REDIRECTING and self._receiving is not None:
            self._receiving.changed()

    @property
    def receives(self) -> bool:
        """Whether a thread of its own inserts transforms: not after its end, nor in a forked child."""
        return self._receiving is not None and self._receiving.alive

    def unregister(self) -> None:
        """End the subscriptions and the hidden node; what the buffer knows stays."""
        if self._is_forked():
            return
        if not self._owns_node:
            for subscription in (self.tf_sub, self.tf_static_sub):
                if subscription is not None:
                    self.node.destroy_subscription(subscription)
        elif self._spinner is not None:
            self._spinner.stop()  # whose thread destroys the node
        else:
            self.node.destroy_node()

    def __del__(self) -> None:
        """End the thread that spins the node, and the subscriptions; may be called again."""
        if self._is_forked():
            return
        attributes = self.__dict__
        # The collector runs in any thread, inside any function, so it must not wait.
        if self._receiving is not None:
            self._receiving.stop(wait=False)
        if self._spinner is not None:
            self._spinner.stop(wait=False)
        elif "executor" in attributes and "dedicated_listener_thread" in attributes:
            # A subclass made them, as this class would have.
            self.executor.shutdown()
            self.dedicated_listener_thread.join(END_WAIT_S)
        if "node" in attributes and not (self._owns_node and self._spinner is not None):
            self.unregister()

    def __enter__(self) -> "TransformListener":
        return self

    def __exit__(self, *_: object) -> None:
        self.unregister()
        if self._spinner is not None:
            self._spinner.stop()

    def callback(self, data: TFMessage) -> None:
        """Put the transforms of a message into the buffer; a subclass may do something else."""
        for transform in data.transforms:
            self.buffer.set_transform(transform, AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """Put the static transforms of a message into the buffer; a subclass may do something else."""
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, AUTHORITY)

    def _is_forked(self) -> bool:
        # The listener is the parent's then: nothing here is to be ended.
        return self._node_use is not None and self._node_use.forked

    def __receive(self) -> None:
        # A thread takes from the subscriptions where nobody can tell the difference.
        subscriptions = [
            (subscription, static)
            for subscription, static in ((self.tf_static_sub, True), (self.tf_sub, False))
            if type(subscription) is Subscription and _direct_buffer(self, subscription, static)
        ]
        if not (subscriptions and can_receive() and isinstance(self.node, Node)):
            self.group.decide()
            wake_executor(self.node)
            return
        reference = weakref.ref(self)
        self._receiving = Receiving(
            self.node, AUTHORITY, self.group, subscriptions, _chooser(reference), _types_of(reference)
        )

    def __spin(self) -> None:
        # A hidden node is the listener's alone; a program's own is spun whatever becomes of the listener.
        if self._owns_node:
            spinner = Spinner(self.node, daemon=True, at_end=self.node.destroy_node)
        else:
            spinner = Spinner(self.node, daemon=False, owner=self)
        self._spinner = spinner
        self.executor = spinner.executor
        self.dedicated_listener_thread = spinner.thread


_CALLBACKS = {False: TransformListener.callback, True: TransformListener.static_callback}


def _direct_buffer(
    listener: TransformListener, subscription: Subscription, static: bool
) -> BufferCore | None:
    """The buffer that a message of the subscription ends in; None where a program has a part in that."""
    buffer = listener.__dict__.get("buffer")
    if not isinstance(buffer, BufferCore):
        return None
    kind, own = type(buffer), getattr(buffer, "__dict__", {})
    if _hides(kind, Buffer) or _hides(type(listener), TransformListener):
        return None
    if any(name in own or getattr(kind, name) is not getattr(BufferCore, name) for name in SETTERS):
        return None
    method, function = subscription.callback, _CALLBACKS[static]
    if getattr(method, "__func__", None) is not function or method.__self__ is not listener:
        return None
    # What a program puts in the place of the method afterwards is called, too.
    name = function.__name__
    if getattr(type(listener), name) is not function or name in listener.__dict__:
        return None
    return buffer


def _hides(kind: type, ours: type) -> bool:
    # Whether attributes may be set, or found, in a way of its own, which nobody here would notice.
    names = ("__setattr__", "__delattr__", "__getattribute__")
    return issubclass(kind, ours) and any(getattr(kind, name) is not getattr(ours, name) for name in names)


def _chooser(
    reference: "weakref.ref[TransformListener]",
) -> Callable[[Subscription, bool], BufferCore | None]:
    def choose(subscription: Subscription, static: bool) -> BufferCore | None:
        listener = reference()
        return None if listener is None else _direct_buffer(listener, subscription, static)

    return choose


def _types_of(reference: "weakref.ref[TransformListener]") -> Callable[[], list[type]]:
    def types() -> list[type]:
        listener = reference()
        return [] if listener is None else [type(listener), type(listener.__dict__.get("buffer"))]

    return types


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

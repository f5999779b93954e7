"""Owns listeners: the subscriptions by which a buffer receives transforms, and what inserts them."""

# Before the imports below fail without a word of advice.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import sys
import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_py._internal import class_name
from tf2_ros._arguments import has, refuse_swapped, require_node
from tf2_ros._hidden_node import hidden_node
from tf2_ros._node_use import NodeUse
from tf2_ros._qos import dynamic_overrides, listener_qos, static_listener_qos, static_overrides
from tf2_ros._receive.receiver_thread import ReceiverThread, can_receive
from tf2_ros._receive.reception import ReceivedTopic, Reception
from tf2_ros._receive.recording import Recording
from tf2_ros._receive.subscriptions import ListenerGroup, wake_executor
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
from tf2_ros._travel import stays
from tf2_ros.buffer import SETTERS, Buffer

if TYPE_CHECKING or sys.platform == "linux":
    from tf2_ros._shared.attachment import Attachment, attach_listener, detach_listener
else:
    from tf2_ros._shared.absence import attach_listener, detach_listener

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

AUTHORITY = "default_authority"  # messages do not name their publisher

# Setting one of these redirects what arrives.
REDIRECTING = frozenset({"buffer", "callback", "static_callback", "__class__"})


_Listener = TypeVar("_Listener", bound="TransformListener")


class TransformSink(Protocol):
    """What a listener fills."""

    def set_transform(self, transform: TransformStamped, authority: str, /) -> object: ...
    def set_transform_static(self, transform: TransformStamped, authority: str, /) -> object: ...


@stays
class TransformListener:
    """
    Fills a buffer from the topics of tf2.

    :param buffer: a :class:`tf2_ros.Buffer`, or any object with its ``set_transform`` and
        ``set_transform_static``.
    :param node: gets the subscriptions. None: a hidden node that a thread of its own spins.
    :param spin_thread: spin the node in a thread, until its context ends. Once another executor has taken the
        node over, the thread serves it no more, as in tf2. Until the end the program does not exit.
    :param qos: a profile, or the depth of the queue, for dynamic transforms. None: volatile, depth 100, which
        parameters of the node may override.
    :param static_qos: the same for static transforms. None: transient local, depth 100.
    :param tf_topic: the topic of dynamic transforms.
    :param tf_static_topic: the topic of static transforms.
    :param static_only: do not subscribe to dynamic transforms.

    A thread of its own inserts the transforms, whether the node is spun or not, and while callbacks block. In
    some cases the executor that spins the node inserts them instead: where a program replaces ``callback``,
    ``static_callback``, the callback of a subscription or a ``set_transform*`` of the buffer, now or later;
    where the buffer is not a :class:`tf2_ros.Buffer`; where the node makes subscriptions of another class
    than rclpy's; and where the thread's code could not be built. The property ``receives`` says which it is.

    On a buffer that is attached to another process's it subscribes to nothing, until the buffer leaves. With
    ``TF2_SHARED_BUFFER`` in the environment it attaches its buffer itself, where it would receive the same;
    see docs/sharing.md.

    Another buffer may be assigned to ``buffer`` at any time. The node keeps the listener alive.
    ``unregister()`` ends its subscriptions; the end of a ``with`` block also ends the thread that spins the
    node.

    Attributes: ``buffer``, ``node``, ``group`` (the callback group of the subscriptions), ``tf_sub``,
    ``tf_static_sub``; where a thread spins the node, ``executor`` and ``dedicated_listener_thread``.

    >>> from rclpy.duration import Duration
    >>> from rclpy.time import Time
    >>> from tf2_ros import Buffer, StaticTransformBroadcaster, TransformListener
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
    >>> StaticTransformBroadcaster(node).sendTransform(mount)  # usually in another process
    >>> buffer = Buffer()
    >>> with TransformListener(buffer, node):
    ...     answer = buffer.lookup_transform("base_link", "camera", Time(), timeout=Duration(seconds=5))
    >>> answer.transform.translation.x
    0.3
    """

    # Where a subclass does not call __init__.
    _owns_node = False
    _spinner: Spinner | None = None
    _receiver_thread: ReceiverThread | None = None
    _node_use: NodeUse | None = None
    _reception: Reception | None = None
    _attachment: "Attachment | None" = None
    _recording: Recording | None = None

    def __init__(
        self,
        buffer: TransformSink,
        node: Node | None,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int | None = None,
        static_qos: QoSProfile | int | None = None,
        tf_topic: str = DEFAULT_TF_TOPIC,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
        static_only: bool = False,
    ) -> None:
        refuse_swapped(
            type(self).__name__,
            buffer=(has("set_transform"), buffer),
            node=(has("create_subscription"), node),
        )
        if node is not None:
            require_node(type(self).__name__, node, "create_subscription")
        self.buffer: Any = buffer
        self._owns_node = node is None
        self.node = node = hidden_node("transform_listener_impl", self) if node is None else node
        self._node_use = NodeUse(node)
        self.group = ListenerGroup()
        try:
            self.__subscription = (qos, static_qos, None if static_only else tf_topic, tf_static_topic)
            is_usual = qos is None and static_qos is None and not static_only and self._is_direct()
            self._attachment = attach_listener(self, is_usual, (tf_topic, tf_static_topic))
            if self._attachment is None:
                self._listen_itself()
            else:
                self.group.decide()  # a program's own subscriptions may be in it
                self._reception = Reception(self, ())
            if spin_thread or self._owns_node:
                self.__spin()
        except BaseException:
            self.__del__()
            raise

    def __setattr__(self, name: str, value: Any) -> None:
        super().__setattr__(name, value)
        if name in REDIRECTING:
            self.__decide_again()
        if name == "buffer" and self._reception is not None:
            self._reception.fill(value)

    def __delattr__(self, name: str) -> None:
        super().__delattr__(name)
        if name in REDIRECTING:
            self.__decide_again()

    @property
    def tf_sub(self) -> Subscription | None:
        """
        The subscription to dynamic transforms.

        None where there is none, and for a buffer that was attached by its maker. Where the environment had
        it attached, a program that reads or sets this makes the listener listen itself.
        """
        return self.__subscription_of("tf_sub")

    @tf_sub.setter
    def tf_sub(self, value: Subscription | None) -> None:
        self.__use_subscriptions()
        self.__dict__["tf_sub"] = value

    @property
    def tf_static_sub(self) -> Subscription | None:
        """The subscription to static transforms, otherwise as :attr:`tf_sub`."""
        return self.__subscription_of("tf_static_sub")

    @tf_static_sub.setter
    def tf_static_sub(self, value: Subscription | None) -> None:
        self.__use_subscriptions()
        self.__dict__["tf_static_sub"] = value

    def __subscription_of(self, name: str) -> Subscription | None:
        self.__use_subscriptions()
        return self.__dict__.get(name)

    def __use_subscriptions(self) -> None:
        if self._attachment is not None:
            self._attachment.use_subscriptions()

    def __decide_again(self) -> None:
        for source in (self._attachment, self._receiver_thread):
            if source is not None:
                source.decide_again()

    @property
    def receives(self) -> bool:
        """Whether transforms arrive beside all executors; False after its end, and in a forked child."""
        return any(
            source is not None and source.alive for source in (self._attachment, self._receiver_thread)
        )

    def unregister(self) -> None:
        """End the subscriptions and the hidden node; the buffer keeps its transforms."""
        if self._is_forked():
            return
        if self._attachment is not None:
            self._attachment.close()
        detach_listener(self)
        if not self._owns_node:
            for name in ("tf_sub", "tf_static_sub"):
                subscription = self.__dict__.get(name)
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
        if self._receiver_thread is not None:
            self._receiver_thread.stop(wait=False)
        if self._attachment is not None:
            self._attachment.close()
        if self._spinner is not None:
            self._spinner.stop(wait=False)
        elif "executor" in attributes and "dedicated_listener_thread" in attributes:
            # A subclass made them, as this class would have.
            self.executor.shutdown()
            self.dedicated_listener_thread.join(END_WAIT_S)
        if "node" in attributes and not (self._owns_node and self._spinner is not None):
            self.unregister()

    def __repr__(self) -> str:
        """Tell the topics, how many messages were received, when the last one was, and what receives them."""
        name = class_name(type(self))
        if self._reception is None:
            return f"<{name}, not initialised>"
        if self._attachment is not None and not self._reception.topics:
            state = "" if self._attachment.alive else ", ended"
            return f"<{name} of {self._attachment.describe()}{state}>"
        if not self._reception.topics:
            return f"<{name} with subscriptions of another class than rclpy's>"
        return f"<{name} of {self._reception.describe()}, {self.__state()}>"

    def __enter__(self: _Listener) -> _Listener:
        return self

    def __exit__(self, *_: object) -> None:
        self.unregister()
        if self._spinner is not None:
            self._spinner.stop()

    def callback(self, data: TFMessage) -> None:
        """Insert the transforms of a message into the buffer; a subclass may do something else."""
        self.__count_call(static=False)
        for transform in data.transforms:
            self.buffer.set_transform(transform, AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """Insert the static transforms of a message into the buffer; a subclass may do something else."""
        self.__count_call(static=True)
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, AUTHORITY)

    def _is_forked(self) -> bool:
        # The listener is then the parent's: nothing of it is to be ended here.
        return self._node_use is not None and self._node_use.forked

    def __state(self) -> str:
        """What receives the messages."""
        assert self._reception is not None
        if self._is_forked():
            return "dead in this forked process"
        if not self._reception.is_open():
            return "ended"
        if self._reception.is_left_to_executors():
            return "received by the executor of its node"
        return "thread running" if self.receives else "thread ended"

    def __count_call(self, static: bool) -> None:
        for topic in self._reception.topics if self._reception is not None else ():
            if topic.is_static == static:
                topic.count_call()

    def _is_direct(self) -> bool:
        """Whether all that it receives goes into its buffer, and through no code of a program."""
        return (
            self._recording is None
            and getattr(type(self.node), "create_subscription", None) is Node.create_subscription
            and _direct(self) is not None
            and all(_inserts(self, function) for function in _CALLBACKS.values())
        )

    def _listen_itself(self) -> None:
        """Subscribe, as this listener was asked to."""
        qos, static_qos, tf_topic, tf_static_topic = self.__subscription
        node = self.node
        if tf_topic is not None:
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

    def __receive(self) -> None:
        # A thread takes from the subscriptions where a program cannot observe the difference.
        reference: weakref.ref[TransformListener] = weakref.ref(self)
        topics = [
            ReceivedTopic(subscription, static, _counter(reference))
            for subscription, static in ((self.tf_sub, False), (self.tf_static_sub, True))
            if isinstance(subscription, Subscription)
        ]
        subscriptions = [
            (subscription, static)
            for subscription, static in ((self.tf_static_sub, True), (self.tf_sub, False))
            if type(subscription) is Subscription and _direct_buffer(self, subscription, static)
        ]
        if subscriptions and can_receive() and isinstance(self.node, Node):
            self._receiver_thread = ReceiverThread(
                self.node,
                AUTHORITY,
                self.group,
                subscriptions,
                _chooser(reference),
                _types_of(reference),
                self._recording,
            )
            for topic in topics:
                topic.count_taken(self._receiver_thread)
        else:
            self.group.decide()
            wake_executor(self.node)
        self._reception = Reception(self, topics)

    def __spin(self) -> None:
        # A hidden node is used by the listener alone; a program's own is spun also after the listener's end.
        if self._owns_node:
            spinner = Spinner(self.node, daemon=True, at_end=self.node.destroy_node)
        else:
            spinner = Spinner(self.node, daemon=False, owner=self)
        self._spinner = spinner
        self.executor = spinner.executor
        self.dedicated_listener_thread = spinner.thread


_CALLBACKS: dict[bool, Callable[..., None]] = {
    False: TransformListener.callback,
    True: TransformListener.static_callback,
}


def _direct_buffer(
    listener: TransformListener, subscription: Subscription, static: bool
) -> BufferCore | None:
    """The buffer that gets the messages of the subscription; None where code of a program handles them."""
    return _direct(listener) if _calls_ours(listener, subscription, static) else None


def _direct(listener: TransformListener) -> BufferCore | None:
    """The listener's buffer; None where code of a program would handle what is inserted."""
    buffer = listener.__dict__.get("buffer")
    # A property of a subclass, or one that was added later, comes before what the instance holds.
    is_property = hasattr(type(getattr(type(listener), "buffer", None)), "__set__")
    if is_property or not isinstance(buffer, BufferCore):
        return None
    kind, own = type(buffer), getattr(buffer, "__dict__", {})
    if _hides(kind, Buffer) or _hides(type(listener), TransformListener):
        return None
    if any(name in own or getattr(kind, name) is not getattr(BufferCore, name) for name in SETTERS):
        return None
    return buffer


def _calls_ours(listener: TransformListener, subscription: Subscription, static: bool) -> bool:
    """Whether messages of the subscription are handled by the method of this class, and no other code."""
    method, function = subscription.callback, _CALLBACKS[static]
    if getattr(method, "__func__", None) is not function or method.__self__ is not listener:
        return False
    # What replaces the method later is called, too.
    return _inserts(listener, function)


def _inserts(listener: TransformListener, function: Callable[..., None]) -> bool:
    """Whether the listener's method of this name is that of this class."""
    name = function.__name__
    return getattr(type(listener), name) is function and name not in listener.__dict__


def _hides(kind: type, ours: type) -> bool:
    # Whether attributes may be set, or found, in a way of its own, which would not be noticed here.
    names = ("__setattr__", "__delattr__", "__getattribute__")
    return issubclass(kind, ours) and any(getattr(kind, name) is not getattr(ours, name) for name in names)


def _chooser(
    reference: "weakref.ref[TransformListener]",
) -> Callable[[Subscription, bool], BufferCore | None]:
    def choose(subscription: Subscription, static: bool) -> BufferCore | None:
        listener = reference()
        return None if listener is None else _direct_buffer(listener, subscription, static)

    return choose


def _counter(reference: "weakref.ref[TransformListener]") -> Callable[[Subscription, bool], bool]:
    def is_counted(subscription: Subscription, static: bool) -> bool:
        listener = reference()
        return listener is not None and _calls_ours(listener, subscription, static)

    return is_counted


def _types_of(reference: "weakref.ref[TransformListener]") -> Callable[[], list[type]]:
    def types() -> list[type]:
        listener = reference()
        return [] if listener is None else [type(listener), type(listener.__dict__.get("buffer"))]

    return types


class StaticTransformListener(TransformListener):
    """
    Fills a buffer with static transforms alone; otherwise a :class:`TransformListener`.

    :param buffer: as of that class, like all parameters.

    >>> from rclpy.duration import Duration
    >>> from rclpy.time import Time
    >>> from tf2_ros import Buffer, StaticTransformBroadcaster, StaticTransformListener
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id, mount.transform.translation.x = "base_link", 0.3
    >>> StaticTransformBroadcaster(node).sendTransform(mount)  # usually in another process
    >>> buffer = Buffer()
    >>> with StaticTransformListener(buffer, node):
    ...     answer = buffer.lookup_transform("base_link", "camera", Time(), timeout=Duration(seconds=5))
    >>> answer.transform.translation.x
    0.3
    """

    def __init__(
        self,
        buffer: TransformSink,
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

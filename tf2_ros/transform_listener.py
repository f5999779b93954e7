# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Receive transforms from topics, and insert them into a buffer."""

import tf2_ros_cython._ros_requirement  # noqa: F401

import gc
import inspect
import os
from collections.abc import Callable
from typing import Any, Protocol

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.subscription import Subscription
from std_msgs.msg import Header

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_py._internal import MalformedObjectError, bool_of, class_name
from tf2_py.typing import Self
from tf2_ros._arguments import kind_of
from tf2_ros._frame_prefix import valid_prefix, with_prefix
from tf2_ros._nodes.ended_nodes import require_node
from tf2_ros._nodes.hidden_nodes import hidden_node
from tf2_ros._nodes.spinner import Spinner
from tf2_ros._process.forking import FORKED, is_inherited, refuse_inherited
from tf2_ros._process.inbox import AUTHORITY
from tf2_ros._qos import DYNAMIC_DEPTH, STATIC_DEPTH, transforms_qos
from tf2_ros._rcl import problem
from tf2_ros._rclpy import (
    destroy_subscription,
    is_node,
    is_read_by_loop,
    is_subscription,
    runs_in_loop,
    subscribe_in_loop,
)
from tf2_ros._receive.listener_receiver import ListenerGroup, Receiver
from tf2_ros._receive.listener_state import ListenerState
from tf2_ros._receive.listener_topics import Topic, describe_topics
from tf2_ros._sources import add_listener
from tf2_ros._wait.call_runners import call_queue_of
from tf2_ros.buffer import SETTERS, Buffer
from tf2_ros.records import Recording

__all__ = [
    "Buffer",
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "DurabilityPolicy",
    "HistoryPolicy",
    "Node",
    "QoSProfile",
    "TFMessage",
    "TransformListener",
]

DEFAULT_TF_TOPIC = "/tf"
DEFAULT_STATIC_TF_TOPIC = "/tf_static"
_CANNOT_RECORD = "recording= does not work with this listener"


class TransformSink(Protocol):
    """What a listener fills."""

    def set_transform(self, transform: TransformStamped, authority: str, /) -> object: ...
    def set_transform_static(self, transform: TransformStamped, authority: str, /) -> object: ...


class _SignatureOfInit:
    """The ``__signature__`` of a class whose ``__new__`` accepts anything: ``help`` shows __init__."""

    def __get__(self, instance: object, owner: type) -> inspect.Signature:
        signature = inspect.signature(owner.__init__)  # type: ignore[misc]
        return signature.replace(parameters=list(signature.parameters.values())[1:])


class TransformListener:
    """
    Subscribes to ``/tf`` and ``/tf_static``, and fills a buffer with what arrives.

    In most programs, the node need not be spun.

    :param buffer: a :class:`tf2_ros.Buffer`, or any object with its ``set_transform`` and
        ``set_transform_static``.
    :param node: gets the subscriptions. None: a hidden node, which a thread spins.
    :param spin_thread: spin the node in a thread, until its context ends or the node is destroyed. If another
        executor takes over the node, the thread stops serving it, as in tf2. The program exits only after the
        thread ends.
    :param qos: a profile, or the depth of the queue, for dynamic transforms. None: volatile, depth 100.
    :param static_qos: the same for static transforms; a depth alone means volatile, as in tf2. None:
        transient local, depth 10,000, so that none is lost, however many nodes publish them.
    :param tf_topic: the topic of dynamic transforms. Unlike the default, a name without a leading ``/`` is in
        the namespace of the node.
    :param tf_static_topic: the topic of static transforms.
    :param static_only: do not subscribe to dynamic transforms, as in :class:`StaticTransformListener`.
    :param prefix: put before all frame names that arrive, such as ``"robot1/"``. Several listeners may
        fill one buffer with the transforms of several robots. A leading ``/`` has no effect, because a buffer
        removes it; see :func:`tf2_py.stored_name`.
    :param recording: a :class:`tf2_ros.records.Recording`, which records the sender and time of each
        transform. Call its ``take`` regularly: it has a limited capacity.
    :raises NotImplementedError: ``recording`` is given, but an executor would take messages, see below.
    :raises TypeError: ``buffer`` has neither of the two methods, or is a class, or ``node`` is not a node.
    :raises ValueError: ``spin_thread`` is True for a node that an event loop runs, or ``prefix`` contains a
        NUL character.

    What has arrived is inserted before the buffer is read, whether the node is spun or not, and while
    callbacks block. The executor that spins the node inserts the transforms instead, as in tf2,

    - if a subclass overrides ``callback`` or ``static_callback``,
    - if the buffer is not a :class:`tf2_py.BufferCore`, or overrides a ``set_transform*`` method,
    - if the node overrides ``create_subscription``,
    - if rcl lacks a function that the receiver calls (Jazzy and Kilted have them all), or the middleware does
      not report arrivals.

    The property ``receives`` contains the topics that need no executor.

    Another buffer may be assigned to ``buffer`` at any time. The node keeps the listener alive.
    ``unregister()`` ends its subscriptions; the end of a ``with`` block also ends the thread that spins the
    node.

    Attributes: ``buffer``, ``node``, ``group`` (the callback group of the subscriptions), ``tf_sub``,
    ``tf_static_sub``; if a thread spins the node, also ``executor`` and ``dedicated_listener_thread``.

    >>> from rclpy.duration import Duration
    >>> from rclpy.time import Time
    >>> from tf2_ros import Buffer, StaticTransformBroadcaster, TransformListener
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> StaticTransformBroadcaster(node).sendTransform(mount)  # usually in another process
    >>> buffer = Buffer()
    >>> with TransformListener(buffer, node):
    ...     answer = buffer.lookup_transform("base_link", "camera", Time(), timeout=Duration(seconds=5))
    >>> answer.transform.translation.x
    0.3
    """

    # None where it does not exist, for example with static_only.
    tf_sub: Subscription | None = None
    tf_static_sub: Subscription | None = None

    _tf2_state = ListenerState()  # until __new__, which a signal handler may interrupt, has made its own

    __signature__ = _SignatureOfInit()

    def __new__(cls, *_: object, **__: object) -> "Self":
        # Here, because a subclass may not call __init__.
        self = super().__new__(cls)
        # This makes __dict__. If the finalizer made it, the collector would keep all to which it refers, such
        # as the node, until its next run.
        self.__dict__["_tf2_state"] = ListenerState()
        return self

    def __init__(
        self,
        buffer: TransformSink,
        node: Node | None = None,
        *,
        spin_thread: bool = False,
        qos: QoSProfile | int | None = None,
        static_qos: QoSProfile | int | None = None,
        tf_topic: str = DEFAULT_TF_TOPIC,
        tf_static_topic: str = DEFAULT_STATIC_TF_TOPIC,
        static_only: bool = False,
        prefix: str = "",
        recording: Recording | None = None,
    ) -> None:
        listening = self._tf2_state
        has_dynamic = not bool_of(static_only, "static_only")
        if node is not None:
            require_node(
                type(self).__name__, node, "create_subscription", buffer, "the buffer first, then the node"
            )
            if spin_thread and runs_in_loop(node):
                raise ValueError("spin_thread: expected False for a node that an event loop runs")
        listening.prefix = valid_prefix(prefix)
        listening.recording = recording
        listening.process = os.getpid()
        self.node = hidden_node("transform_listener_impl", self) if node is None else node
        listening.owns_node = node is None
        self.group = ListenerGroup()
        # Static transforms come last, and are taken first, because others may need them.
        topics = [
            Topic("tf_sub", "callback", tf_topic, qos, is_static=False),
            Topic("tf_static_sub", "static_callback", tf_static_topic, static_qos, is_static=True),
        ]
        listening.topics = [topic for topic in topics if topic.is_static or has_dynamic]
        for topic in listening.topics:
            topic.is_own = _is_method_of(TransformListener, self, topic.method)
        listening.buffer = buffer
        try:
            # A callback of a program's own may do without.
            if all(topic.is_own for topic in listening.topics):
                _require_buffer(type(self).__name__, buffer)
            if is_node(self.node):
                listening.call_queue = call_queue_of(self.node)
            self.__listen()
            add_listener(self)
            if spin_thread or listening.owns_node:
                self.__spin()
        except BaseException:
            self.__end()
            raise

    @property
    def buffer(self) -> Any:
        """The buffer that the listener fills; another one may be assigned."""
        return self._tf2_state.buffer

    @buffer.setter
    def buffer(self, buffer: TransformSink) -> None:
        listening = self._tf2_state
        refuse_inherited(self, listening.process)
        listening.buffer = buffer
        if listening.receiver is not None:
            listening.receiver.redirect(self.__direct_buffer())
        add_listener(self)

    @property
    def receives(self) -> tuple[str, ...]:
        """
        The topics whose transforms arrive without an executor.

        The executor that spins the node inserts the transforms of other topics. Empty after the end of the
        listener, and in a forked child.
        """
        receiver = self._tf2_state.receiver
        return () if receiver is None else tuple(topic.name for topic in receiver.topics)

    def unregister(self) -> None:
        """End the subscriptions and the hidden node; the buffer keeps its transforms."""
        self.__end(ends_thread=self._tf2_state.owns_node)

    def __del__(self) -> None:
        """
        End the thread that spins the node, and the subscriptions; may be called again.

        A call by a program waits for the thread, as in tf2. The collector runs in any thread, inside any
        function, so there this must not wait.
        """
        self.__end(waits=not gc.is_finalized(self))

    def __enter__(self) -> "Self":
        return self

    def __exit__(self, *_: object) -> None:
        self.__end()

    def __end(self, *, ends_thread: bool = True, waits: bool = True) -> None:
        listening = self._tf2_state
        if is_inherited(listening.process):
            return  # it belongs to the parent
        if listening.spinner is not None and ends_thread:
            listening.spinner.stop(wait=waits)
        if not listening.owns_node:
            # A subclass that does not call __init__ makes the first two itself.
            for name in ("tf_sub", "tf_static_sub"):
                if self.__dict__.get(name) is not None:
                    destroy_subscription(self.node, self.__dict__[name])
        elif listening.spinner is None:
            self.node.destroy_node()  # otherwise its thread does

    def __repr__(self) -> str:
        """Describe the topics: how many messages were received, and when the last one was."""
        listening = self._tf2_state
        name = class_name(type(self))
        if is_inherited(listening.process):
            return f"<{name}: {FORKED}>"
        receiver = listening.receiver
        origin = describe_topics(listening.topics) if receiver is None else receiver.describe()
        return f"<{name} of {origin}>" if origin else f"<{name} without subscriptions of rclpy's>"

    def callback(self, data: TFMessage) -> None:
        """Insert the transforms of a message into the buffer; a subclass may do something else."""
        self.__insert("callback", data, self.buffer.set_transform)

    def static_callback(self, data: TFMessage) -> None:
        """Insert the static transforms of a message into the buffer; a subclass may do something else."""
        self.__insert("static_callback", data, self.buffer.set_transform_static)

    def __insert(self, method: str, data: TFMessage, insert: Callable[..., object]) -> None:
        """Count a message for this method, and insert its transforms with the prefix."""
        listening = self._tf2_state
        for topic in listening.topics:
            if topic.method == method:
                topic.arrivals.count()
        for transform in data.transforms:
            insert(_prefixed(listening.prefix, transform), AUTHORITY)

    def __direct_buffer(self) -> BufferCore | None:
        """The buffer; None if user code would handle what is received or inserted."""
        listening = self._tf2_state
        buffer: Any = listening.buffer
        is_direct = (
            isinstance(buffer, BufferCore)
            and all(topic.is_own for topic in listening.topics)
            and all(_is_method_of(BufferCore, buffer, name) for name in SETTERS)
            # A node may make subscriptions of its own kind, or let a loop take their messages.
            and (runs_in_loop(self.node) or _is_method_of(Node, self.node, "create_subscription"))
        )
        return buffer if is_direct else None

    def __why_executor(self) -> str:
        """Why an executor has to insert the transforms; ``""`` if it need not."""
        call_queue = self._tf2_state.call_queue
        if call_queue is None or self.__direct_buffer() is None:
            return "this program overrides how transforms are inserted"
        if not call_queue.runner.uses_wait_sets:
            return "an EventsExecutor has the arrivals of its node reported to itself"
        return problem() or ""

    def __listen(self) -> None:
        """Subscribe, as this listener was asked to, and decide what takes the messages."""
        listening = self._tf2_state
        reason = self.__why_executor()
        needs_executor = reason != ""
        if listening.recording is not None and needs_executor:
            raise NotImplementedError(f"{_CANNOT_RECORD}: {reason}")
        # The receiver is not informed of messages that arrive while an executor waits for the subscription.
        self.group.hides_all = not needs_executor
        try:
            for topic in listening.topics:
                self.__subscribe(topic, needs_executor)
            made = [topic.subscription for topic in listening.topics]
            if not needs_executor and all(made) and not any(is_read_by_loop(self.node, one) for one in made):
                listening.receiver = Receiver(self, listening.call_queue, self.__direct_buffer())
                if not listening.call_queue.runner.uses_wait_sets:
                    self.__subscribe_anew(listening.receiver)
        finally:
            self.group.hides_all = False
        if listening.recording is not None and not self.receives:
            reason = self.__why_executor() or "the middleware does not report arrivals"
            raise NotImplementedError(f"{_CANNOT_RECORD}: {reason}")

    def __subscribe(self, topic: Topic, needs_executor: bool) -> None:
        qos = topic.qos
        if qos is None:
            depth = STATIC_DEPTH if topic.is_static else DYNAMIC_DEPTH
            qos = transforms_qos(depth, is_static=topic.is_static)
        arguments = TFMessage, topic.name, getattr(self, topic.method), qos
        if not runs_in_loop(self.node):
            made = self.node.create_subscription(*arguments, callback_group=self.group)
        elif needs_executor:
            made = self.node.create_subscription(*arguments)
        else:
            made = subscribe_in_loop(self.node, *arguments)
        setattr(self, topic.attribute, made)
        if is_subscription(made):
            topic.begin(self.node, made)

    def __subscribe_anew(self, receiver: Receiver) -> None:
        """Leave all to an ``EventsExecutor`` that took the node while this subscribed."""
        # The middleware reports arrivals only to whichever of the two registered last; that may be either.
        receiver.redirect(None)
        for topic in self._tf2_state.topics:
            destroy_subscription(self.node, topic.subscription)
            self.__subscribe(topic, needs_executor=True)

    def __spin(self) -> None:
        listening = self._tf2_state
        # Only the listener uses a hidden node; a program's own keeps the program alive.
        owns = listening.owns_node
        spinner = Spinner(self.node, daemon=owns, at_end=self.node.destroy_node if owns else None)
        listening.spinner = spinner
        self.executor = spinner.executor
        self.dedicated_listener_thread = spinner.thread


def _is_method_of(kind: type, one: object, name: str) -> bool:
    """Whether an object's method is that of a class, and no other code."""
    method = getattr(one, name)
    return getattr(method, "__func__", None) is getattr(kind, name) and method.__self__ is one


def _require_buffer(call: str, buffer: object) -> None:
    """Refuse what no transform can be inserted into; as an AttributeError, which tf2 raises for the first."""
    if isinstance(buffer, type) or not (
        hasattr(buffer, "set_transform") or hasattr(buffer, "set_transform_static")
    ):
        got = kind_of(buffer) + ("; pass the buffer first, then the node" if is_node(buffer) else "")
        raise MalformedObjectError(f"{call}: expected a buffer with set_transform, got {got}")


def _prefixed(prefix: str, transform: TransformStamped) -> TransformStamped:
    """The same transform between frames with a prefix, if there is one."""
    if not prefix:
        return transform
    header = Header(stamp=transform.header.stamp, frame_id=with_prefix(prefix, transform.header.frame_id))
    child = with_prefix(prefix, transform.child_frame_id)
    return TransformStamped(header=header, child_frame_id=child, transform=transform.transform)

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fill a buffer with what arrives from a robot, over any wire."""

import atexit
import logging
import os
import threading
import time
from collections import deque
from dataclasses import dataclass
from operator import index
from typing import Any, TypeVar, cast

from tf2_py.printable import counted, printable
from tf2_ros import Buffer
from tf2_ros.records import Recording
from tf2_ros.serialization import MessageSource, insert_messages
from tf2_ros_tools.common.bools import bool_of
from tf2_ros_tools.common.output import span
from tf2_ros_tools.live.broadcaster import OWN, Broadcaster, StaticBroadcaster
from tf2_ros_tools.live.transport import Publisher, Sender, Wire

S = 1_000_000_000
PERIOD_NS = 10 * S  # of the smallest delays that are kept, for the offset of the clocks
PERIODS = 6
BYTES = (bytes, bytearray, memoryview)
SILENT_S = 3.0  # without a message: from then on, errors say so
AHEAD_S, BEHIND_S = 0.01, 1.0  # from these offsets of the clocks on, a feed warns
LEAP_NS = 10 * S  # from one message of a topic to another: the clock of the robot was set
POLL_S = 0.01
FORKED = "this feed belongs to the parent process: create a new one after the fork"

B = TypeVar("B", bound=Broadcaster)


@dataclass(frozen=True)
class Heard:
    """
    What a feed has received on a topic.

    Fields: ``count``, the number of messages; ``lost``, how many were lost, or None if the transport
    does not count losses; ``malformed``, how many more could not be read; ``last``, the seconds since the
    last message, or None if there was none; ``rate``, messages per second, from the times at which
    they were sent or, if these are unknown, received, since the last leap of these times by more than 10 s
    (the clock of a robot was set); None if fewer than two were received since.
    """

    count: int
    lost: int | None
    malformed: int
    last: float | None
    rate: float | None = None


class _Topic:
    def __init__(self, name: str, counts_losses: bool) -> None:
        self.name = name
        self.count = self.malformed = 0
        self.lost = 0 if counts_losses else None
        self.last_ns: int | None = None  # of the monotonic clock
        # For the rate: the number of the first message since the last leap of the clock, and when the
        # earliest and the latest one since were sent. The clock is the sender's, if it is known: several
        # messages arrive at once when the sender has been found.
        self.first, self.earliest_ns, self.latest_ns = 0, 0, 0

    def note(self, sent_ns: int) -> None:
        self.count += 1
        self.last_ns = time.monotonic_ns()
        if not self.first or not self.earliest_ns - LEAP_NS <= sent_ns <= self.latest_ns + LEAP_NS:
            self.first, self.earliest_ns, self.latest_ns = self.count, sent_ns, sent_ns
        self.earliest_ns = min(self.earliest_ns, sent_ns)
        self.latest_ns = max(self.latest_ns, sent_ns)

    def heard(self) -> Heard:
        if (last_ns := self.last_ns) is None:
            return Heard(self.count, self.lost, self.malformed, None)
        last = (time.monotonic_ns() - last_ns) / S
        lasted_ns = self.latest_ns - self.earliest_ns
        rate = (self.count - self.first) * S / lasted_ns if lasted_ns else None
        return Heard(self.count, self.lost, self.malformed, last, rate)


class Feed:
    """
    Fills a buffer with the transforms of a robot.

    :func:`connect` makes a feed that receives over a transport (DDS, Zenoh or foxglove_bridge). A program
    that receives messages in another way makes a feed itself, and calls :meth:`take` for each message.

    :param buffer: the buffer to fill. None: a new ``Buffer``.
    :param name: the name of the source in error texts.
    :param topics: the topic of dynamic transforms and the topic of static transforms.
    :param prefix: a text to put in front of the names of all frames that arrive.
    :param wire: the transport, for :func:`connect`.
    :param recording: records who sent which transform when.
    :raises TypeError: ``name`` or ``prefix`` is not a str.
    :raises ValueError: ``name`` or ``prefix`` contains a NUL character.
    :raises ConnectionError: the transport cannot receive; the text says what to do.

    The attribute ``buffer`` is what the feed fills. A ``with`` statement closes the feed.
    """

    def __init__(
        self,
        buffer: Buffer | None = None,
        *,
        name: str = "the feed",
        topics: tuple[str, str] = ("/tf", "/tf_static"),
        prefix: str = "",
        wire: Wire | None = None,
        recording: Recording | None = None,
    ) -> None:
        MessageSource(_text("name", name), False, _text("prefix", prefix))  # raises what is wrong with them
        self._process = os.getpid()
        self._recording = recording
        self.buffer = Buffer() if buffer is None else buffer
        self._name = name
        counts_losses = wire is None or wire.counts_losses
        self._topics = tuple(_Topic(topic, counts_losses) for topic in topics)
        self._prefix = prefix
        self._wire = wire
        # Held by `take` only, while it counts. An RLock, because a signal handler may interrupt it there.
        self._counting = threading.RLock()
        self._source = self.buffer.add_source(name, self._silence)  # whose end ends the waits in the buffer
        self._delays: deque[tuple[int, int]] = deque(maxlen=PERIODS)  # the number of a period, and ns
        self._warned_of_clock = False
        self._broadcasters: dict[type[Broadcaster], Broadcaster] = {}
        if wire is not None:
            # When Python ends, no thread of the wire must be in its library, or start another one.
            atexit.register(self.close)
            try:
                wire.open(self._take_of_wire, self._source.end)
            except BaseException:
                self.close("it could not be opened")
                raise

    def __enter__(self) -> "Feed":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def take(
        self,
        data: bytes | memoryview,
        is_static: bool,
        publisher: str = "",
        sent_ns: int = 0,
        lost: int = 0,
        gid: bytes = b"",
    ) -> None:
        """
        Insert the transforms of a message. Any thread may call it; after :meth:`close` it does nothing.

        :param data: a serialized TFMessage: CDR of either byte order, with its encapsulation header.
        :param is_static: whether its transforms are valid at all times.
        :param publisher: the name of whoever sent it; listings and log lines show it. ``""``: not known.
        :param sent_ns: when it was sent, by the clock of the robot, in ns since 1970. 0: not known.
        :param lost: how many messages of this publisher were lost since its last one.
        :param gid: the publisher in ``recording``. Empty: ``publisher``.
        :raises TypeError: ``data`` is not bytes, a bytearray or a memoryview, or another argument has the
            wrong type.
        :raises ValueError: ``publisher`` contains a NUL character.
        :raises RuntimeError: this is a forked child of the process that made the feed.

        A malformed message is counted, and the first of each topic is logged. The buffer logs and counts the
        transforms that it refuses.
        """
        self._refuse_fork()
        if not isinstance(data, BYTES):
            raise TypeError(f"data: expected bytes or a memoryview, got {type(data).__name__}")
        if isinstance(data, memoryview) and not data.c_contiguous:
            data = data.tobytes()
        is_static = bool_of(is_static, "is_static")
        sent_ns, lost = index(sent_ns), index(lost)  # raises a TypeError before anything is inserted
        source = MessageSource(publisher or self._name, is_static, self._prefix, gid)
        if self._source.why_ended():
            return
        received_ns = time.time_ns()
        malformed = None
        try:
            self._insert(data, source, received_ns)
        except ValueError as error:
            malformed = error
        with self._counting:
            topic = self._topics[is_static]
            if topic.lost is not None:
                topic.lost += lost
            if malformed is None:
                topic.note(sent_ns or received_ns)
            else:
                topic.malformed += 1
            # A latched message was sent at any time.
            warning = self._note_delay(received_ns - sent_ns) if sent_ns and not is_static else ""
        if malformed is not None and topic.malformed == 1:
            sender = printable(publisher or self._name)
            _log().error(f"Ignoring a malformed message on {topic.name} from {sender}: {malformed}")
        if warning:
            _log().warning(warning)

    @property
    def topics(self) -> dict[str, Heard]:
        """
        What was received on each topic: a :class:`Heard` by the name of the topic.

        :raises RuntimeError: this is a forked child of the process that made the feed.
        """
        self._refuse_fork()
        return {topic.name: topic.heard() for topic in self._topics}

    @property
    def clock_offset(self) -> float | None:
        """
        The clock of this machine minus the robot's, in seconds, including the network delay: the shortest
        time from sending to reception in the last minute. None if unknown.

        Ages, as for ``max_age``, are off by this amount, because they compare stamps of the robot with the
        clock of this machine.

        :raises RuntimeError: this is a forked child of the process that made the feed.
        """
        self._refuse_fork()
        oldest = time.monotonic_ns() // PERIOD_NS - PERIODS
        delays = [delay_ns for period, delay_ns in self._delays.copy() if period > oldest]
        return min(delays) / S if delays else None

    def publishers(self) -> list[Publisher]:
        """The publishers on the two topics; an empty list for a feed that :func:`connect` did not make."""
        self._refuse_fork()
        return [] if self._wire is None else self._wire.publishers()

    def wait_until_heard(self, seconds: float) -> None:
        """
        Wait until a message was received on each of the two topics.

        :param seconds: how long to wait.
        :raises TimeoutError: nothing was received on a topic; the text says on which one, and why, if known.
        :raises ConnectionError: the feed has ended.
        :raises RuntimeError: this is a forked child of the process that made the feed.
        """
        deadline_s = time.monotonic() + seconds
        while True:
            self._require_open()
            missing, left_s = self._missing(), deadline_s - time.monotonic()
            if not missing:
                return
            if left_s <= 0:
                raise TimeoutError(self._why_missing(missing, seconds))
            time.sleep(min(left_s, POLL_S))

    def why_ended(self) -> str:
        """
        Return a text that says that the feed has ended, and why; ``""`` while it receives.

        In a forked child, the feed of the parent has ended.
        """
        return self._source.why_ended() or ("" if self._process == os.getpid() else FORKED)

    def why_silent(self, seconds: float) -> str:
        """
        Return a text that says on which of the two topics nothing was received, and why, if that is known.

        :param seconds: how long this program has listened, for the text.
        :return: a text; :meth:`why_ended` if the feed has ended; ``""`` if a message was received on both.
        :raises RuntimeError: this is a forked child of the process that made the feed.
        """
        self._refuse_fork()
        if why := self.why_ended():
            return why
        missing = self._missing()
        return self._why_missing(missing, seconds) if missing else ""

    def broadcaster(self) -> Broadcaster:
        """
        Get the broadcaster of transforms on the topic of this feed, the same each time.

        The first call makes it. Listeners receive what is sent after they have found it.

        :raises ConnectionError: the feed only receives, as over foxglove_bridge or with :meth:`take`, or has
            ended.
        :raises RuntimeError: this is a forked child of the process that made the feed.
        """
        return self._made(Broadcaster, is_static=False)

    def static_broadcaster(self) -> StaticBroadcaster:
        """
        Get the broadcaster of static transforms on the static topic of this feed, the same each time.

        Listeners that start later also receive what it has sent, until the feed closes. It raises what
        :meth:`broadcaster` raises.
        """
        return self._made(StaticBroadcaster, is_static=True)

    def close(self, reason: str = "it was closed") -> None:
        """
        End the feed and its broadcasters. Lookups and awaits in the buffer end, too, unless something else
        fills it. The buffer keeps what it holds.

        It may be called several times, and in any thread. In a forked child it does nothing.

        :param reason: why it ends, for errors.
        """
        if self._process != os.getpid():
            return  # the wire belongs to the parent
        self._source.end(reason)
        atexit.unregister(self.close)
        if self._wire is not None:
            self._wire.close()

    def _take_of_wire(self, *message: Any, **more: Any) -> None:
        # A library would lose an exception, or end its thread.
        try:
            self.take(*message, **more)
        except Exception:
            _log().exception(f"{self._name}: a message could not be inserted")

    def _insert(self, data: bytes | memoryview, source: MessageSource, received_ns: int) -> None:
        message = (source.topic, received_ns, data)
        insert_messages(self.buffer, [message], [source], recording=self._recording)

    def _note_delay(self, delay_ns: int) -> str:
        """Note the time from sending to receiving; return a warning, once, if the clocks differ."""
        period = time.monotonic_ns() // PERIOD_NS
        is_new = not self._delays or self._delays[-1][0] != period
        is_behind = bool(self._delays) and is_new and self._delays[-1][1] > BEHIND_S * S
        if is_new:
            self._delays.append((period, delay_ns))
        elif delay_ns < self._delays[-1][1]:
            self._delays[-1] = period, delay_ns
        if self._warned_of_clock or not (is_behind or delay_ns < -AHEAD_S * S):
            return ""
        self._warned_of_clock = True
        offset_s = min(delay for _, delay in self._delays) / S
        differs = f"the clock of the robot is {span(-offset_s)} ahead of the clock of this machine"
        if offset_s > 0:
            differs = f"messages arrive {span(offset_s)} after the robot sent them"
        return (
            f"{self._name}: {differs}, so max_age is off by as much. Synchronize the clocks, for example "
            "with chrony"
        )

    def _missing(self) -> list[_Topic]:
        return [topic for topic in self._topics if topic.last_ns is None]

    def _why_missing(self, missing: list[_Topic], seconds: float) -> str:
        names = " or ".join(topic.name for topic in missing)
        text = f"nothing has been received on {names} in {span(seconds)}"
        heard = [topic for topic in self._topics if topic not in missing]
        if heard:
            messages = counted(heard[0].count, "message")
            received = f"{heard[0].name} is received ({messages})"
            text = f"{received}, but nothing on {names} in {span(seconds)}"
        return text + self._reasons(missing, seconds)

    def _silence(self, with_static: bool) -> str:
        """What has not been received, for the errors of lookups."""
        if self._process != os.getpid():
            return f"{self._name}: {FORKED}"
        heard = [(topic, topic.heard().last) for topic in self._topics[: 1 + with_static]]
        missing = [topic for topic, last in heard if last is None]
        parts = [f"on {topic.name}" for topic in missing]
        # Static transforms are sent once.
        if (last := heard[0][1]) is not None and last >= SILENT_S:
            parts.append(f"on {heard[0][0].name} for {span(last)}")
        if not parts:
            return ""
        return f"nothing has been received {' or '.join(parts)}{self._reasons(missing, SILENT_S)}"

    def _reasons(self, missing: list[_Topic], seconds: float) -> str:
        unread = [topic.malformed for topic in missing if topic.malformed]
        reasons = [f"{counted(number, 'message')} could not be read" for number in unread]
        if self._wire is not None:
            silent = [topic for topic in missing if not topic.malformed]
            reasons += [printable(self._wire.why_silent(topic.name, seconds)) for topic in silent]
        found = "; ".join(filter(None, dict.fromkeys(reasons)))
        return f": {found}" if found else ""

    def _made(self, kind: type[B], is_static: bool) -> B:
        """The broadcaster of this kind."""
        self._require_open()
        if self._wire is None:
            raise ConnectionError(f"{self._name} cannot send; use a feed from connect()")
        if kind not in self._broadcasters:
            sender = self._wire.sender(self._topics[is_static].name, is_static)
            # Another thread may have made one meanwhile.
            self._broadcasters.setdefault(kind, kind(_Echo(self, sender, is_static), self._require_open))
        return cast(B, self._broadcasters[kind])

    def _require_open(self) -> None:
        self._refuse_fork()
        if why := self.why_ended():
            raise ConnectionError(why)

    def _refuse_fork(self) -> None:
        if self._process != os.getpid():
            raise RuntimeError(FORKED)


class _Echo:
    """Inserts what it sends into the buffer, too; the wire does not receive it again."""

    def __init__(self, feed: Feed, sender: Sender, is_static: bool) -> None:
        self._feed, self._sender = feed, sender
        self._source = MessageSource(OWN, is_static, feed._prefix)

    def send(self, data: bytes) -> None:
        self._sender.send(data)
        self._feed._insert(data, self._source, time.time_ns())


def _text(name: str, value: object) -> str:
    if not isinstance(value, str):
        raise TypeError(f"{name}: expected a str, got {type(value).__name__}")
    return value


def _log() -> logging.Logger:
    return logging.getLogger("tf2_ros_tools.live")

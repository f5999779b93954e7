"""
Owns a random state machine over a buffer and its waiters.

After every step no waiter is pending whose lookup would answer. As a program it takes any number of steps:
`python tests/support/waiters_random.py --steps 1000000 --seed 7`. A failure is printed as a short sequence of
steps, which `--replay FILE` runs again.
"""

import argparse
import ast
import itertools
import random
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any

from geometry_msgs.msg import TransformStamped
from making import S, at_ns, transform
from rclpy.duration import Duration
from rclpy.logging import LoggingSeverity, get_logger_level, set_logger_level

from tf2_py import BufferCore, TransformException
from tf2_ros import Buffer

FRAMES = ("a", "b", "c", "d", "e", "f", "g", "h")
UNKNOWN = "unknown"  # never inserted
CACHE_TIMES_NS = (5, 10, 10, 20)
STEPS = 150  # of one sequence: each begins with an empty buffer
MOST_LINKS = 4  # of one batch
MOST_PENDING = 10  # the oldest waiter makes room for a new one: each is asked for after every step
AUTHORITY = "random"

# A step is a tuple: the name of an operation of the machine, and its arguments. Dropping any step leaves a
# sequence that can be run. A lookup is (target, source, ns), or (target, source, ns, fixed, target ns).
Step = tuple[Any, ...]
Lookup = tuple[Any, ...]
Link = tuple[str, str, int, int]  # parent, child, ns, x in m
Change = Callable[[BufferCore], None]


class Broken(AssertionError):
    """An invariant that does not hold."""


def require(condition: object, what: str, *facts: object) -> None:
    if not condition:
        raise Broken(f"{what}: {', '.join(map(repr, facts))}" if facts else what)


@cache
def _time(ns: int):
    return at_ns(ns)


# Buffers keep nothing of a message; making one takes longer than the rest of a step.
_MESSAGES = [transform("", "") for _ in range(MOST_LINKS)]


def _messages(links: Sequence[Link]) -> list[TransformStamped]:
    """Messages of these links, until the next call."""
    filled = _MESSAGES[: len(links)]
    for message, (parent, child, ns, x) in zip(filled, links, strict=True):
        message.header.frame_id, message.child_frame_id = parent, child
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, S)
        message.transform.translation.x = float(x)
    return filled


def _question(buffer: BufferCore, lookup: Lookup) -> Callable[[], tuple[int, str]]:
    if len(lookup) == 3:
        target, source, ns = lookup
        return partial(buffer.can_transform_core, target, source, _time(ns))
    target, source, ns, fixed, target_ns = lookup
    return partial(buffer.can_transform_full_core, target, _time(target_ns), source, _time(ns), fixed)


def _answer(buffer: BufferCore, lookup: Lookup):
    """What a lookup answers now, or None."""
    try:
        if len(lookup) == 3:
            target, source, ns = lookup
            return buffer.lookup_transform_core(target, source, _time(ns))
        target, source, ns, fixed, target_ns = lookup
        return buffer.lookup_transform_full_core(target, _time(target_ns), source, _time(ns), fixed)
    except TransformException:
        return None


class Waiter:
    """
    One waiter by one of the interfaces, and what it has received.

    `notified`: BufferCore._wait with a function. `blocking`: without one. `future`: of the Buffer. `called`:
    a future with a callback, which nobody needs to hold.
    """

    def __init__(self, kind: str, lookup: Lookup, buffer: Buffer, deliveries: list) -> None:
        self.kind, self.lookup = kind, lookup
        self.question = _question(buffer, lookup)
        self._received: list = []
        self._deliveries = deliveries
        if kind in ("notified", "blocking"):
            target, source, ns, *rest = lookup
            more = (rest[0], _time(rest[1])) if rest else ()
            notify = self._receive if kind == "notified" else None
            self.handle = buffer._wait(target, source, _time(ns), *more, notify=notify)
            return
        if len(lookup) == 3:
            target, source, ns = lookup
            self.handle = buffer.wait_for_transform_async(target, source, _time(ns))
        else:
            target, source, ns, fixed, target_ns = lookup
            self.handle = buffer.wait_for_transform_full_async(
                target, _time(target_ns), source, _time(ns), fixed
            )
        if kind == "called" and not self.handle.done():
            self.handle.add_done_callback(self._called)

    def _called(self, future) -> None:
        if not future.cancelled():
            self._receive(future.result())

    def _receive(self, answer) -> None:
        self._received.append(answer)
        self._deliveries.append(self)

    @property
    def notifies(self) -> bool:
        return self.kind in ("notified", "called")

    def immediate(self):
        """The answer that was available when the wait began, or None."""
        if self.kind in ("notified", "blocking"):
            return self.handle.answer
        return self.handle.result() if self.handle.done() else None

    def answer(self):
        """What it received, or None."""
        if self.notifies:
            return self._received[0] if self._received else None
        return self.immediate()

    def cancel(self) -> None:
        if self.kind in ("notified", "blocking"):
            require(self.handle.cancel() is True, "cancel() says that a pending wait was over", self)
        else:
            self.handle.cancel()
            require(self.handle.cancelled(), "a pending future cannot be cancelled", self)

    def __repr__(self) -> str:
        return f"{self.kind} waiter for {self.lookup}"


class Machine:
    """
    A buffer with waiters, beside one that receives the same transforms and has none.

    The second one tells what a lookup answered at the moment of an insert.
    """

    def __init__(self, make_buffer: Callable[[Duration], Buffer] = Buffer) -> None:
        self.buffer = make_buffer(Duration(nanoseconds=10))
        self.alone = BufferCore(Duration(nanoseconds=10))
        self.pending: list[Waiter] = []
        self.over: list[Waiter] = []  # cancelled or answered, and held
        self.deliveries: list[Waiter] = []  # that nobody has accounted for

    def step(self, step: Step) -> None:
        name, *arguments = step
        getattr(self, f"do_{name}")(*arguments)
        self._check()

    # Transforms.

    def do_insert(self, parent: str, child: str, ns: int, x: int, static: bool) -> None:
        [message] = _messages([(parent, child, ns, x)])

        def insert(buffer: BufferCore) -> None:
            if static:
                buffer.set_transform_static(message, AUTHORITY)
            else:
                buffer.set_transform(message, AUTHORITY)

        self._change(insert, [insert])

    def do_batch(self, links: Sequence[Link], static: bool) -> None:
        messages = _messages(links)

        def insert(messages: list, buffer: BufferCore) -> None:
            buffer.set_transforms(messages, AUTHORITY, static)

        self._change(partial(insert, messages), [partial(insert, [message]) for message in messages])

    def do_clear(self) -> None:
        self._change(BufferCore.clear, [BufferCore.clear])

    def do_init(self, cache_ns: int) -> None:
        def begin_again(buffer: BufferCore) -> None:
            BufferCore.__init__(buffer, Duration(nanoseconds=cache_ns))

        self._change(begin_again, [begin_again])

    def _change(self, whole: Change, parts: list[Change]) -> None:
        # Whoever is answered has the answer of a lookup after one of the parts, and hears of it once; of one
        # part's answers in the order in which the waits began.
        whole(self.buffer)
        answered = [waiter for waiter in self.pending if waiter.answer() is not None]
        possible: dict[Waiter, list] = {waiter: [] for waiter in answered}
        for part in parts:
            part(self.alone)
            for waiter in answered:
                possible[waiter].append(_answer(self.alone, waiter.lookup))
        for waiter in answered:
            require(waiter.answer() in possible[waiter], "an answer that no lookup gave", waiter)
            self._retire(waiter)
        told = [waiter for waiter in answered if waiter.notifies]
        heard = list(self.deliveries)
        self.deliveries.clear()
        if len(parts) > 1:
            told, heard = sorted(told, key=id), sorted(heard, key=id)
        require(told == heard, "those who are answered are not those who were told", told, heard)

    # Waiters.

    def do_wait(self, kind: str, lookup: Lookup) -> None:
        available = _answer(self.buffer, lookup)
        if kind == "at once":
            self._wait_at_once(lookup, available)
            return
        waiter = Waiter(kind, lookup, self.buffer, self.deliveries)
        require(waiter.immediate() == available, "a wait began with another answer than a lookup's", waiter)
        require(not self.deliveries, "an answer that was available at once was delivered, too", waiter)
        if available is None:
            self.pending.append(waiter)
        if len(self.pending) > MOST_PENDING:
            self.do_cancel(0)

    def _wait_at_once(self, lookup: Lookup, available) -> None:
        target, source, ns, *rest = lookup
        more = (rest[0], _time(rest[1])) if rest else ()
        wait = self.buffer._wait(target, source, _time(ns), *more)
        require(wait.wait_for(0, lambda: True) == (available is not None), "wait_for() of 0 s", lookup)
        require(wait.answer == available, "wait_for() of 0 s has another answer than a lookup", lookup)

    def do_cancel(self, index: int) -> None:
        if self.pending:
            waiter = self.pending[index % len(self.pending)]
            waiter.cancel()
            self._retire(waiter)

    def do_drop(self, index: int) -> None:
        if self.pending:
            waiter = self.pending[index % len(self.pending)]
            if waiter.kind != "called":  # that one lives by its callback
                del waiter.handle
                self.pending.remove(waiter)

    def do_block(self, index: int) -> None:
        blocking = [waiter for waiter in self.pending if waiter.kind == "blocking"]
        if blocking:
            waiter = blocking[index % len(blocking)]
            require(not waiter.handle.wait_for(0, lambda: True), "wait_for() found an answer late", waiter)
            self._retire(waiter)

    def _retire(self, waiter: Waiter) -> None:
        self.pending.remove(waiter)
        self.over.append(waiter)

    # What always holds.

    def _check(self) -> None:
        for waiter in self.pending:
            require(not waiter.question()[0], "pending, and its lookup would answer", waiter)
        waiters = self.buffer.statistics()["waiters"]
        require(waiters == len(self.pending), "statistics() counts other waiters", waiters, self.pending)
        require(not self.deliveries, "told, and not pending", self.deliveries)
        self.buffer._self_check()


class Author:
    """Writes one sequence: frames that move on, and mostly stay where they belong."""

    def __init__(self, dice: random.Random) -> None:
        self._dice = dice
        self._frames = FRAMES[: dice.choice((4, 4, 5, 5, 6, 8))]
        self._loops = dice.random() < 0.3
        # A frame that has a parent nowhere ends its tree; so there is more than one tree.
        roots = 0 if self._loops else dice.choice((1, 2, 2, 3))
        self._static_share = dice.choice((0.0, 0.05, 0.3))
        self._cache_ns = dice.choice(CACHE_TIMES_NS)
        self._now = dice.randint(1, 30)
        self._home = {child: self._any_parent(child) for child in self._frames[roots:]}
        # Most frames keep their parent: where all change it, each insert changes the tree, and hides what a
        # waiter that looks at less would miss.
        self._restless = dice.sample(list(self._home), dice.choice((0, 1, 1, 1, len(self._home))))
        self._child = self._frames[-1]
        self._parents = dict(self._home)  # now; of some frames it is another one for a while
        self._last: dict[str, tuple[str, int, int]] = {}  # what each frame was last inserted with
        self._newest: dict[str, int] = {}

    def steps(self, count: int) -> Iterator[Step]:
        yield ("init", self._cache_ns)
        kinds = {
            self._insert: 50,
            self._batch: 6,
            self._pause: 3,
            self._tie: 4,
            self._wait: 30,
            self._end_wait: 8,
            self._clear: 2,
            self._init: 0.3,
        }
        for make in self._dice.choices(list(kinds), list(kinds.values()), k=count - 1):
            step = make()
            if isinstance(step, list):
                yield from step
            else:
                yield step

    def _any_parent(self, child: str) -> str:
        # Without loops each frame hangs from one that comes before it.
        if self._loops:
            return self._dice.choice([frame for frame in self._frames if frame != child])
        return self._dice.choice(self._frames[: self._frames.index(child)])

    def _link(self, child: str | None = None) -> Link:
        dice = self._dice
        if child is None and dice.random() < 0.5:
            child = dice.choice(list(self._home))
        self._child = child = child or self._child  # often the one of the step before
        if child in self._restless and dice.random() < 0.3:
            self._parents[child] = dice.choice((self._any_parent(child), self._home[child]))
        if child in self._last and dice.random() < 0.08:
            parent, ns, x = self._last[child]
            link = (parent, child, ns, dice.choice((x, x + 1)))  # repeated, or of an equal stamp
        else:
            link = (self._parents[child], child, self._stamp(child), dice.randint(0, 9))
        self._last[child] = (link[0], link[2], link[3])
        self._newest[child] = max(link[2], self._newest.get(child, 0))
        return link

    def _stamp(self, child: str) -> int:
        dice = self._dice
        newest = self._newest.get(child, self._now)
        old_end = newest - self._cache_ns
        kind = dice.random()
        if kind < 0.65:
            self._now += dice.randint(0, 2)
            return self._now
        if kind < 0.71:
            self._now += dice.randint(self._cache_ns - 1, self._cache_ns + 2)  # leaves nothing but this one
            return self._now
        if kind < 0.8:
            return max(0, dice.randint(old_end, newest))  # late
        if kind < 0.86:
            return max(0, old_end + dice.randint(-1, 1))
        return max(0, old_end - dice.randint(1, 10))  # too old

    def _insert(self) -> Step:
        return ("insert", *self._link(), self._dice.random() < self._static_share)

    def _pause(self) -> list[Step]:
        # A frame is silent for longer than the cache time, and then a message from before that comes late.
        parent, child, ns, x = self._link(self._dice.choice(self._restless or list(self._home)))
        before, self._now = ns, max(ns, self._now) + self._cache_ns + self._dice.randint(1, 5)
        after = ("insert", parent, child, self._now, x, False)
        late = ("insert", parent, child, before + self._dice.randint(0, 2), x, False)
        return [("insert", parent, child, before, x, False), after, self._wait(), late]

    def _tie(self) -> list[Step]:
        # A frame has several parents at one stamp, and another frame has a sample of that stamp, too. Which
        # parent answers depends on whether it is the oldest stamp: an older sample is inserted, or pruned.
        dice = self._dice
        child, other = (dice.choice(self._restless or list(self._home)), dice.choice(list(self._home)))
        ns = self._now = self._now + dice.randint(0, 3)
        older = max(0, ns - dice.randint(1, self._cache_ns))
        newer = ns + dice.randint(1, self._cache_ns)
        tied = [(dice.choice((self._home[child], self._any_parent(child))), child, ns) for _ in range(3)]
        around = [
            (self._home[other], other, ns),
            (self._home[child], child, older),
            (tied[0][0], child, newer),
        ]
        before = tied + dice.sample(around, dice.randint(0, 3))
        dice.shuffle(before)
        self._child = dice.choice((child, other))
        waits = [self._wait() for _ in range(2)]
        after = [(tied[0][0], child, older + self._cache_ns + dice.randint(0, 2)), around[1]]
        self._now = max(ns, newer)
        return [
            *(("insert", *link, dice.randint(0, 9), False) for link in before),
            *waits,
            *(("insert", *link, dice.randint(0, 9), False) for link in dice.sample(after, 2)),
        ]

    def _batch(self) -> Step:
        links = tuple(self._link() for _ in range(self._dice.randint(2, MOST_LINKS)))
        return ("batch", links, self._dice.random() < self._static_share)

    def _wait(self) -> Step:
        dice = self._dice
        kind = dice.choices(("notified", "blocking", "future", "called", "at once"), (50, 15, 15, 15, 5))[0]
        ends = (self._parents[self._child], self._child) if dice.random() < 0.3 else ()
        target, source = ends or (self._name(), self._name())
        lookup: Lookup = (target, source, self._asked())
        if dice.random() < 0.3:
            lookup = (*lookup, self._name(), self._asked())
        return ("wait", kind, lookup)

    def _name(self) -> str:
        return UNKNOWN if self._dice.random() < 0.02 else self._dice.choice(self._frames)

    def _asked(self) -> int:
        kind = self._dice.random()
        if kind < 0.35:
            return 0
        if kind < 0.65:
            return self._now + self._dice.randint(0, 6)
        if kind < 0.7:
            return self._now + self._dice.randint(10, 100)
        return max(0, self._now - self._dice.randint(0, self._cache_ns + 3))

    def _end_wait(self) -> Step:
        return (
            self._dice.choice(("cancel", "cancel", "drop", "drop", "block")),
            self._dice.randrange(MOST_PENDING),
        )

    def _clear(self) -> Step:
        return ("clear",)

    def _init(self) -> Step:
        return ("init", self._cache_ns)


def run(steps: list[Step], make_buffer: Callable[[Duration], Buffer] = Buffer) -> str | None:
    """Take the steps in a new buffer: None, or what is broken after the last one that was taken."""
    machine = Machine(make_buffer)
    for number, step in enumerate(steps):
        try:
            machine.step(step)
        except AssertionError as broken:
            return f"after step {number}, {step}: {broken}"
    return None


def shrink(steps: list[Step], breaks: Callable[[list[Step]], object]) -> list[Step]:
    """Drop what is not needed to break it: halves, quarters, ..., single steps, until nothing more can go."""
    singles = [single for step in steps for single in _singles(step)]
    if breaks(singles):
        steps = singles
    size = len(steps)
    while size:
        start, shorter = 0, False
        while start < len(steps):
            without = steps[:start] + steps[start + size :]
            if breaks(without):
                steps, shorter = without, True
            else:
                start += size
        if size > 1 or not shorter:
            size //= 2
    return steps


def _singles(step: Step) -> list[Step]:
    if step[0] != "batch":
        return [step]
    _, links, static = step
    return [("insert", *link, static) for link in links]


def search(
    seed: int, step_count: int, make_buffer: Callable[[Duration], Buffer] = Buffer
) -> tuple[str, list[Step]] | None:
    """Take so many steps, in sequences of STEPS: None, or what is broken and the shortest way to it found."""
    for number in itertools.count():
        if number * STEPS >= step_count:
            return None
        steps = list(Author(random.Random(f"{seed}, {number}")).steps(STEPS))
        if run(steps, make_buffer):
            steps = shrink(steps, lambda steps: run(steps, make_buffer))
            return f"{run(steps, make_buffer)} (seed {seed}, sequence {number})", steps


def as_text(steps: list[Step]) -> str:
    """What `--replay` reads."""
    return "[\n" + "".join(f"    {step!r},\n" for step in steps) + "]"


@contextmanager
def quiet() -> Iterator[None]:
    """Without the log lines of refused transforms."""
    level = get_logger_level("tf2_py")
    set_logger_level("tf2_py", LoggingSeverity.FATAL)
    try:
        yield
    finally:
        set_logger_level("tf2_py", level)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**9))
    parser.add_argument("--replay", type=Path, help="a file with a sequence as a failure prints it")
    options = parser.parse_args()
    with quiet():
        if options.replay:
            print(run(ast.literal_eval(options.replay.read_text())) or "nothing is broken")
            return 0
        print(f"seed {options.seed}", flush=True)
        began = time.monotonic()
        found = search(options.seed, options.steps)
        if found is None:
            rate = options.steps / (time.monotonic() - began)
            print(f"{options.steps:,} steps, nothing is broken ({rate:,.0f} steps/s)")
            return 0
    broken, steps = found
    print(f"{broken}\n{as_text(steps)}")
    return 1


if __name__ == "__main__":
    sys.exit(main())

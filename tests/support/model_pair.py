"""
Owns a buffer beside the model: the steps that both take, and the waiters of the buffer.

A step is a tuple: the name of a method `do_...` of `Pair`, and its arguments; the queries are steps, too.
Dropping any step leaves a sequence that can be run.
"""

import copy
import pickle

from encoding import encode
from model import Model
from model_answers import (
    as_model_tells,
    of_buffer,
    of_model,
    require,
    same_answer,
    same_error,
    without_advice,
)
from model_links import TURNS, message, place
from model_queries import Queries
from rclpy.duration import Duration

from tf2_py import BufferCore
from tf2_ros import Buffer

WAITS = ("notified", "blocking", "future", "called")
MOST_PENDING = 12  # the oldest waiter makes room for a new one


class Waiter:
    """One waiter by one of the interfaces, and what it has received."""

    def __init__(self, kind, lookup, buffer, deliveries):
        self.kind, self.lookup, self.received = kind, lookup, []
        self._deliveries = deliveries
        target, source, ns, *rest = lookup
        if kind in ("notified", "blocking"):
            notify = self._receive if kind == "notified" else None
            self.handle = buffer._wait(target, source, ns, *rest, notify=notify)
        elif rest:
            fixed, target_ns = rest
            self.handle = buffer.wait_for_transform_full_async(target, target_ns, source, ns, fixed)
        else:
            self.handle = buffer.wait_for_transform_async(target, source, ns)
        if kind == "called" and not self.handle.done():
            self.handle.add_done_callback(self._called)

    def _called(self, future):
        if not future.cancelled():
            self._receive(future.result())

    def _receive(self, answer):
        self.received.append(answer)
        self._deliveries.append(self)

    @property
    def notifies(self):
        return self.kind in ("notified", "called")

    def immediate(self):
        if self.kind in ("notified", "blocking"):
            return self.handle.answer
        return self.handle.result() if self.handle.done() else None

    def answer(self):
        if self.notifies:
            return self.received[0] if self.received else None
        return self.immediate()

    def cancel(self):
        if self.kind in ("notified", "blocking"):
            require(self.handle.cancel() is True, "cancel() says that a pending wait was over", self)
        else:
            self.handle.cancel()
            require(self.handle.cancelled(), "a pending future cannot be cancelled", self)

    def __repr__(self):
        return f"{self.kind} waiter for {self.lookup}"


class Pair(Queries):
    """A buffer and a model that receive the same transforms, and the buffer's waiters."""

    def __init__(self):
        super().__init__(Buffer(Duration(nanoseconds=10)), Model(10))
        self.pending = []
        self.deliveries = []  # waiters that were told, and that nobody has accounted for
        self.saved = None  # a state of the buffer, and the model of that moment

    def take(self, step):
        name, *arguments = step
        getattr(self, f"do_{name}")(*arguments)

    # Transforms.

    def do_init(self, cache_ns):
        def change():
            BufferCore.__init__(self.buffer, Duration(nanoseconds=cache_ns))
            self.model = Model(cache_ns)

        self._change(change, [lambda: None])

    def do_insert(self, way, links, authority):
        """In one call, or one call for each link."""
        static = way.startswith("static")
        if way.endswith(("list", "cdr")):
            self._insert_many(way, links, authority, static)
            return
        for link in links:

            def change(link=link):
                put = self.buffer.set_transform_static if static else self.buffer.set_transform
                require(put(message(link), authority) is None, "an insert returned something")

            self._change(change, [self._modelled(link, authority, static, [])])

    def _insert_many(self, way, links, authority, static):
        messages, taken, counted = list(map(message, links)), [], []

        def change():
            if way.endswith("cdr") and all(hasattr(made.header.stamp, "sec") for made in messages):
                counted.append(self.buffer.set_transforms_cdr(encode(messages), authority, static))
            else:
                counted.append(self.buffer.set_transforms(iter(messages), authority, static))

        self._change(change, [self._modelled(link, authority, static, taken) for link in links])
        require(counted == [sum(taken)], "an insert counted otherwise", counted, taken)

    def _modelled(self, link, authority, static, taken):
        parent, child, ns, x, turn = link

        def insert():
            taken.append(self.model.insert(parent, child, ns, place(x), TURNS[turn], authority, static))

        return insert

    def do_clear(self):
        self._change(self.buffer.clear, [lambda: self.model.clear()])

    def do_forget(self, name):
        wanted, got = [], []

        def change():
            got.append(of_buffer(lambda: self.buffer.forget(name)))

        self._change(change, [lambda: wanted.append(of_model(lambda: self.model.forget(name)))])
        self._compare(("forget", name), got[0], wanted[0], lambda a, b: a is b)

    # Travelling.

    def do_travel(self, how):
        """Go on with a copy; waiters do not travel."""
        before = self.buffer
        if how == "pickle":
            self.buffer = pickle.loads(pickle.dumps(before))
        else:
            self.buffer = copy.deepcopy(before) if how == "deepcopy" else copy.copy(before)
        self.model.travel()
        while self.pending:
            self.pending.pop().cancel()
        before.clear()  # what the copy has is its own
        before._self_check()
        require(not self.deliveries, "told of a clear()", self.deliveries)
        self._check_waiters()

    def do_save(self):
        self.saved = (self.buffer.__getstate__(), copy.deepcopy(self.model))

    def do_restore(self):
        """The buffer becomes what was saved; its waiters go on."""
        if self.saved is not None:
            state, model = self.saved

            def change():
                self.buffer.__setstate__(state)
                self.model = copy.deepcopy(model)
                self.model.travel()

            self._change(change, [lambda: None])

    # Waiters.

    def do_wait(self, kind, lookup):
        wanted = of_model(lambda: self._model_lookup(lookup))
        refused = of_model(lambda: self.model.check_wait(*lookup[:2], *lookup[3:4]))
        got = of_buffer(lambda: self._begin(kind, lookup))
        require(not self.deliveries, "an answer that was available at once was delivered, too", lookup)
        if refused[0] == "error" or got[0] == "error":
            require(same_error(got, refused), "refused otherwise", lookup, got, refused)
            self._check_waiters()
            return
        waiter = got[1]
        immediate = waiter.immediate()
        require((immediate is not None) == (wanted[0] == "answer"), "a wait began wrongly", waiter, wanted)
        if immediate is None:
            self.pending.append(waiter)
        else:
            require(same_answer(as_model_tells(immediate), wanted[1]), "another answer", waiter, wanted)
        if len(self.pending) > MOST_PENDING:
            self.do_cancel(0)
        self._check_waiters()

    def _begin(self, kind, lookup):
        waiter = Waiter(kind, lookup, self.buffer, self.deliveries)
        waiter.immediate()  # the error of a future
        return waiter

    def do_cancel(self, index):
        if self.pending:
            self.pending.pop(index % len(self.pending)).cancel()
        self._check_waiters()

    def do_drop(self, index):
        if self.pending:
            index %= len(self.pending)
            if self.pending[index].kind != "called":  # that one lives by its callback
                del self.pending.pop(index).handle
        self._check_waiters()

    def _change(self, change, parts):
        """Whoever can be answered after a part is answered, is told once, and in the order of the waits."""
        change()
        possible = {waiter: [] for waiter in self.pending}
        for part in parts:
            part()
            for waiter in self.pending:
                kind, *answer = of_model(lambda waiter=waiter: self._model_lookup(waiter.lookup))
                possible[waiter] += [*answer] if kind == "answer" else []
        answered = []
        for waiter in self.pending:
            answer = waiter.answer()
            require(
                (answer is not None) == bool(possible[waiter]), "forgotten, or answered without data", waiter
            )
            if answer is not None:
                got = as_model_tells(answer)
                fits = any(same_answer(got, want) for want in possible[waiter])
                require(fits, "an answer that no lookup gives", waiter, got, possible[waiter])
                answered.append(waiter)
        told = [waiter for waiter in answered if waiter.notifies]
        heard = list(self.deliveries)
        if len(parts) > 1:
            told, heard = sorted(told, key=id), sorted(heard, key=id)
        require(told == heard, "those who are answered are not those who were told", told, heard)
        self.pending = [waiter for waiter in self.pending if waiter not in answered]
        self.deliveries.clear()
        self._check_waiters()

    def _check_waiters(self):
        for waiter in self.pending:
            wanted = of_model(lambda waiter=waiter: self._model_lookup(waiter.lookup))
            require(wanted[0] == "error", "pending, and its lookup would answer", waiter)
            if waiter.kind in ("notified", "blocking"):
                reason = waiter.handle.reason()
                got = ("error", type(reason).__name__, without_advice(str(reason)))
                require(same_error(got, wanted), "another reason", waiter, got, wanted)
        waiters = self.buffer.statistics()["waiters"]
        require(waiters == len(self.pending), "statistics() counts other waiters", waiters, self.pending)
        listed = sorted(line.partition("]")[0] for line in self.buffer._pending_waits())
        wanted = sorted(f"waits for the transform from frame [{w.lookup[1]}" for w in self.pending)
        require(listed == wanted, "other pending waits are listed", listed, wanted)
        require(not self.deliveries, "told, and not pending", self.deliveries)
        self.buffer._self_check()

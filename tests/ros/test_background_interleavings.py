# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
The background thread beside a thread that gives it work, line by line in many orders: nothing due is left.

The lines are those of ``tf2_ros/_process/background.py``. The test has a time, and an event for the sleep, of
its own.
"""

import ast
import inspect
import itertools
import random
import sys
import threading
from types import SimpleNamespace

import pytest
from random_runs import times

from tf2_ros._process import background as module

FILE = module.__file__
RANDOM_ORDERS = times(30, 100)
UNIT_NS = 100_000_000
END_OF_CHECKS_NS = 5 * 10**9


class Stepped(threading.Thread):
    """Runs one line of the file at each :meth:`step`."""

    def __init__(self, body):
        super().__init__(daemon=True)
        self._body, self._goes, self._pauses = body, threading.Semaphore(0), threading.Semaphore(0)
        self.is_over, self.can_go_on = False, lambda: True
        self.start()

    def run(self):
        self._goes.acquire()
        sys.settrace(self._trace)
        try:
            self._body()
        finally:
            sys.settrace(None)
            self.is_over = True
            self._pauses.release()

    def step(self):
        self._goes.release()
        self._pauses.acquire()

    def pause(self, can_go_on=lambda: True):
        self.can_go_on = can_go_on
        self._pauses.release()
        self._goes.acquire()

    def _trace(self, frame, event, _):
        if frame.f_code.co_filename != FILE:
            return None
        if event == "line":
            self.pause()
        return self._trace


class Work:
    """What is due at a time."""

    def __init__(self, order, due_ns, was_over=False):
        self._order, self.due_ns, self._ends, self._was_over = order, due_ns, 0, was_over

    def over(self):
        return self._ends > 0 or self._was_over

    def expire(self):
        if self.over() or self._order.now_ns < self.due_ns:
            self._order.wrong.append("ended although it was over, or before it was due")
        self._ends += 1

    def _tf2_check(self):
        pass


class Order:
    """One order of the lines. It is also the inboxes and the clock of the background thread."""

    def __init__(self, source, give):
        self.now_ns, self.until_ns = 10**9, 0
        self.is_woken = self.is_stopped = False
        self.work, self.checked, self.wakes_ns, self.wrong = [], [], [], []
        names = dict(vars(module), FEW=2, time=SimpleNamespace(monotonic_ns=lambda: self.now_ns))
        names["start_once"] = lambda *_: None  # it runs from the beginning
        exec(source, names)
        self.background = names["Background"](self)
        self.add(9)
        self.thread, self.giver = Stepped(self.background._run), Stepped(lambda: give(self))

    def report_next(self):
        pass

    def wake_reporting(self):
        self.is_woken = True

    def await_report(self, until_ns):
        self.until_ns = until_ns
        threading.current_thread().pause(lambda: self.is_woken or self.is_stopped or self.now_ns >= until_ns)
        self.is_woken = False
        return not self.is_stopped

    def add(self, units, was_over=False, is_collected=False):
        work = Work(self, self.now_ns + units * UNIT_NS, was_over)
        if not is_collected:
            self.work.append(work)
        self.background.expire_at(work.due_ns, work)

    def check(self):
        checked = Work(self, 0)
        self.background.check_regularly(checked)
        self.checked.append(checked)

    def sleep(self, units):
        ns = self.now_ns + units * UNIT_NS
        self.wakes_ns.append(ns)
        threading.current_thread().pause(lambda: self.now_ns >= ns)
        self.wakes_ns.remove(ns)

    def play(self, choose):
        """What is wrong, if this chooses which of the threads that can go on runs a line next."""
        while not self.wrong:
            threads = self.thread, self.giver
            can_go_on = [one for one in threads if not one.is_over and one.can_go_on()]
            if can_go_on:
                choose(can_go_on).step()
            elif not self._goes_on_later():
                break
        self.is_stopped = True
        while alive := [one for one in (self.thread, self.giver) if not one.is_over]:
            alive[-1].step()
        return self.wrong

    def _goes_on_later(self):
        # Both threads sleep.
        pending_ns = [work.due_ns for work in self.work if not work.over()]
        if any(due_ns <= self.now_ns for due_ns in pending_ns):
            self.wrong.append("nobody ends what is due")
        listed = [what() for *_, what in self.background.entries]
        if self.checked and self.background._checks not in listed:
            self.wrong.append("nobody checks")
        if self.now_ns > END_OF_CHECKS_NS:
            self.checked.clear()
        next_ns = min([self.until_ns, *self.wakes_ns, *pending_ns])
        self.now_ns = max(self.now_ns, next_ns)
        return next_ns < module.NEVER_NS


def compiled_classes():
    """Those of the background thread."""
    tree = ast.parse(inspect.getsource(module))
    names = "Background", "_Checks", "_unless_over"
    tree.body = [one for one in tree.body if getattr(one, "name", "") in names]
    return compile(tree, FILE, "exec")


def each_way_to_add_one(source):
    """Add something that is due before the rest, with up to three switches of threads; what is wrong."""
    for lines, given in itertools.product(range(40), range(1, 9)):  # it sleeps after fewer lines
        order = Order(source, lambda order: order.add(1))
        turns = iter([order.thread] * lines + [order.giver] * given + [order.thread] * 1000)

        def choose(can_go_on, turns=turns):
            turn = next(turns, None)
            return turn if turn in can_go_on else can_go_on[-1]

        yield order.play(choose)


def each_random_order(source):
    """Add several things of all kinds at several times; what is wrong."""
    for seed in range(RANDOM_ORDERS):
        chance = random.Random(seed)

        def give(order, chance=chance):
            for _ in range(8):
                order.sleep(chance.randrange(4))
                if chance.randrange(8) == 0:
                    order.check()
                else:
                    order.add(chance.choice([0, 1, 2, 9]), chance.random() < 0.2, chance.random() < 0.1)

        yield Order(source, give).play(chance.choice)


@pytest.mark.repeated
def test_nothing_that_is_due_is_left_in_any_order():
    source = compiled_classes()
    assert not any(each_way_to_add_one(source))
    assert not any(each_random_order(source))

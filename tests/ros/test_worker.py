"""The daemon threads that call things."""

import threading

import pytest
from processes import until

from tf2_ros._wait.timers import Worker, call_logged

# The thread that fails may end in a later test.
IGNORED = "ignore::pytest.PytestUnhandledThreadExceptionWarning"
pytestmark = [pytest.mark.ours, pytest.mark.filterwarnings(IGNORED)]


class Calls(Worker):
    """Calls what is in a list; what is no function ends the thread."""

    def __init__(self):
        self.left = []
        super().__init__("calls")

    def put(self, call):
        self.left.append(call)
        self.begin()

    def _work(self):
        while self.left:
            call = self.left.pop(0)
            if not callable(call):
                raise MemoryError
            call_logged(call, "In a test")
        return 0.1

    def _has_work(self):
        return bool(self.left)


def test_a_thread_that_fails_is_replaced_with_the_next_call():
    calls, called = Calls(), []
    calls.put(None)
    until(lambda: not calls.runs())
    calls.put(lambda: called.append(1))
    until(lambda: called == [1])


def test_a_call_that_raises_keeps_no_other_from_being_made():
    calls, called = Calls(), []
    calls.put(lambda: 1 / 0)
    calls.put(lambda: called.append(1))
    until(lambda: called == [1])


def test_a_thread_that_cannot_be_started_is_tried_again():
    calls, called = Calls(), []
    size = threading.stack_size(1 << 46)  # no machine has memory for such a stack
    try:
        with pytest.raises(RuntimeError):
            calls.put(lambda: called.append(1))
    finally:
        threading.stack_size(size)
    calls.put(lambda: called.append(2))
    until(lambda: called == [1, 2])


def test_there_is_one_thread_however_many_begin_it():
    calls, called, running, most = Calls(), [], [], [0]

    def call():
        running.append(1)
        most[0] = max(most[0], len(running))
        called.append(1)
        running.pop()

    putting = [threading.Thread(target=lambda: [calls.put(call) for _ in range(1000)]) for _ in range(4)]
    for thread in putting:
        thread.start()
    for thread in putting:
        thread.join()
    until(lambda: len(called) == 4000)
    until(lambda: not calls.runs())
    assert most == [1]

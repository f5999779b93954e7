"""The daemon threads that call things."""

import pytest
from processes import until

from tf2_ros._forking import LOCK
from tf2_ros._wait.worker import Worker

pytestmark = pytest.mark.ours


class Calls(Worker):
    """Calls what is in a list; what is no function ends the thread."""

    def __init__(self):
        self.left = []
        super().__init__("calls", "In a test")

    def put(self, call):
        self.left.append(call)
        with LOCK:
            starting = self._new_thread()
        self._start(starting)

    def _next(self):
        with LOCK:
            if not self.left:
                self._thread = None
                return None
            call = self.left.pop(0)
        if not callable(call):
            raise MemoryError
        return call


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_fails_is_replaced_with_the_next_call():
    calls, called = Calls(), []
    calls.put(None)
    until(lambda: calls._thread is None)
    calls.put(lambda: called.append(1))
    until(lambda: called == [1])


def test_a_call_that_raises_keeps_no_other_from_being_made():
    calls, called = Calls(), []
    calls.put(lambda: 1 / 0)
    calls.put(lambda: called.append(1))
    until(lambda: called == [1])

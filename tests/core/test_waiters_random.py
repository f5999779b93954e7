"""After whatever happens to a buffer, no waiter is pending whose lookup would answer."""

import ast
import random

import pytest

pytestmark = pytest.mark.ours

STEPS = 2000  # of one seed; `waiters_random.py` itself takes as many as one wants
FRESH_SEED = random.SystemRandom().randrange(10**9)

# Each was found by the machine and shrunk by it, where a waiter was forgotten.
LATEST_AFTER_A_NEW_PARENT = [
    ("insert", "a", "c", 101, 0, False),
    ("insert", "c", "d", 102, 7, False),
    ("wait", "notified", ("b", "d", 0)),
    ("insert", "b", "c", 116, 8, False),
    ("insert", "c", "d", 118, 9, False),
]
TOO_OLD_AND_PRUNED = [
    ("insert", "b", "e", 18, 1, False),
    ("wait", "notified", ("a", "e", 36)),
    ("insert", "a", "e", 31, 6, False),
    ("insert", "a", "e", 19, 6, False),
    ("insert", "a", "e", 44, 7, False),
]
LOOP_ENDED_BY_CLEAR = [
    ("insert", "d", "e", 7, 8, True),
    ("insert", "e", "d", 9, 1, False),
    ("insert", "e", "a", 11, 9, True),
    ("wait", "notified", ("a", "d", 0)),
    ("clear",),
]
PRUNED_AMONG_EQUAL_STAMPS = [
    ("init", 5),
    ("insert", "b", "d", 27, 0, False),
    ("insert", "b", "c", 29, 0, False),
    ("insert", "b", "d", 29, 0, False),
    ("insert", "a", "d", 29, 0, False),
    ("insert", "b", "d", 33, 0, False),
    ("wait", "notified", ("c", "d", 0)),
    ("insert", "b", "d", 36, 0, False),
]
STATIC_AFTER_STAMP_ZERO = [
    ("insert", "b", "e", 0, 6, False),
    ("wait", "notified", ("b", "e", 0, "a", 0)),
    ("insert", "e", "a", 14, 0, False),
    ("insert", "b", "e", 0, 3, True),
]


@pytest.fixture(scope="module")
def machine():
    import waiters_random

    with waiters_random.quiet():
        yield waiters_random


@pytest.mark.parametrize("seed", [2, 5, 11, 18, pytest.param(FRESH_SEED, id="fresh")])
def test_no_waiter_is_pending_whose_lookup_would_answer(machine, seed):
    found = machine.search(seed, STEPS)
    if found is not None:
        broken, steps = found
        pytest.fail(f"seed {seed}: {broken}\n{machine.as_text(steps)}", pytrace=False)


@pytest.mark.parametrize(
    "steps",
    [
        pytest.param(LATEST_AFTER_A_NEW_PARENT, id="the latest common time passes the change of a parent"),
        pytest.param(TOO_OLD_AND_PRUNED, id="a refused sample prunes the last one of another parent"),
        pytest.param(LOOP_ENDED_BY_CLEAR, id="clear() ends a loop"),
        pytest.param(PRUNED_AMONG_EQUAL_STAMPS, id="the sample before several of one stamp is pruned"),
        pytest.param(STATIC_AFTER_STAMP_ZERO, id="a frame with data at 0 s only becomes static"),
    ],
)
def test_waiters_are_answered_where_they_were_once_forgotten(machine, steps):
    assert machine.run(steps) is None


class TestTheMachine:
    def test_it_notices_a_forgotten_waiter_and_what_is_needed_for_that(self, machine, tf2_ros):
        class Forgetful(tf2_ros.Buffer):
            def _wait(self, *lookup, notify=None):
                wait = super()._wait(*lookup, notify=notify)
                if notify is not None:
                    wait.cancel()
                return wait

        broken, steps = machine.search(1, STEPS, Forgetful)
        assert "statistics() counts other waiters" in broken
        assert len(steps) == 1
        assert machine.run(steps, Forgetful) is not None
        assert machine.run(steps) is None

    def test_a_sequence_is_the_same_for_the_same_seed_and_can_be_replayed(self, machine):
        one, other = (list(machine.Author(random.Random("7, 3")).steps(100)) for _ in range(2))
        assert one == other
        assert ast.literal_eval(machine.as_text(one)) == one

    def test_shrinking_leaves_only_what_is_needed(self, machine):
        steps = [(number,) for number in range(100)]
        needed = {(3,), (64,), (99,)}
        assert machine.shrink(steps, lambda steps: needed <= set(steps)) == sorted(needed)

    def test_every_kind_of_step_is_taken(self, machine):
        steps = [
            step for seed in range(20) for step in machine.Author(random.Random(seed)).steps(machine.STEPS)
        ]
        operations = {name.removeprefix("do_") for name in dir(machine.Machine) if name.startswith("do_")}
        assert {step[0] for step in steps} == operations
        assert {step[1] for step in steps if step[0] == "wait"} == {
            "notified", "blocking", "future", "called", "at once",
        }  # fmt: skip

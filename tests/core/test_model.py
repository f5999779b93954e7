"""The buffer and a slow model of tf2, side by side; and the model beside the recordings of the real tf2."""

import random

import pytest
import repetitions
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from model import STAMPS_END, Model, ModelError, S
from model_links import AUTHORITIES, FRAMES, GOOD_PLACES, GOOD_TURNS, ODD_NAMES, PLACES, TURNS, WAYS
from model_pair import WAITS, Pair
from model_steps import as_text, quiet, shortest
from recorded_answers import SCENARIOS, assert_same_answer, assert_same_reason, number

pytestmark = pytest.mark.ours


def called(model, op, args):
    """What `call` of recorded_answers returns for a buffer."""
    match op:
        case "set":
            static, authority, parent, child, sec, nanosec, xyz, xyzw = args
            xyz, xyzw = (tuple(float(number(a)) for a in vector) for vector in (xyz, xyzw))
            model.insert(parent, child, sec * S + nanosec, xyz, xyzw, authority, static)
            return None
        case "lookup":
            return as_recorded(model.lookup(*args))
        case "lookup_full":
            return as_recorded(model.lookup_full(*args))
        case "can":
            return list(model.can(*args))
        case "can_full":
            return list(model.can_full(*args))
        case "latest":
            return model.latest(*args)
        case "dot":
            return "".join(f'"{parent}" -> "{child}"' for parent, child in model.edges())
        case "frames":
            return sorted(model.names)
        case "exists":
            return model.exists(*args)
        case "yaml":
            return repr(model.yaml())
        case "string":
            return model.string()
        case "clear":
            return model.clear()
    raise AssertionError(f"unknown recording {op}")


def as_recorded(answer):
    stamp, target, source, xyz, xyzw = answer
    return [*divmod(stamp, S), target, source, list(xyz), list(xyzw)]


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario["name"])
def test_the_model_answers_as_tf2_did(scenario):
    model = Model(scenario["cache_ns"])
    for (op, *args), want in zip(scenario["ops"], scenario["want"], strict=True):
        try:
            got = called(model, op, args)
        except ModelError as error:
            assert error.kind == want.get("err"), (op, args, error)
            assert_same_reason(error.text, want["msg"])
        else:
            assert "ok" in want, (op, args, got)
            assert_same_answer(op, got, want["ok"])


# The buffer beside the model.

frames = st.sampled_from(FRAMES[:5])
names = frames | frames | st.sampled_from(ODD_NAMES)
# Near each other, at the edges of a cache of 10 ns, and where the arithmetic of stamps ends.
stamps = (
    st.integers(0, 40) | st.integers(0, 40) | st.integers(-2, 1) | st.integers(STAMPS_END - 15, STAMPS_END)
)
good_links = st.tuples(
    frames, frames, stamps, st.integers(0, GOOD_PLACES - 1), st.integers(0, GOOD_TURNS - 1)
)
links = good_links | st.tuples(
    names, names, stamps, st.integers(0, len(PLACES) - 1), st.integers(0, len(TURNS) - 1)
)
times = st.just(0) | st.integers(-2, 45) | st.integers(STAMPS_END - 18, STAMPS_END - 1)
lookups = st.tuples(names, names, times) | st.tuples(names, names, times, names, times)


class Machine(RuleBasedStateMachine):
    """A pair takes random steps; after each, its queries and its waiters are compared with the model's."""

    def __init__(self):
        super().__init__()
        self.pair = Pair()
        self.taken = []
        self.last = None

    def take(self, step):
        self.taken.append(step)
        self.check(lambda: self.pair.take(step))

    def check(self, work):
        try:
            work()
        except Exception as broken:
            text, steps = shortest(self.taken, broken)
            pytest.fail(f"{text}\nfor `run` of model_steps.py:\n{as_text(steps)}", pytrace=False)

    @initialize(cache_ns=st.sampled_from([10, 10, 0, 3, 10 * S, 2**62]))
    def begin(self, cache_ns):
        self.take(("init", cache_ns))

    @rule(way=st.sampled_from(WAYS), link=links, authority=st.sampled_from(AUTHORITIES))
    def insert(self, way, link, authority):
        self.last = link
        self.take(("insert", way, (link,), authority))

    @rule(way=st.sampled_from(WAYS[:3]), links=st.lists(good_links, min_size=2, max_size=6))
    def insert_many(self, way, links):
        self.last = links[-1]
        self.take(("insert", way, tuple(links), "many"))

    @precondition(lambda self: self.last is not None)
    @rule(later_ns=st.integers(-12, 12), parent=st.none() | frames)
    def insert_next(self, later_ns, parent):
        """Another sample of the frame of the last one."""
        old_parent, child, ns, x, turn = self.last
        self.last = (parent or old_parent, child, max(0, ns + later_ns), (x + 1) % GOOD_PLACES, turn)
        self.take(("insert", "set", (self.last,), "next"))

    @rule(kind=st.sampled_from(WAITS), lookup=lookups)
    def wait(self, kind, lookup):
        self.take(("wait", kind, lookup))

    @precondition(lambda self: self.pair.pending)
    @rule(how=st.sampled_from(["cancel", "drop"]), index=st.integers(0, 11))
    def end_wait(self, how, index):
        self.take((how, index))

    @rule(step=st.sampled_from([("clear",), ("save",), ("restore",), ("init", 10)]))
    def change(self, step):
        self.take(step)

    @rule(name=frames | names)
    def forget(self, name):
        self.take(("forget", name))

    @rule(how=st.sampled_from(["pickle", "copy", "deepcopy"]))
    def travel(self, how):
        self.take(("travel", how))

    @rule(lookup=lookups)
    def look_up(self, lookup):
        target, source, ns, *rest = lookup
        if rest:
            self.take(("lookup_full", target, rest[1], source, ns, rest[0]))
        else:
            self.take(("lookup", target, source, ns))

    @invariant()
    def all_queries_are_answered_as_by_the_model(self):
        self.check(lambda: self.pair.ask(random.Random(len(self.taken))))


# Other steps in every run, also where Hypothesis sees that it runs in CI. A failure prints its steps, which
# `shortest` makes few in seconds; Hypothesis would need minutes.
TestBufferAndModel = Machine.TestCase
TestBufferAndModel.settings = settings(
    max_examples=repetitions.times(20, 60),
    stateful_step_count=25,
    deadline=None,
    database=None,
    derandomize=False,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(autouse=True, scope="module")
def silence():
    with quiet():
        yield

"""38,652 recorded answers of tf2 (ROS 2 Jazzy), scenario by scenario."""

import pickle

import pytest
import yaml
from recorded_answers import SCENARIOS, call, check_answers, edges
from ros_optional import Duration
from travelling import is_cleared, without_reason

from tf2_py import BufferCore, TransformException


def test_all_recordings_are_here():
    assert len(SCENARIOS) == 120
    assert sum(len(s["ops"]) for s in SCENARIOS) == 38_652


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s["name"])
def test_answers_as_recorded(tf2_py, scenario):
    check_answers(tf2_py, scenario, lambda i, buffer: buffer)


def answer(buffer, op, args):
    try:
        found = call(buffer, op, args)
    except (TransformException, TypeError, ValueError, OverflowError) as error:
        return type(error).__name__, str(error)
    return {"yaml": yaml.safe_load, "dot": edges}.get(op, lambda same: same)(found)


@pytest.mark.ours
@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s["name"])
def test_a_copy_gives_the_same_answers(scenario):
    buffer, copied = BufferCore(Duration(nanoseconds=scenario["cache_ns"])), None
    for op, *args in scenario["ops"]:
        if op in ("set", "clear"):
            call(buffer, op, args)
            copied = None
            continue
        if copied is None:
            copied = pickle.loads(pickle.dumps(buffer))
            # What no sample names is not copied.
            known = copied._getFrameStrings()
            lost = {*buffer._getFrameStrings()} - {*known}
            compared = without_reason if is_cleared(buffer, known) else lambda found: found
        if op not in ("string", "frames") and not lost.intersection(args):
            found, wanted = (compared(answer(one, op, args)) for one in (copied, buffer))
            assert found == wanted, (op, args, lost)

"""38,652 recorded answers of tf2 (ROS 2 Jazzy), scenario by scenario."""

import pickle

import pytest
from recorded_answers import SCENARIOS, check_answers


def test_all_recordings_are_here():
    assert len(SCENARIOS) == 120
    assert sum(len(s["ops"]) for s in SCENARIOS) == 38_652


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s["name"])
def test_answers_as_recorded(tf2_py, scenario):
    check_answers(tf2_py, scenario, lambda i, buffer: buffer)


@pytest.mark.ours
@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s["name"])
def test_answers_as_recorded_of_a_buffer_that_is_pickled_again_and_again(tf2_py, scenario):
    check_answers(
        tf2_py, scenario, lambda i, buffer: buffer if i % 10 else pickle.loads(pickle.dumps(buffer))
    )

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""38,652 recorded answers of tf2 0.36.20 (ROS 2 Jazzy), scenario by scenario."""

import pytest
import reference
from recorded_answers import SCENARIOS, check_answers, check_answers_of_release

pytestmark = pytest.mark.tf2


def test_all_recordings_are_here():
    assert len(SCENARIOS) == 120
    assert sum(len(s["ops"]) for s in SCENARIOS) == 38_652


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda s: s["name"])
def test_answers_as_recorded(tf2_py, scenario):
    if reference.release is None:
        check_answers(tf2_py, scenario)
    else:
        check_answers_of_release(tf2_py, scenario, reference.release)

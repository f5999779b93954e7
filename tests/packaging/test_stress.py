"""A short stress run, and that it would notice: readers, writers, waits, listeners and forks, all at once."""

import subprocess
import sys

import numpy as np
import pytest
from processes import DEADLINE_S

from reliability import stress_truth
from reliability.own_domain import ROOT
from reliability.stress_truth import EXACT, START_NS, STEP_NS, WORLD, S

pytestmark = pytest.mark.ours

SECONDS = 10


@pytest.mark.long("keeps all cores busy")
def test_all_that_uses_a_buffer_at_once_finds_it_whole():
    command = [sys.executable, "-m", "reliability.stress", "--seconds", str(SECONDS)]
    process = subprocess.Popen(command, cwd=ROOT, text=True, stdout=subprocess.PIPE)
    try:
        said, _ = process.communicate(timeout=SECONDS + 8 * DEADLINE_S)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 0, said
    assert "passed" in said


def checked(times_ns, poses):
    stress_truth.check(WORLD, EXACT, times_ns, *poses)


class TestWhatReadersCheck:
    TIMES_NS = START_NS + np.arange(20) * (STEP_NS // 3)

    def test_right_answers_pass(self):
        checked(self.TIMES_NS, stress_truth.pose_in_world(EXACT, self.TIMES_NS))

    @pytest.mark.parametrize("number", range(7))
    def test_one_number_of_another_sample_does_not(self, number):
        poses = [part.copy() for part in stress_truth.pose_in_world(EXACT, self.TIMES_NS)]
        others = stress_truth.pose_in_world(EXACT, self.TIMES_NS + S)
        part, column = divmod(number, 3) if number < 6 else (1, 3)
        poses[part][7, column] = others[part][7, column]
        with pytest.raises(AssertionError, match=str(self.TIMES_NS[7])):
            checked(self.TIMES_NS, poses)

    def test_what_is_interpolated_between_other_samples_does_not(self):
        """One step is left out, so its neighbours answer for it."""
        before, after = (
            stress_truth.pose_in_world(EXACT, np.array([START_NS + i * STEP_NS])) for i in (0, 2)
        )
        with pytest.raises(AssertionError):
            checked(np.array([START_NS + STEP_NS]), ((before[0] + after[0]) / 2, before[1]))

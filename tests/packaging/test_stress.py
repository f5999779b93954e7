"""A short stress run, and that it would notice wrong answers and leaks."""

import random
import subprocess
import sys

import numpy as np
import pytest
from processes import DEADLINE_S

from reliability import stress_truth
from reliability.domain import ROOT
from reliability.stress import growth
from reliability.stress_truth import EXACT, START_NS, STEP_NS, WORLD, S

pytestmark = pytest.mark.ours

SECONDS = 10


@pytest.mark.long("keeps all cores busy")
def test_all_that_uses_a_buffer_at_once_finds_it_whole():
    command = [sys.executable, "-m", "reliability.stress", "--minutes", str(SECONDS / 60)]
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


class TestGrowth:
    NOISE = {"resident": 2e6, "heap": 1e6, "blocks": 1500, "threads": 1, "descriptors": 1}

    def found(self, rounds, **rise_per_round):
        """What rises, in a run with noise and one round on a busy machine."""
        rng = random.Random(1)
        samples = []
        for number in range(rounds):
            one = {name: 1e8 + rng.random() * noise for name, noise in self.NOISE.items()}
            one["heap"] += 50e6 * (number == rounds // 2)
            samples.append(one | {name: one[name] + rise * number for name, rise in rise_per_round.items()})
        return [text.split()[0] for text in growth(samples)]

    @pytest.mark.parametrize("rounds", [24, 720])
    def test_noise_is_none(self, rounds):
        assert self.found(rounds) == []

    @pytest.mark.parametrize(
        ("name", "rise"),
        [("resident", 1e6), ("heap", 3e5), ("blocks", 400), ("threads", 0.2), ("descriptors", 0.2)],
    )
    def test_what_each_round_leaves_behind_is_found(self, name, rise):
        assert self.found(24, **{name: rise}) == [name]

"""
Sets both clocks while random buffers judge ages, and compares each answer with the model:
`ages_under_set_clocks.py RUNS SEED`, with `interposed/set_clocks.c`.
"""

import copy
import ctypes
import pickle
import random
import sys

from buffer_beside_model import as_model_tells, of_buffer, of_model, same_answer, same_error
from making_objects import S, transform
from model import Model
from model_ages_and_limits import STEP_BACK
from model_questions import arguments_of
from model_terms import Policy

from tf2_ros import Buffer

STEPS = 40
BEGIN_NS = 1_000_000 * S
FRAMES = ("map", "odom", "base", "arm")  # each is below one that comes before it
LIMITS_S = (0, 1, 2, 5, 100)


class Run:
    def __init__(self, seed):
        self.dice = random.Random(seed)
        WALL.value = STEADY.value = BEGIN_NS
        self.homes = {child: self.dice.choice(FRAMES[:i]) for i, child in enumerate(FRAMES) if i}
        self.model = Model()
        self.model.begin_system_time(BEGIN_NS, BEGIN_NS)
        self.buffer = Buffer()
        self.ahead_ns = 0  # of the steady clock, when it was read last
        self.oldest = {}  # the ages that samples had, by frame and stamp

    def insert(self):
        child = self.dice.choice(FRAMES[1:])
        late_ns = self.dice.choice((0, 0, 0, 1, S // 2, S, 3 * S, 50 * S, -1, -S // 2, -3 * S))
        link, xyz = (self.homes[child], child, WALL.value - late_ns), (self.dice.randrange(3), 0, 0)
        self.buffer.set_transforms([transform(*link[:2], ns=link[2], xyz=xyz)], "x", False)
        self.model.insert(*link, xyz, (0, 0, 0, 1), "x")

    def go_on(self):
        passed_ns = self.dice.choice((1, S // 5, S, 3 * S, 20 * S))
        WALL.value += passed_ns
        STEADY.value += passed_ns

    def set_clock(self):
        step_ns = self.dice.choice((S // 2, STEP_BACK - 1, STEP_BACK, S, 4 * S, 60 * S))
        WALL.value += self.dice.choice((-step_ns, -step_ns, step_ns))
        if -STEP_BACK < WALL.value - STEADY.value - self.ahead_ns < 0:
            self.oldest.clear()  # by so little, data may become younger

    def ask(self):
        self.ahead_ns = WALL.value - STEADY.value
        limit_ns = self.dice.choice(LIMITS_S) * S + self.dice.randrange(2)
        for child in self.model.frames:
            arguments = (self.homes[child], child)
            self.model.read_system_clock(WALL.value, STEADY.value)
            ages = self.buffer.ages(*arguments)
            assert ages == self.model.ages(*arguments)
            sample = (child, self.model.frames[child].newest_ns())
            assert ages[child] >= self.oldest.get(sample, ages[child])
            self.oldest[sample] = ages[child]
            policy = Policy(max_age=limit_ns)
            expected = of_model(self.model.lookup_under, policy, *arguments, 0)
            found = of_buffer(self.buffer.lookup_transform, *arguments, 0, **arguments_of(policy))
            if expected[0] == "answer" == found[0]:
                assert same_answer(as_model_tells(found[1]), expected[1])
            else:
                assert same_error(found, expected), (found, expected)

    def copy(self):
        self.oldest.clear()  # a step before the first reading of the copy is not noticed
        copied = self.dice.choice((copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))))
        self.buffer = copied(self.buffer)
        self.model.begin_system_time(WALL.value, STEADY.value)


WALL, STEADY = (ctypes.c_long.in_dll(ctypes.CDLL(None), name) for name in ("wall_ns", "steady_ns"))
runs, first_seed = map(int, sys.argv[1:])
for seed in range(first_seed, first_seed + runs):
    run = Run(seed)
    for number in range(STEPS):
        frequent = [run.insert] * 5 + [run.go_on] * 4 + [run.ask] * 4
        step = run.dice.choice([*frequent, run.set_clock, run.set_clock, run.copy])
        try:
            step()
        except AssertionError as error:
            raise AssertionError(f"seed {seed}, step {number}") from error
print("as the model", runs)

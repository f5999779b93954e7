"""Nodes and what uses them, ended in any order, leave nothing behind."""

import pytest
from processes import until
from repetitions import times

pytestmark = pytest.mark.ours


@pytest.mark.parametrize("seed", range(times(5, 50)))
def test_nothing_is_left_of_what_ended_in_random_order(ros, seed):
    from random_ends import RandomEnds

    ends = RandomEnds(seed)
    ends.play(40)
    # The threads of the last ones may be ending.
    until(lambda: ends.left() == [])

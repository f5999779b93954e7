# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How old the data of the frames between two frames is, on the clock of the buffer."""

import pytest
from simulated_clock import simulate
from times_and_transforms import S, transform


@pytest.mark.parametrize("hops", [1, 999])
def test_long_paths_have_the_ages_of_all_their_frames(tf2_ros, node, hops):
    simulate(node, seconds=100)
    buffer = tf2_ros.Buffer(node=node)
    buffer.set_transforms([transform(f"f{i}", f"f{i + 1}", ns=95 * S + i) for i in range(hops)], "x")
    ages = buffer.ages("f0", f"f{hops}")
    assert list(ages) == [f"f{i}" for i in range(hops, 0, -1)]
    assert ages["f1"] == 5.0

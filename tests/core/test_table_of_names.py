# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The table in which a buffer finds the names of frames."""

import random

import pytest
from times_and_transforms import transform

from tf2_py import BufferCore


@pytest.mark.parametrize("kind", ["of one letter", "random", "long"])
def test_names_of_any_kind_lie_apart(kind):
    random.seed(1)
    names = {
        "of one letter": lambda: ["x" * size for size in range(1, 1000)],
        "random": lambda: [f"{random.getrandbits(64):016x}" for _ in range(20_000)],
        "long": lambda: [f"{'x' * 2000}{i}" for i in range(1000)],
    }[kind]()
    buffer = BufferCore()
    assert buffer.set_transforms([transform("map", name, 1) for name in names], "x") == len(names)
    buffer._self_check()
    assert all(buffer._frameExists(name) for name in names)
    assert not any(buffer._frameExists(name + "y") for name in names[:-1])
    assert buffer._getFrameStrings() == [names[0], "map", *names[1:]]

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
How often tests repeat what depends on chance, and from which seed.

Every run does the same, so that a failure belongs to the change that is tested. `pytest --seed` searches with
other seeds; a seed that finds a fault becomes an example of its test.
"""

import os

import pytest

VARIABLE = "TF2_TEST_SEED"

all_of_them = False  # whether it is `pytest --all` or `--long`; set before tests are imported


def times(few, many):
    """`many` in `pytest --all` and `--long`, otherwise `few`; for tests marked `repeated`."""
    return many if all_of_them else few


def first_seed():
    """The seed of `pytest --seed`, also in the tests' own programs; otherwise 0."""
    return int(os.environ.get(VARIABLE, "0"))


def seeds(few, many=0):
    """Values of a parameter: `few` seeds, and as many as make `many` in tests marked `long`."""
    first, more = first_seed(), pytest.mark.long("more seeds")
    rest = (pytest.param(seed, marks=more) for seed in range(first + few, first + many))
    return [*range(first, first + few), *rest]

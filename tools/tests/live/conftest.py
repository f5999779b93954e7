# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the tests of feeds: processes that a test starts, and a free port."""

import pytest
from starting_programs import free_port


@pytest.fixture
def processes():
    made = []
    yield made
    for one in made:
        one.end()


@pytest.fixture
def port():
    return free_port()

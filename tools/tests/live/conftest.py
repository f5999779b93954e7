# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fixtures of the tests of feeds: processes that a test starts, and a free port."""

import socket

import pytest


@pytest.fixture
def processes():
    made = []
    yield made
    for one in made:
        one.end()


@pytest.fixture
def port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]

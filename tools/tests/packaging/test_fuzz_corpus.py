# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""No file that fuzzing found shows a fault; `make fuzz` searches for more."""

import pytest
from fuzz_target_checks import check_corpus, check_seeds

from reliability.fuzz.targets import OF_TOOLS

TARGETS = sorted(OF_TOOLS)


@pytest.mark.repeated
@pytest.mark.parametrize("name", TARGETS)
def test_no_input_of_the_corpus_shows_a_fault(name):
    check_corpus(name)


@pytest.mark.parametrize("name", TARGETS)
def test_targets_take_their_seeds_and_any_bytes(name):
    check_seeds(name)

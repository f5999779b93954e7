"""A long history moves to other memory while other threads go on, and holds what it would hold anyway."""

import pytest
from interposed_libraries import output_with_library

pytestmark = pytest.mark.ours


def test_whatever_others_do_during_a_move_is_as_if_it_came_before(tmp_path):
    assert output_with_library("held_history_moves", tmp_path, tmp_path) == "90\n"

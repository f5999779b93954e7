"""The system's clock is set while random buffers judge ages, against the model."""

import pytest
import repetitions
from interposed_libraries import output_with_library

pytestmark = [pytest.mark.ours, pytest.mark.repeated]


def test_ages_count_on_as_the_model_says(tmp_path):
    runs = repetitions.times(1_000, 20_000)
    output = output_with_library(
        "set_clocks", tmp_path, runs, repetitions.first_seed(), program="ages_under_set_clocks"
    )
    assert output == f"as the model {runs}\n"

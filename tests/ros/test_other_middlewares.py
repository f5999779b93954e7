"""
What a middleware may lack is done without.

`interposed/middleware.c` takes it away from the one that the tests run with.
"""

import pytest
from interposing import output_with_library

pytestmark = pytest.mark.ours


def test_where_arrivals_are_not_reported_executors_take_the_messages(tmp_path):
    fault = {"TF2_TEST_MIDDLEWARE": "no_arrivals"}
    printed = output_with_library("middleware", tmp_path, program="unknown_release", **fault).splitlines()
    assert (printed[0], printed[-1]) == ("without an executor: nothing", "threads of listeners")

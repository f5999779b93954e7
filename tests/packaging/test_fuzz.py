"""No input that fuzzing found or keeps shows a fault; `make fuzz` searches for more."""

import pytest
from repetitions import times

from reliability.fuzz.targets import PACKAGES, corpus, target

pytestmark = pytest.mark.ours


@pytest.mark.parametrize("name", PACKAGES)
def test_no_input_of_the_corpus_shows_a_fault(name):
    run = target(name).run
    inputs = corpus(name)
    assert len(inputs) > 10
    crashes = [one for one in inputs if one.startswith("crash")]
    for one in {*crashes, *sorted(inputs)[:: times(3, 1)]}:
        try:
            run(inputs[one])
        except BaseException as error:
            raise AssertionError(f"{one}: {error!r}") from error


@pytest.mark.parametrize("name", PACKAGES)
def test_targets_take_their_seeds_and_any_bytes(name):
    fuzzed = target(name)
    for data in (*fuzzed.seeds(), b"", b"\0", b"\xff", bytes(100), bytes(range(256)), b"\xff" * 300):
        fuzzed.run(data)

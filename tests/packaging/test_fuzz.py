"""That what fuzzing found, and what it keeps, shows no fault; `make fuzz` searches for more."""

import pytest
from paths import ROOT
from repetitions import times

from reliability.fuzz.targets import PACKAGES, target

pytestmark = pytest.mark.ours

FUZZ = ROOT / "reliability" / "fuzz"


@pytest.mark.parametrize("name", PACKAGES)
def test_no_input_of_corpus_or_crashes_shows_a_fault(name):
    run = target(name).run
    corpus = sorted((FUZZ / "corpus" / name).iterdir())
    assert len(corpus) > 10
    files = [*corpus[:: times(3, 1)], *(FUZZ / "crashes").glob(f"{name}/*")]
    for file in files:
        try:
            run(file.read_bytes())
        except BaseException as error:
            raise AssertionError(f"{file.relative_to(FUZZ)}: {error!r}") from error


@pytest.mark.parametrize("name", PACKAGES)
def test_targets_take_their_seeds_and_any_bytes(name):
    fuzzed = target(name)
    for data in (*fuzzed.seeds(), b"", b"\0", b"\xff", bytes(100), bytes(range(256)), b"\xff" * 300):
        fuzzed.run(data)

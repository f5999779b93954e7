"""That what fuzzing found, and what it keeps, shows no fault; `make fuzz` searches for more."""

from pathlib import Path

import pytest

from reliability.fuzz.targets import PACKAGES, target

pytestmark = pytest.mark.ours

FUZZ = Path(__file__).resolve().parent.parent / "reliability" / "fuzz"


@pytest.mark.parametrize("name", PACKAGES)
def test_no_input_of_corpus_or_crashes_shows_a_fault(name):
    run = target(name).run
    files = [*(FUZZ / "corpus" / name).iterdir(), *(FUZZ / "crashes").glob(f"{name}/*")]
    assert len(files) > 10
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

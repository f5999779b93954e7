# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What holds of every target of fuzzing; see `reliability/fuzz`."""

from random_runs import times

from reliability.fuzz.targets import corpus, target


def check_corpus(name):
    """No input that fuzzing found or keeps shows a fault."""
    run = target(name).run
    inputs = corpus(name)
    assert len(inputs) > 10
    crashes = [one for one in inputs if one.startswith("crash")]
    for one in {*crashes, *sorted(inputs)[:: times(3, 1)]}:
        try:
            run(inputs[one])
        except BaseException as error:
            raise AssertionError(f"{one}: {error!r}") from error


def check_seeds(name):
    """A target takes its seeds, and any bytes."""
    fuzzed = target(name)
    for data in (*fuzzed.seeds(), b"", b"\0", b"\xff", bytes(100), bytes(range(256)), b"\xff" * 300):
        fuzzed.run(data)

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""`make guard`: which counts of instructions fail."""

import pytest

from bench.instruction_counts import TOLERANCE, TOLERANCE_OTHER_PYTHON, compare

BASELINE = {"python": "3.11 x86_64", "reference": 10_000, "ratios": {"one": 1.0, "many": 20.0}}
SLIGHTLY, MUCH = TOLERANCE * 1.1, TOLERANCE_OTHER_PYTHON * 1.1
OTHER_PYTHONS = [{"python": "3.12 x86_64"}, {"python": "3.11 aarch64"}, {"reference": 9_700}]


def of(change, **other):
    return {**BASELINE, **other, "ratios": {"one": 1.0, "many": 20.0 * (1 + change)}}


@pytest.mark.parametrize(("change", "said"), [(SLIGHTLY, "slower"), (-SLIGHTLY, "faster"), (-MUCH, "faster")])
def test_a_changed_count_fails_until_the_baseline_is_renewed(capsys, change, said):
    assert compare(of(change), BASELINE) == 1
    printed = capsys.readouterr().out
    assert [line.split()[-1] for line in printed.splitlines()[2:4]] == ["before", said]
    assert "run python -m bench.instruction_counts --renew" in printed
    assert compare(of(change), of(change)) == 0


@pytest.mark.parametrize("other", OTHER_PYTHONS)
def test_with_another_python_only_much_slower_calls_fail(other):
    changes = (-MUCH, -SLIGHTLY, SLIGHTLY, MUCH)
    assert [compare(of(change, **other), BASELINE) for change in changes] == [0, 0, 0, 1]


def test_a_case_without_a_baseline_fails():
    assert compare({**BASELINE, "ratios": {**BASELINE["ratios"], "new": 1.0}}, BASELINE) == 1


def test_a_slightly_different_reference_is_the_same_python():
    assert compare(of(-SLIGHTLY, reference=10_150), BASELINE) == 1
    assert compare(of(0, reference=9_850), BASELINE) == 0

"""The benchmark: every section measures what it names, and reports who did not take part."""

import json
import math

import pytest
from conftest import DOMAIN

from bench import __main__ as bench
from bench import guard, libraries, report, sizes

pytestmark = pytest.mark.ours

long = pytest.mark.long("measures what the bench measures")


@pytest.fixture
def run_of(tmp_path, monkeypatch):
    """Makes a run of tiny sizes, in which these libraries take part."""
    monkeypatch.setattr(bench, "DOMAIN", DOMAIN)

    def make(*found):
        return bench.Run({library.key: library for library in found}, sizes.TINY, tmp_path)

    return make


@pytest.mark.parametrize("section", bench.SECTIONS)
@long
def test_each_section_measures_something_of_every_kind(run_of, section):
    run = run_of(libraries.ours())
    run.measure(section)
    assert run.remarks == []
    assert run.rows
    assert all(math.isfinite(value) for row in run.rows.values() for value in row.values)
    assert not any(row.failed for row in run.rows.values())
    assert report.TITLES[section] in report.page(run.rows, run.libraries, [], [0.0, 0.0], [])


def test_the_guards_baseline_knows_every_case():
    assert [guard.REFERENCE, *json.loads(guard.BASELINE.read_text())["ratios"]] == list(guard.CASES)

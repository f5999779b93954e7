"""The mutants of `make mutate`: what is changed, and that the list of equivalent ones is of this code."""

import pytest

from reliability.mutate import equivalent, sources
from reliability.mutate.__main__ import draw
from reliability.mutate.mutants import Source

CODE = '''"""Owns an example."""

cdef enum:
    LIMIT = 3


cdef bint _fits(const Cache* cache, uint32_t index) noexcept nogil:
    cdef uint32_t last = <uint32_t>index + 1
    if not index and last < cache.count:
        return True
    cache.count += sizeof(Cache)
    return <size_t>&cache.samples[index] & (LIMIT - 1) != 0


cdef void unread(Cache* cache) noexcept nogil:
    cache.count = 0
'''


def after(code):
    return [(mutant.key[2], mutant.key[3]) for mutant in Source("example.pyx", code, 1, {"unread"}).mutants]


def test_each_operator_constant_and_statement_has_its_mutants():
    assert after(CODE) == [
        ("cdef uint32_t last = <uint32_t>index + 1", "cdef uint32_t last = <uint32_t>index + 2"),
        ("cdef uint32_t last = <uint32_t>index + 1", "cdef uint32_t last = <uint32_t>index - 1"),
        ("if not index and last < cache.count:", "if not not index and last < cache.count:"),
        ("if not index and last < cache.count:", "if not index and last <= cache.count:"),
        ("if not index and last < cache.count:", "if not index or last < cache.count:"),
        ("if not index and last < cache.count:", "if not (not index and last < cache.count):"),
        ("return True", "return False"),
        ("cache.count += sizeof(Cache)", ""),
        ("cache.count += sizeof(Cache)", "cache.count -= sizeof(Cache)"),
        *(
            ("return <size_t>&cache.samples[index] & (LIMIT - 1) != 0", f"return {mutated}")
            for mutated in (
                "<size_t>&cache.samples[index] & (LIMIT - 2) != 0",
                "<size_t>&cache.samples[index] & (LIMIT + 1) != 0",
                "<size_t>&cache.samples[index] | (LIMIT - 1) != 0",
                "<size_t>&cache.samples[index] & (LIMIT - 1) != 1",
                "<size_t>&cache.samples[index] & (LIMIT - 1) == 0",
            )
        ),
    ]


def test_a_mutant_keeps_its_key_when_lines_move():
    moved = CODE.replace("cdef enum", "# A comment.\n\ncdef enum")
    moved = moved.replace(" and last", " \\\n            and last")
    assert after(moved) == after(CODE)


def test_equal_statements_have_different_keys():
    keys = [mutant.key for source in sources.read() for mutant in source.mutants]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("count", [60, 250])
def test_a_draw_takes_of_every_file_and_is_the_same_for_the_same_seed(count):
    mutants = [mutant for source in sources.read() for mutant in source.mutants]
    drawn = draw(mutants, count, 7)
    assert len(set(drawn)) == count
    assert drawn == draw(mutants, count, 7)
    assert {mutant.file for mutant in drawn} == set(sources.FILES)


def test_every_equivalent_mutant_exists_and_has_a_reason():
    reasons, stale = equivalent.read({mutant.key for source in sources.read() for mutant in source.mutants})
    assert stale == []
    assert all(len(reason) > len("because ") for reason in reasons.values())

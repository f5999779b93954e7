"""The table of names, also under names that were chosen against it."""

import random
import struct

import pytest
from making import transform
from repetitions import times

from tf2_py._internal import is_invalid_name

pytestmark = pytest.mark.ours


def names_that_fell_together(count):
    """Names of eight letters to which multiplying with the golden ratio gave the same 32 bits."""
    inverse = pow(0x9E3779B97F4A7C15, -1, 2**64)
    names = []
    high = 0
    while len(names) < count:
        name = struct.pack("<Q", (((high << 32 | high ^ 0x12345678) * inverse) % 2**64) ^ 8)
        if name.isascii() and name.isalnum():
            names.append(name.decode())
        high += 1
    return names


@pytest.mark.parametrize("kind", ["that fell together", "of one letter", "counted", "random", "long"])
def test_names_of_any_kind_lie_apart(tf2_py, kind):
    random.seed(1)
    names = {
        "that fell together": lambda: names_that_fell_together(times(60, 300)),
        "of one letter": lambda: ["x" * size for size in range(1, 1000)],
        "counted": lambda: [f"{i:08d}" for i in range(20_000)],
        "random": lambda: [f"{random.getrandbits(64):016x}" for _ in range(20_000)],
        "long": lambda: [f"{'x' * 2000}{i}" for i in range(1000)],
    }[kind]()
    buffer = tf2_py.BufferCore()
    assert buffer.set_transforms([transform("map", name, 1) for name in names], "x") == len(names)
    buffer._self_check()
    assert all(buffer._frameExists(name) for name in names)
    assert not any(buffer._frameExists(name + "y") for name in names[:-1])
    assert buffer._getFrameStrings() == [names[0], "map", *names[1:]]


@pytest.mark.parametrize(
    ("name", "invalid"),
    [("", True), ("/", True), ("/map", True), ("map", False), ("a/b", False), ("\ud800", False)],
)
def test_a_name_is_invalid_if_it_is_empty_or_begins_with_a_slash(name, invalid):
    assert is_invalid_name(name) is invalid

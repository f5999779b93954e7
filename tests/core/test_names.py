"""The table of names, also under names that were chosen against it."""

import os
import random
import struct
import subprocess
import sys

import pytest
from making import transform
from repetitions import times
from tf2_py._core import hash_with_key

from tf2_py._internal import is_invalid_name

pytestmark = pytest.mark.ours

TEXTS = [bytes(range(1, size + 1)) for size in range(1, 65)]


def answer_of(program, **environment):
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    ).stdout.strip()


def pythons_key(seed):
    """The key that CPython makes of PYTHONHASHSEED: `lcg_urandom` of its Python/bootstrap_hash.c."""
    key = []
    for _ in range(16 if seed else 0):
        seed = (seed * 214013 + 2531011) % 2**32
        key.append(seed >> 16 & 0xFF)
    return bytes(key) or bytes(16)


@pytest.mark.skipif(sys.hash_info.algorithm != "siphash13", reason="this Python hashes otherwise")
@pytest.mark.parametrize("seed", [0, 1, 4242])
def test_the_hash_is_that_of_python(seed):
    program = f"print([hash(text) for text in {TEXTS}])"
    theirs = eval(answer_of(program, PYTHONHASHSEED=str(seed)))
    ours = [hash_with_key(text, pythons_key(seed)) for text in TEXTS]
    assert ours == [number % 2**64 for number in theirs]


def test_every_byte_and_the_length_count():
    key = bytes(range(16))
    for text in [b"", *TEXTS]:
        others = {text + b"\0", text + b"x"}
        others |= {text[:i] + b"\xff" + text[i + 1 :] for i in range(len(text))}
        assert len({hash_with_key(other, key) for other in {text, *others}}) == len({text, *others})


def test_each_process_has_a_key_of_its_own():
    program = "from tf2_py._core import hash_with_key; print(hash_with_key(b'map'))"
    answers = {answer_of(program, PYTHONHASHSEED="0") for _ in range(3)}
    assert len(answers) == 3


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

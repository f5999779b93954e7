"""Random buffers travel and stay the same; randomly spoiled ones are refused, or are buffers."""

import random
import tempfile
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from making import transform
from random_histories import FRAMES, TIMES_NS, apply, silence, steps  # noqa: F401
from rclpy.duration import Duration
from travelling import WAYS, everything

from tf2_py import BufferCore, TransformException

pytestmark = pytest.mark.ours

limits = st.fixed_dictionaries(
    {}, optional={"max_frames": st.integers(1, 5), "max_bytes": st.integers(4_000, 12_000)}
)


@settings(deadline=None, max_examples=150)
@given(st.sampled_from(sorted(WAYS)), st.sampled_from([0, 1, 5, 10**10]), limits, steps, steps)
def test_a_random_buffer_arrives_as_it_was_and_goes_on_so(way, cache_ns, limits, before, after):
    buffer = BufferCore(Duration(nanoseconds=cache_ns), **limits)
    apply(buffer, before)
    with tempfile.TemporaryDirectory() as folder:
        arrived = WAYS[way](buffer, Path(folder))
    arrived._self_check()
    assert everything(arrived, FRAMES, TIMES_NS) == everything(buffer, FRAMES, TIMES_NS)
    for step in after:
        apply(buffer, [step])
        apply(arrived, [step])
        assert arrived.statistics() == buffer.statistics()
    assert everything(arrived, FRAMES, TIMES_NS) == everything(buffer, FRAMES, TIMES_NS)
    arrived._self_check()


def base_state():
    buffer = BufferCore()
    for ns in range(20):
        buffer.set_transforms([transform("ab"[ns % 2], "c", ns=ns), transform("root", "a", ns=ns // 2)], "x")
    buffer.set_transform_static(transform("c", "camera"), "y")
    buffer.set_transforms([transform("b", "root", ns=1)], "z")
    return buffer.__getstate__()


ODD = (
    None,
    True,
    0,
    -1,
    1,
    7,
    2**31,
    2**32 - 1,
    2**32,
    2**63,
    2**64,
    1 << 500,
    1.5,
    float("nan"),
    "a",
    b"",
    b"\0",
    b"a\0a\0",
    b"\xff\0",
    [],
    {},
    (),
    (0,) * 12,
    np.zeros(3),
    np.zeros((0, 7)),
    np.uint32(3),
    np.array(None),
)
ODD_NUMBERS = (0, 1, 2, 3, 5, 6, 1000, 2**31 - 1, 2**31, 2**32 - 1, -1, 2**63 - 1, -(2**63))
ODD_DOUBLES = (0.0, -0.0, 1.0, -1.0, 0.5, np.nan, np.inf, -np.inf, 1e308, 5e-324)


def spoil(state, dice):
    """Change one thing."""
    key = dice.choice(sorted(state))
    value = state[key]
    kind = dice.randrange(4)
    if isinstance(value, np.ndarray) and kind and value.ndim and value.size and value.dtype != object:
        if kind == 1:
            index = tuple(dice.randrange(size) for size in value.shape)
            value[index] = (
                dice.choice(ODD_DOUBLES)
                if value.dtype.kind == "f"
                else np.array([dice.choice(ODD_NUMBERS)]).astype(value.dtype)[0]
            )
        elif kind == 2:
            dtype = dice.choice(
                ["u1", "i4", "u4", ">u4", "i8", ">i8", "f4", "f8", ">f8", "O", "m8[ns]", "c16"]
            )
            with np.errstate(all="ignore"), warnings.catch_warnings():
                warnings.simplefilter("ignore")  # NumPy's, of the parts that a conversion drops
                state[key] = value.astype(dtype) if dice.random() < 0.5 else value.view()[::-1]
        else:
            cut = dice.randrange(len(value))
            state[key] = dice.choice(
                [value[cut:], np.concatenate([value, value[:cut]]), np.ravel(value), value.T]
            )
    elif isinstance(value, bytes) and kind:
        at = dice.randrange(len(value) + 1)
        state[key] = (
            value[:at] + dice.choice([b"", b"\0", b"\xff", b"a\0", b"b"]) + value[at + dice.randrange(3) :]
        )
    elif kind == 3:
        del state[key]
    else:
        state[key] = dice.choice(ODD)


@settings(deadline=None, max_examples=100)
@given(st.integers(0, 2**32))
def test_a_randomly_spoiled_state_is_refused_or_is_that_of_a_buffer(seed):
    dice = random.Random(seed)
    template = base_state()
    for _ in range(25):
        state = {
            key: value.copy() if isinstance(value, np.ndarray) else value for key, value in template.items()
        }
        for _ in range(dice.choice([1, 1, 1, 2, 3])):
            if state:
                spoil(state, dice)
        arriving = BufferCore()
        try:
            arriving.__setstate__(state)
        except ValueError as error:
            assert "not the state of a buffer" in str(error) or "cannot be" in str(error)
            assert arriving.statistics()["frames"] == 0
        except MemoryError:  # a capacity without memory for it
            assert arriving.statistics()["frames"] == 0
        else:
            use(arriving, dice)


def use(buffer, dice):
    """Everything that reads or changes histories."""
    buffer._self_check()
    for _ in range(3):
        frames = dice.choices(["a", "b", "c", "root", "camera", "new"], k=20)
        some = [transform(frames[0], child, ns=dice.randrange(40)) for child in frames]
        apply(buffer, [(dice.choice(["dynamic", "dynamic", "static", "clear"]), some, "x")])
        everything(buffer, ("a", "c", "root"), (1, 9))
        for target, source in (("root", "c"), ("c", "camera"), ("a", "b")):
            try:
                buffer.lookup_transforms(target, source, list(range(40)), on_missing="nan")
            except TransformException:
                continue
        buffer._self_check()

"""Fuzz what pickles of buffers hold: a refused state, or a buffer that is sound."""

import pickle
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from reliability.fuzz.faults import Fault, answers, is_same_state
from reliability.fuzz.reading import Input
from reliability.fuzz.targets import cdr_ros
from tf2_py import BufferCore
from tf2_ros import Buffer

_DOUBLES, _COLUMNS = 7, 6
_SCALARS = ("version", "cache_time_ns", "max_frames", "max_bytes", "max_waiters", "taken", "malformed")
# Instead of what belongs to a key.
_ODD: list[Any] = [
    None,
    -1,
    2**31,
    2**63 - 1,
    2**63,
    2**64 - 1,
    2**64,
    10**100,
    True,
    1.5,
    "text",
    b"",
    b"\xff\0",
    b"no end",
    (),
    [],
    {},
    np.zeros(0),
    np.zeros((3, 6), np.uint32),
    np.zeros((2, 7))[:, ::-1],
    np.arange(12, dtype=">u4").reshape(2, 6),
    np.array([1, 2], object),
    np.zeros((2, 7), np.float32),
    np.ma.masked_array([1, 2], [True, False]),
]


def run(data: bytes) -> None:
    """Make a buffer of a state."""
    given = Input(data)
    state = _state(given)
    buffer = Buffer() if given.flag() else BufferCore()
    buffer.set_transforms_cdr(cdr_ros.TWO_TRANSFORMS, "before")
    before = buffer.__getstate__()
    try:
        buffer.__setstate__(state)
    except ValueError:
        if not is_same_state(buffer.__getstate__(), before):
            raise Fault("a refused state has changed the buffer") from None
        buffer._self_check()
        return
    except MemoryError:
        # As large as a state may say that a history is.
        buffer._self_check()
        return
    _check(buffer, state)


def _check(buffer: BufferCore, state: dict[str, Any]) -> None:
    answers(buffer)
    kept = buffer.__getstate__()
    for key in ("stamps", "transforms", "parents", "names", "authorities", "cache_time_ns", "taken"):
        one, other = state[key], kept[key]
        if np.asarray(one).tobytes() != np.asarray(other).tobytes():
            raise Fault(f"{key}: {other!r}, not {one!r}")
    again = pickle.loads(pickle.dumps(buffer, 5))
    if not is_same_state(again.__getstate__(), kept):
        raise Fault(f"a copy holds {again.__getstate__()}, not {kept}")
    # And it goes on as any buffer.
    for message in cdr_ros.VALID:
        buffer.set_transforms_cdr(message, "after")
        buffer._self_check()
    buffer.clear()
    buffer._self_check()


def _state(given: Input) -> dict[str, Any]:
    flags = given.byte()
    state: dict[str, Any] = {
        "version": 1,
        "cache_time_ns": given.whole("q"),
        "max_frames": given.whole("I"),
        "max_bytes": given.whole("I"),
        "max_waiters": given.whole("I"),
        "ever_looped": bool(flags & 1),
        "taken": given.whole("H"),
        "malformed": given.whole("H"),
        "attributes": {},
    }
    state["refused"] = tuple(given.byte() for _ in range(12))
    odd = [(given.byte(), given.byte()) for _ in range(2)] if flags & 2 else []
    for key in ("names", "authorities"):
        state[key] = given.some(given.byte())
    frames, samples = given.below(32), given.byte()
    state["frames"] = np.frombuffer(given.raw(4 * _COLUMNS * frames), np.uint32).reshape(-1, _COLUMNS)
    state["stamps"] = np.frombuffer(given.raw(8 * samples), np.int64)
    state["transforms"] = np.frombuffer(given.raw(8 * _DOUBLES * samples)).reshape(-1, _DOUBLES)
    state["parents"] = np.frombuffer(given.raw(4 * samples), np.uint32)
    keys = [*state, "unknown"]
    for key, value in odd:
        if value == 255:
            state.pop(keys[key % len(keys)], None)
        else:
            state[keys[key % len(keys)]] = _ODD[value % len(_ODD)]
    return state


def packed(buffer: BufferCore, flags: int = 0) -> bytes:
    """The bytes of which :func:`_state` makes the state of a buffer."""
    state = buffer.__getstate__()
    some = [min(state[key], 2**31) for key in ("max_frames", "max_bytes", "max_waiters")]
    head = struct.pack("<BqIIIHH", flags, state["cache_time_ns"], *some, state["taken"], state["malformed"])
    head += bytes(state["refused"])
    for key in ("names", "authorities"):
        head += bytes([len(state[key])]) + state[key]
    head += bytes([len(state["frames"]), len(state["stamps"])])
    return head + b"".join(state[key].tobytes() for key in ("frames", "stamps", "transforms", "parents"))


def buffers() -> Iterator[BufferCore]:
    """Buffers with static and moving frames, parents that change, and loops."""
    yield BufferCore()
    turn = (0.0, 0.0, 0.6, 0.8)
    for count in (1, 2, 5):
        for parents in ((b"map",), (b"map", b"odom"), (b"map", b"base")):
            buffer = BufferCore()
            rows = [(b"base", b"camera", 0, 0, (1.0, 2.0, 3.0), turn)]
            buffer.set_transforms_cdr(cdr_ros.encoded(rows), "a", True)
            for i in range(count):
                rows = [
                    (b"map", b"odom", 100 + i, 0, (float(i), 0.0, 0.0), turn),
                    (parents[i % len(parents)], b"base", 100 + i, 5, (float(i), 1.0, 0.0), turn),
                ]
                buffer.set_transforms_cdr(cdr_ros.encoded(rows), f"authority {i}")
            yield buffer


def seeds() -> Iterator[bytes]:
    """The states of some buffers."""
    for buffer in buffers():
        yield packed(buffer)
    full = BufferCore(1.0, max_frames=5, max_bytes=20000)
    for i in range(40):
        row = (b"map", b"base", 100, i, (float(i), 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        full.set_transforms_cdr(cdr_ros.encoded([row]), "a")
    yield packed(full, 1)

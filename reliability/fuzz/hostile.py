"""Hostile objects: they lie, raise, or change the buffer while it reads them."""

import datetime
import importlib
import re
from collections.abc import Callable
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time as TimeMessage
from rclpy.duration import Duration
from rclpy.time import Time

from reliability.fuzz.reading import Input

__all__ = ["Hostile", "Maker"]

FRAMES = ("map", "odom", "base", "/base", "camera", "", "NO_PARENT", "\u6771", "\ud800", "a\0b", "x" * 300)
STAMPS = (
    0,
    1,
    100 * 10**9,
    100 * 10**9 + 5,
    101 * 10**9,
    10**18,
    2**62,
    2**63 - 1,
    -1,
    -(2**63),
    2**63,
    10**40,
)
NUMBERS: list[Any] = [
    0.0,
    -0.0,
    1.0,
    0.6,
    0.8,
    1e308,
    5e-324,
    float("nan"),
    float("inf"),
    float("-inf"),
    0,
    1,
    -7,
    10**400,
    True,
    None,
    "1.0",
    b"1",
    np.float32(0.5),
    np.float64(0.25),
    np.int64(3),
    np.bool_(True),
    np.array(1.5),
    np.array([1.5]),
    1j,
    object(),
]


class Hostile(Exception):
    """What a hostile object raises."""


class Maker:
    """
    Makes objects as the bytes of a fuzzer say.

    :param act: called while one of them is read.
    """

    def __init__(self, given: Input, act: Callable[[], None]) -> None:
        self._given = given
        self._act = act
        self.messages: list[Any] = []  # made so far, which `spoil` changes while they are read

    def name(self) -> Any:
        """A frame name, or something instead."""
        kind = self._given.byte()
        if kind < 160:
            return FRAMES[kind % 5]
        if kind < 208:
            return FRAMES[kind % len(FRAMES)]
        if kind < 240:
            return _Text(FRAMES[kind % len(FRAMES)], self)
        return self.thing()

    def number(self) -> Any:
        """A float, or something instead."""
        kind = self._given.byte()
        if kind < 96:
            return (0.0, 0.6, 0.8, 1.0)[kind % 4]
        if kind < 128:
            return self._given.double()
        if kind < 192:
            return NUMBERS[kind % len(NUMBERS)]
        if kind < 208:
            return _Float(0.8, self)
        if kind < 240:
            return _Number(self)
        return self.thing()

    def whole(self) -> Any:
        """An int, or something instead."""
        kind = self._given.byte()
        if kind < 128:
            return STAMPS[kind % 4]
        if kind < 192:
            return STAMPS[kind % len(STAMPS)]
        if kind < 208:
            return _Int(5, self)
        return self.number()

    def time(self) -> Any:
        """A time of any kind, or something instead."""
        kind = self._given.byte()
        if kind < 96:
            return STAMPS[kind % 5]
        match kind % 10:
            case 0:
                return self._time_message()
            case 1:
                return Time(nanoseconds=100 * 10**9)
            case 2:
                time = Time(nanoseconds=100 * 10**9)
                time._time_handle = self._handle()
                return time
            case 3:
                return np.datetime64(STAMPS[kind % 4], "ns")
            case 4:
                return np.datetime64("NaT" if kind & 1 else "9999-01-01")
            case 5:
                return datetime.datetime(2020, 1, 1)
            case 6:
                return Duration(nanoseconds=5)
            case 7:
                return datetime.timedelta(seconds=5)
            case 8:
                return self.whole()
            case _:
                return self.thing()

    def _time_message(self) -> Any:
        message = TimeMessage()
        message._sec, message._nanosec = self.whole(), self.whole()
        return self._maybe_spoiled(message)

    def _handle(self) -> Any:
        kind = self._given.byte()
        if kind < 128:
            handle = Time()._time_handle
            return type(handle).__new__(type(handle))  # whose constructor was not called
        return self.thing()

    def times(self) -> Any:
        """Several times, or something instead."""
        kind = self._given.byte()
        some = [self.time() for _ in range(kind % 4)]
        if kind < 64:
            return np.array([100 * 10**9 + i for i in range(kind % 70)], np.int64)
        if kind < 96:
            return np.arange(12, dtype=NUMPY_KINDS[kind % len(NUMPY_KINDS)]).reshape(
                ((12,), (3, 4))[kind % 2]
            )
        if kind < 112:
            return np.array(some, object)
        if kind < 160:
            return some
        return _List(some, self) if kind < 224 else self.thing()

    def thing(self) -> Any:
        """An object with any attributes."""
        return _Thing(self)

    def message(self, cls: type, depth: int = 0) -> Any:
        """A message whose fields may hold anything."""
        message = cls()
        self.messages.append(message)
        for field, kind in cls.get_fields_and_field_types().items():
            self._fill(message, field, kind, depth)
        return self._maybe_spoiled(message)

    def _fill(self, message: Any, field: str, kind: str, depth: int) -> None:
        if not hasattr(type(message), "_" + field):
            return
        part = getattr(message, "_" + field)
        choice = self._given.byte()
        if choice >= 248:
            value = self.thing()
        elif kind in ("double", "float"):
            value = self.number()
        elif kind == "string":
            value = self.name()
        elif kind.startswith(("int", "uint")):
            value = self.whole()
        elif hasattr(type(part), "get_fields_and_field_types") and depth < 5:
            value = part if choice < 32 else self.message(type(part), depth + 1)
        elif isinstance(part, list):
            value = [self._item(kind, depth) for _ in range(choice % 5)]
        elif choice < 192:
            return
        else:
            value = self.number()
        setattr(message, "_" + field, value)

    def _item(self, kind: str, depth: int) -> Any:
        # Of a list: of its class, mostly.
        found = re.fullmatch(r"sequence<(\w+)/(\w+)>", kind)
        if found is None or depth >= 5 or self._given.byte() >= 224:
            return self.thing()
        return self.message(getattr(importlib.import_module(f"{found[1]}.msg"), found[2]), depth + 1)

    def _maybe_spoiled(self, message: Any) -> Any:
        kind = self._given.byte()
        if kind < 208:
            return message
        if kind < 224:
            del_slot(message, kind)
            return message
        if kind < 240:
            return _subclass(type(message), self)
        return self.thing()

    def spoil(self) -> None:
        """Change a message that may be read just now."""
        if not self.messages:
            return
        message = self.messages[self._given.byte() % len(self.messages)]
        slots = slots_of(message)
        slot = slots[self._given.byte() % len(slots)]
        kind = self._given.byte()
        if kind < 64:
            del_slot(message, kind)
        else:
            setattr(message, slot, self.number() if kind < 128 else self.name())

    # What the objects below do when they are read.

    def read(self, usual: Any) -> Any:
        """What a hostile object gives instead of what is usual."""
        kind = self._given.byte()
        if kind < 64:
            return usual
        if kind < 160:
            self._act()
            return usual
        if kind < 176:
            raise Hostile
        if kind < 192:
            raise AttributeError("hostile")
        if kind < 200:
            raise TypeError("hostile")
        return (self.number, self.name, self.whole, self.thing)[kind % 4]()


NUMPY_KINDS = ("i8", ">i8", "u8", "f8", "M8[ns]", "M8[s]", "m8[ns]", "i4", "?", "U3", "O")


def slots_of(message: Any) -> list[str]:
    """The slots of a message's class."""
    return [name for base in type(message).__mro__ for name in base.__dict__.get("__slots__", ())] or ["none"]


def del_slot(message: Any, kind: int) -> None:
    """Delete one attribute; C finds no object there."""
    slots = slots_of(message)
    name = slots[kind % len(slots)]
    if hasattr(message, name):
        delattr(message, name)


class _Text(str):
    def __new__(cls, text: str, maker: Maker) -> "_Text":
        made = super().__new__(cls, text)
        made._maker = maker
        return made

    def __eq__(self, other: object) -> Any:
        return self._maker.read(False)

    def __hash__(self) -> Any:
        return self._maker.read(5)

    def __str__(self) -> Any:
        return self._maker.read("text")

    def __len__(self) -> Any:
        return self._maker.read(3)

    def encode(self, *_: Any) -> Any:
        return self._maker.read(b"text")


class _Float(float):
    def __new__(cls, number: float, maker: Maker) -> "_Float":
        made = super().__new__(cls, number)
        made._maker = maker
        return made

    def __float__(self) -> Any:
        return self._maker.read(0.5)

    def __eq__(self, other: object) -> Any:
        return self._maker.read(True)

    __hash__ = None


class _Int(int):
    def __new__(cls, number: int, maker: Maker) -> "_Int":
        made = super().__new__(cls, number)
        made._maker = maker
        return made

    def __index__(self) -> Any:
        return self._maker.read(7)

    def __int__(self) -> Any:
        return self._maker.read(7)

    def __mul__(self, other: object) -> Any:
        return self._maker.read(7)

    def __lt__(self, other: object) -> Any:
        return self._maker.read(True)


class _Number:
    def __init__(self, maker: Maker) -> None:
        self._maker = maker

    def __float__(self) -> Any:
        return self._maker.read(0.5)

    def __index__(self) -> Any:
        return self._maker.read(5)


class _List(list[Any]):
    def __init__(self, items: list[Any], maker: Maker) -> None:
        super().__init__(items)
        self._maker = maker

    def __len__(self) -> Any:
        return self._maker.read(super().__len__())

    def __iter__(self) -> Any:
        yield self._maker.read(5)
        yield from super().__iter__()
        self.clear()
        yield self._maker.read(5)

    def __getitem__(self, at: Any) -> Any:
        return self._maker.read(super().__getitem__(at))


class _Thing:
    def __init__(self, maker: Maker) -> None:
        object.__setattr__(self, "_maker", maker)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        maker = object.__getattribute__(self, "_maker")
        usual = {"frame_id": "map", "child_frame_id": "base", "sec": 100, "nanosec": 5, "nanoseconds": 5}
        return maker.read(usual[name] if name in usual else 0.5 if len(name) == 1 else _Thing(maker))

    def __len__(self) -> Any:
        return object.__getattribute__(self, "_maker").read(2)

    def __iter__(self) -> Any:
        maker = object.__getattribute__(self, "_maker")
        while maker._given.left > 0:
            yield maker.read(1.0)

    def __bool__(self) -> Any:
        return object.__getattribute__(self, "_maker").read(True)


def _subclass(cls: type, maker: Maker) -> Any:
    # Of its fields, one is a property that does as it likes.
    fields = [name for name in slots_of(cls()) if name != "_check_fields"]
    name = fields[maker._given.byte() % len(fields)].lstrip("_")

    def read(self: Any) -> Any:
        return maker.read(getattr(self, "_" + name))

    return type("Hostile" + cls.__name__, (cls,), {name: property(read, lambda self, value: None)})()

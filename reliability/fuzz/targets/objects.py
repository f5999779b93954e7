"""Fuzz what reads objects: whatever they do, the error is of the right class and the buffer is sound."""

from collections.abc import Iterator
from typing import Any

from geometry_msgs.msg import TransformStamped

from reliability.fuzz.hostile import Hostile, Maker
from reliability.fuzz.reading import Input
from reliability.fuzz.targets import cdr_ros
from tf2_geometry_msgs import _types as of_geometry
from tf2_py import BufferCore, TransformException
from tf2_py._tf2_py import serialize_transforms
from tf2_sensor_msgs import _types as of_sensors

# What callers of tf2 expect, and what the objects themselves raise; MemoryError where one says it is huge.
EXPECTED = (TypeError, ValueError, OverflowError, AttributeError, MemoryError, TransformException, Hostile)
MOST_STEPS, MOST_DEPTH = 12, 2
_TYPES = [*of_geometry.TYPES.items(), *of_sensors.TYPES.items()]


def run(data: bytes) -> None:
    """Call a buffer, with objects that may call it again."""
    world = _World(Input(data))
    for _ in range(MOST_STEPS):
        if not world.given.left:
            break
        world.step()
        world.buffer._self_check()


class _World:
    def __init__(self, given: Input) -> None:
        self.given = given
        self.buffer = BufferCore()
        self.buffer.set_transforms_cdr(cdr_ros.TWO_TRANSFORMS, "before")
        self.make = Maker(given, self.act)
        self.depth = 0
        self.waits: list[Any] = []

    def act(self) -> None:
        """In the midst of a step."""
        if self.depth >= MOST_DEPTH:
            return
        if self.given.flag():
            self.make.spoil()
        else:
            self.step()

    def step(self) -> None:
        call = self.given.choice(_CALLS)
        self.depth += 1
        try:
            call(self)
        except (*EXPECTED, RecursionError):
            pass
        finally:
            self.depth -= 1

    # The steps.

    def insert(self) -> None:
        self.buffer.set_transform(self.make.message(TransformStamped), self.make.name())

    def insert_static(self) -> None:
        self.buffer.set_transform_static(self.make.message(TransformStamped), self.make.name())

    def insert_some(self) -> None:
        count = self.given.below(4)
        some: Any = [self.make.message(TransformStamped) for _ in range(count)]
        if self.given.byte() >= 192:
            some = self.make.times()
        self.buffer.set_transforms(some, self.make.name(), static=self.given.flag())

    def insert_bytes(self) -> None:
        data: Any = bytearray(cdr_ros.TWO_TRANSFORMS)
        match self.given.below(8):
            case 0:
                data = memoryview(data)[::2]
            case 1:
                data = self.make.thing()
            case 2:
                data = memoryview(data).cast("I")
            case 3:
                data = self.make.times()
        try:
            self.buffer.set_transforms_cdr(data, self.make.name())
        except BufferError:
            if not isinstance(data, memoryview):  # whose bytes do not follow one another
                raise

    def look_up(self) -> None:
        self.buffer.lookup_transform_core(self.make.name(), self.make.name(), self.make.time())

    def look_up_full(self) -> None:
        make = self.make
        self.buffer.lookup_transform_full_core(
            make.name(), make.time(), make.name(), make.time(), make.name()
        )

    def look_up_many(self) -> None:
        make = self.make
        full = {"fixed_frame": make.name(), "target_time": make.time()} if self.given.flag() else {}
        self.buffer.lookup_transforms(make.name(), make.name(), make.times(), on_missing="nan", **full)

    def points(self) -> None:
        self.buffer.transform_points(self.make.times(), self.make.times(), self.make.name(), self.make.name())

    def can(self) -> None:
        make = self.make
        self.buffer.can_transform_core(make.name(), make.name(), make.time())
        self.buffer.can_transform_full_core(make.name(), make.time(), make.name(), make.time(), make.name())

    def velocity(self) -> None:
        make = self.make
        self.buffer.lookupVelocityFullCore(
            make.name(), make.name(), make.name(), make.times(), make.name(), make.time(), make.time()
        )

    def others(self) -> None:
        make = self.make
        self.buffer.get_latest_common_time(make.name(), make.name())
        self.buffer._chain(make.name(), make.time(), make.name(), make.time(), make.name())
        self.buffer._frameExists(make.name())
        self.buffer._allFramesAsDot(make.time())

    def contains(self) -> None:
        bool(self.make.name() in self.buffer)

    def wait(self) -> None:
        make = self.make
        self.waits.append(self.buffer._wait(make.name(), make.name(), make.time(), notify=self.notified))
        self.buffer._pending_waits()

    def notified(self, answer: Any) -> Any:
        return self.act

    def drop_waits(self) -> None:
        self.waits.clear()

    def clear(self) -> None:
        self.buffer.clear()

    def begin_again(self) -> None:
        if self.given.flag():
            self.buffer.__init__(self.make.time(), max_frames=self.make.whole())
        else:
            self.buffer.__init__()
            self.buffer.set_transforms_cdr(cdr_ros.TWO_TRANSFORMS, "again")

    def replace(self) -> None:
        self.buffer = BufferCore()

    def set_state(self) -> None:
        state = self.buffer.__getstate__()
        keys = list(state)
        state[keys[self.given.byte() % len(keys)]] = self.make.number()
        self.buffer.__setstate__(state)

    def write(self) -> None:
        serialize_transforms([self.make.message(TransformStamped) for _ in range(self.given.below(3))])

    def transform(self) -> None:
        cls, function = self.given.choice(_TYPES)
        message = self.make.message(cls)
        function(message, self.make.message(TransformStamped))


_CALLS = [
    _World.insert,
    _World.insert,
    _World.insert_static,
    _World.insert_some,
    _World.insert_bytes,
    _World.look_up,
    _World.look_up_full,
    _World.look_up_many,
    _World.points,
    _World.can,
    _World.velocity,
    _World.others,
    _World.contains,
    _World.wait,
    _World.drop_waits,
    _World.clear,
    _World.begin_again,
    _World.replace,
    _World.set_state,
    _World.write,
    _World.transform,
    _World.transform,
]


def seeds() -> Iterator[bytes]:
    """One input for each call, with ordinary objects, and with hostile ones."""
    for number in range(len(_CALLS)):
        yield bytes([number]) + bytes(80)
        yield bytes([number]) + bytes(range(0, 250, 5))
        yield bytes([number]) + bytes(range(250, 0, -3))
        yield bytes([number]) + bytes([64, 255, 100, 33, 224, 7] * 12)

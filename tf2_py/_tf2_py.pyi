from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal, Protocol, TypedDict, TypeVar

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import ArrayLike, NDArray
from rclpy.time import Time

from tf2_py._objects.listings import FrameInfo

class _Nanoseconds(Protocol):
    @property
    def nanoseconds(self) -> int: ...

class _SecNanosec(Protocol):
    @property
    def sec(self) -> int: ...
    @property
    def nanosec(self) -> int: ...

_TimeLike = _Nanoseconds | _SecNanosec
_DurationLike = _Nanoseconds | _SecNanosec
_Times = ArrayLike | Sequence[_TimeLike]  # an ArrayLike holds integer nanoseconds
_Float = TypeVar("_Float", np.float32, np.float64)
_Vector = tuple[float, float, float]  # x y z

# What BufferCore.statistics returns; all are counts but `bytes`.
class _Statistics(TypedDict):
    taken: int
    refused: dict[str, int]
    frames: int
    samples: int
    bytes: int
    waiters: int
    waits_refused: int
    malformed_messages: int

class _Wait:  # tf2_py._engine.wait.Wait
    @property
    def answer(self) -> TransformStamped | None: ...
    def cancel(self) -> bool: ...
    def reason(self) -> Exception | None: ...
    def lacks(self) -> str: ...
    def wait_for(self, timeout_ns: int, alive: Callable[[], bool]) -> bool: ...

class BufferCore:
    @property
    def _throttle(self) -> Any: ...
    @property
    def cache_time_ns(self) -> int: ...
    def __init__(
        self,
        cache_time: _DurationLike | None = None,
        *,
        max_frames: int | None = None,
        max_bytes: int | None = None,
        max_waiters: int | None = None,
    ) -> None: ...
    def set_transform(self, transform: TransformStamped, authority: str) -> None: ...
    def set_transform_static(self, transform: TransformStamped, authority: str) -> None: ...
    def set_transforms(
        self, transforms: Iterable[TransformStamped], authority: str, static: bool = False
    ) -> int: ...
    def set_transforms_cdr(
        self, data: bytes | bytearray | memoryview, authority: str, static: bool = False
    ) -> int: ...
    def clear(self) -> None: ...
    def lookup_transform_core(
        self, target_frame: str, source_frame: str, time: _TimeLike
    ) -> TransformStamped: ...
    def lookup_transform_full_core(
        self,
        target_frame: str,
        target_time: _TimeLike,
        source_frame: str,
        source_time: _TimeLike,
        fixed_frame: str,
    ) -> TransformStamped: ...
    def lookup_transforms(
        self,
        target_frame: str,
        source_frame: str,
        times: _Times,
        *,
        fixed_frame: str | None = None,
        target_time: _TimeLike | None = None,
        on_missing: Literal["raise", "nan"] = "raise",
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def transform_points(
        self,
        points: NDArray[_Float],
        times: _Times,
        target_frame: str,
        source_frame: str,
        *,
        fixed_frame: str | None = None,
        target_time: _TimeLike | None = None,
    ) -> NDArray[_Float]: ...
    def can_transform_core(
        self, target_frame: str, source_frame: str, time: _TimeLike
    ) -> tuple[int, str]: ...
    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: _TimeLike,
        source_frame: str,
        source_time: _TimeLike,
        fixed_frame: str,
    ) -> tuple[int, str]: ...
    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time: ...
    def lookupVelocityCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        time: _TimeLike,
        averaging_interval: _DurationLike,
    ) -> tuple[_Vector, _Vector]: ...
    def lookupVelocityFullCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: Sequence[float],
        reference_point_frame: str,
        time: _TimeLike,
        averaging_interval: _DurationLike,
    ) -> tuple[_Vector, _Vector]: ...
    def __contains__(self, name: object) -> bool: ...
    def frames(self) -> dict[str, FrameInfo]: ...
    def tree(self) -> str: ...
    def all_frames_as_yaml(self) -> str: ...
    def all_frames_as_string(self) -> str: ...
    def _allFramesAsDot(self, time: _TimeLike | None = None) -> str: ...
    def _frameExists(self, name: str) -> bool: ...
    def _getFrameStrings(self) -> list[str]: ...
    def _chain(
        self,
        target_frame: str,
        target_time: _TimeLike,
        source_frame: str,
        source_time: _TimeLike,
        fixed_frame: str,
    ) -> list[str]: ...
    def _wait(
        self,
        target_frame: str,
        source_frame: str,
        time: _TimeLike,
        fixed_frame: str | None = None,
        target_time: _TimeLike | None = None,
        notify: Callable[[TransformStamped], Any] | None = None,
    ) -> _Wait: ...
    def _pending_waits(self, most: int = 1000) -> list[str]: ...
    @property
    def _new_data_callbacks(self) -> list[Callable[[], Any]]: ...
    def statistics(self) -> _Statistics: ...
    def _self_check(self) -> None: ...

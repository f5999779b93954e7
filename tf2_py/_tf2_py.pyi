# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from typing import Any, Literal, TypedDict, TypeVar, overload

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray
from rclpy.time import Time
from typing_extensions import Unpack

from tf2_py._objects.errors import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py._objects.explanations import Explanation
from tf2_py._objects.listings import FrameInfo, History
from tf2_py.typing import DurationLike, LookupPolicy, TimeLike, TimesLike

__all__ = [
    "BufferCore",
    "ConnectivityException",
    "ExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "TimeoutException",
    "TransformException",
]

_Buffer = TypeVar("_Buffer", bound="BufferCore")
_Float = TypeVar("_Float", np.float32, np.float64)
_Matrix = TypeVar("_Matrix", bound=NDArray[np.floating[Any]])
_Vector = tuple[float, float, float]  # x y z

# What BufferCore.statistics returns; all are counts except `bytes`.
class _Statistics(TypedDict):
    taken: int
    refused: dict[str, int]
    frames: int
    samples: int
    displaced: int
    bytes: int
    waiters: int
    malformed_messages: int

class _Wait:  # Wait of tf2_py/engine/wait.pxi
    def outcome(self, again: bool = False) -> TransformStamped | BaseException | None: ...
    def take(self, again: bool = False) -> TransformStamped | None: ...
    @property
    def must_be_tried(self) -> bool: ...
    def cancel(self) -> bool: ...
    def reason(self) -> BaseException | None: ...
    def is_of_clock(self, error: BaseException) -> bool: ...
    def wait_for(self, timeout_ns: int, is_in_vain: Callable[[], bool]) -> TransformStamped | None: ...

class BufferCore:
    @property
    def cache_time_ns(self) -> int: ...
    def _tf2_names(self) -> list[str]: ...
    def _tf2_replace(self, data: bytes, authority: str, logs_refused: bool) -> int: ...
    def __init__(
        self,
        cache_time: DurationLike | None = None,
        *,
        max_frames: int | None = None,
        max_bytes: int | None = None,
    ) -> None: ...
    def set_transform(
        self, transform: TransformStamped, authority: str, *, replace: bool = False
    ) -> None: ...
    def set_transform_static(self, transform: TransformStamped, authority: str) -> None: ...
    def set_transforms(
        self,
        transforms: Iterable[TransformStamped],
        authority: str,
        static: bool = False,
        *,
        replace: bool = False,
    ) -> int: ...
    def set_transforms_cdr(
        self, data: bytes | bytearray | memoryview, authority: str, static: bool = False
    ) -> int: ...
    def clear(self) -> None: ...
    def forget(self, frame: str) -> bool: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def __getstate__(self) -> dict[str, Any]: ...
    def _tf2_attributes(self) -> dict[str, Any]: ...
    def __setstate__(self, state: dict[str, Any]) -> None: ...
    def _tf2_restored(self) -> None: ...
    def freeze(self, path: str | PathLike[str]) -> None: ...
    @classmethod
    def open(cls: type[_Buffer], path: str | PathLike[str]) -> _Buffer: ...
    def lookup_transform_core(
        self, target_frame: str, source_frame: str, time: TimeLike
    ) -> TransformStamped: ...
    def lookup_transform_full_core(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> TransformStamped: ...
    def lookup_transforms(
        self,
        target_frame: str,
        source_frame: str | Sequence[str],
        times: TimesLike,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        on_missing: Literal["raise", "nan"] = "raise",
        **policy: Unpack[LookupPolicy],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    @overload
    def lookup_matrix(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        out: None = None,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.float64]: ...
    @overload
    def lookup_matrix(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        out: _Matrix,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> _Matrix: ...
    def lookup_matrices(
        self,
        target_frame: str,
        source_frame: str | Sequence[str],
        times: TimesLike,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        on_missing: Literal["raise", "nan"] = "raise",
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.float64]: ...
    @overload
    def transform_points(
        self,
        points: Sequence[Sequence[float]],
        times: TimesLike,
        target_frame: str,
        source_frame: str,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[np.float64]: ...
    @overload
    def transform_points(
        self,
        points: NDArray[_Float],
        times: TimesLike,
        target_frame: str,
        source_frame: str,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> NDArray[_Float]: ...
    def can_transform_core(self, target_frame: str, source_frame: str, time: TimeLike) -> tuple[int, str]: ...
    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> tuple[int, str]: ...
    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Time: ...
    def explain(
        self, target_frame: str, source_frame: str, time: TimeLike = 0, **policy: Unpack[LookupPolicy]
    ) -> Explanation: ...
    def time_range(self, target_frame: str, source_frame: str) -> tuple[int, int]: ...
    def _tf2_follow_clock(self, clock: Any) -> None: ...
    def _tf2_clear(self, hand_over: Callable[[Any], object]) -> None: ...
    def _tf2_clock_jumped(self, hand_over: Callable[[Any], object] | None = None) -> None: ...
    def ages(self, target_frame: str, source_frame: str) -> dict[str, float]: ...
    def _poses_between(
        self,
        target_frame: str,
        source_frame: str,
        first_ns: int,
        last_ns: int,
        turn: float,
        move: float,
        most: int,
        *,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        **policy: Unpack[LookupPolicy],
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]] | None: ...
    def lookupVelocityCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        time: TimeLike,
        averaging_interval: DurationLike,
    ) -> tuple[_Vector, _Vector]: ...
    def lookupVelocityFullCore(
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: Sequence[float],
        reference_point_frame: str,
        time: TimeLike,
        averaging_interval: DurationLike,
    ) -> tuple[_Vector, _Vector]: ...
    def __contains__(self, name: object) -> bool: ...
    def histories(self) -> dict[str, History]: ...
    def frames(self) -> dict[str, FrameInfo]: ...
    def parent(self, frame: str, time: TimeLike = 0) -> str | None: ...
    def children(self, frame: str) -> list[str]: ...
    def path(self, target_frame: str, source_frame: str, time: TimeLike = 0) -> list[str]: ...
    def tree(self) -> str: ...
    def all_frames_as_yaml(self) -> str: ...
    def all_frames_as_string(self) -> str: ...
    def _allFramesAsDot(self, time: TimeLike | None = None) -> str: ...
    def _frameExists(self, name: str) -> bool: ...
    def _getFrameStrings(self) -> list[str]: ...
    def _chain(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> list[str]: ...
    def _wait(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        notify: Callable[..., Any] | None = None,
        policy: Any = None,
        after: _Wait | None = None,
        until_refused: bool = False,
    ) -> _Wait: ...
    def _tf2_look_up(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        policy: Any = None,
        or_none: bool = False,
    ) -> TransformStamped | None: ...
    def _tf2_can_look_up(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        fixed_frame: str | None = None,
        target_time: TimeLike | None = None,
        policy: Any = None,
    ) -> bool: ...
    def _tf2_can(self, target_frame: str, source_frame: str, time: TimeLike) -> bool: ...
    def _tf2_can_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
    ) -> bool: ...
    def _describe_silence_with(self, find_silence: Callable[[Any], tuple[str, str]]) -> None: ...
    def statistics(self) -> _Statistics: ...
    def _self_check(self) -> None: ...

# For the modules of this project.

DURATION_TO_USE: str
FOR_EVER_NS: int
LIMITS: dict[str, int]
TIMES_TO_USE: str
TIMES_WITHOUT_ROS: str

def as_times_ns(times: Any, *, accepts_nat: bool = False) -> NDArray[np.int64]: ...
def mask_of(values: Any) -> NDArray[np.bool_] | None: ...
def time_ns(time: Any, argument: str) -> int: ...
def duration_ns(duration: Any, argument: str) -> int: ...
def stamp_parts(time: Any, argument: str) -> tuple[int, int]: ...
def frame_name(name: object, argument: str) -> str: ...
def bool_of(value: Any, argument: str) -> bool: ...
def policy_of(call: str, waits: bool, /, **policy: Unpack[LookupPolicy]) -> Any: ...
def refused_transforms(transforms: list[TransformStamped]) -> list[tuple[str, str]]: ...
def serialize_as_ros(
    transforms: list[TransformStamped],
) -> tuple[bytes, list[tuple[str, str]]] | None: ...
def normalize(rotations: NDArray[np.float64], *, nan_missing: bool = False) -> int: ...
def matrices_from_rotations(rotations: NDArray[np.float64]) -> NDArray[np.float64]: ...
def keep_for_ever(*things: object) -> None: ...

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Convert between messages and NumPy and data frames: matrices, arrays, columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import deepcopy
from typing import Any, TypeAlias, TypeVar, overload

import numpy as np
import numpy.typing as npt

from tf2_py._internal import (
    as_times_ns,
    bool_of,
    mask_of,
    matrices_from_rotations,
    normalize,
    time_ns,
)
from tf2_py.typing import TimesLike
from tf2_ros._messages import Header, Pose, PoseStamped, Quaternion, Transform, TransformStamped

__all__ = [
    "from_matrix",
    "propagate",
    "to_arrays",
    "to_columns",
    "to_matrix",
    "to_nanoseconds",
]

Array: TypeAlias = npt.NDArray[np.float64]
Pair: TypeAlias = tuple[npt.ArrayLike, npt.ArrayLike]  # translations, shape (..., 3); rotations, (..., 4)
Message: TypeAlias = Transform | TransformStamped | Pose | PoseStamped
_Float = TypeVar("_Float", np.float32, np.float64)
_Message = TypeVar("_Message", Transform, TransformStamped, Pose, PoseStamped)

# How far a matrix may differ from a rotation; a product of a few float32 matrices differs less.
TOLERANCE = 1e-5
ROUNDED = 0.1  # a rotation whose numbers have two decimals differs by less
OF_ARRAYS = "translations and rotations: expected numbers"


@overload
def to_matrix(transforms: Message | Pair, *, dtype: type[float] = ...) -> Array: ...
@overload
def to_matrix(transforms: Message | Pair, *, dtype: type[_Float]) -> npt.NDArray[_Float]: ...
def to_matrix(transforms: Message | Pair, *, dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    """
    Make the homogeneous matrix of a transform or a pose, or the matrices of arrays of transforms.

    :param transforms: a ``TransformStamped``, ``Transform``, ``PoseStamped`` or ``Pose``, or an object with
        the fields of one; or a tuple ``(translations, rotations)`` of arrays of shape (N, 3), meters, and
        (N, 4), x y z w, as :func:`to_arrays` and ``Buffer.lookup_transforms`` return it. N may be any
        shape, or be absent for a single transform.
    :param dtype: ``numpy.float64`` or ``numpy.float32``, to which the results are rounded.
    :return: shape (4, 4) or (N, 4, 4): ``to_matrix(t) @ [x, y, z, 1]`` is the point (x, y, z), in meters,
        transformed by ``t``. A row of NaN in ``rotations`` makes its matrix NaN.
    :raises TypeError: the type is wrong, or an element is not a number.
    :raises ValueError: a shape is wrong, or the length of a rotation is zero or not finite.

    >>> from tf2_ros.numpy import to_matrix
    >>> to_matrix(([[1.0, 2.0, 3.0]], [[0.0, 0.0, 0.0, 1.0]]))[0, :3, 3]
    array([1., 2., 3.])
    """
    if np.dtype(dtype) not in (np.float64, np.float32):
        raise TypeError(f"dtype: expected numpy.float64 or numpy.float32, got {dtype!r}")
    translations, turns = _translations_and_turns(transforms)
    matrices = np.zeros((*turns.shape[:-2], 4, 4), dtype)
    matrices[..., :3, :3] = turns
    matrices[..., :3, 3] = translations
    matrices[..., 3, 3] = 1
    matrices[np.isnan(turns[..., 0, 0])] = np.nan
    return matrices


@overload
def from_matrix(matrix: npt.ArrayLike) -> Transform: ...
@overload
def from_matrix(
    matrix: npt.ArrayLike, *, header: Header | None = None, child_frame_id: str
) -> TransformStamped: ...
@overload
def from_matrix(
    matrix: npt.ArrayLike,
    message_class: type[_Message],
    *,
    header: Header | None = None,
    child_frame_id: str | None = None,
) -> _Message: ...
def from_matrix(
    matrix: npt.ArrayLike,
    message_class: type[Message] | None = None,
    *,
    header: Header | None = None,
    child_frame_id: str | None = None,
) -> Message:
    """
    Convert a homogeneous matrix to a message. :func:`to_arrays` takes many matrices.

    :param matrix: shape (4, 4): a rotation, a translation in meters, and the last row 0 0 0 1.
    :param message_class: ``Transform``, ``TransformStamped``, ``Pose`` or ``PoseStamped``. Without it: a
        ``TransformStamped`` if ``child_frame_id`` is given, otherwise a ``Transform``.
    :param header: copied into a stamped message. None: an empty header.
    :param child_frame_id: of a ``TransformStamped``; without it, empty.
    :return: a new message; its quaternion has length one and w >= 0.
    :raises TypeError: the class is wrong or lacks an attribute that is given, or an element is
        not a number.
    :raises ValueError: the shape is wrong, or a matrix is not a rigid transform; the text says by how much.

    >>> import numpy
    >>> from tf2_ros.numpy import from_matrix
    >>> from_matrix(numpy.eye(4), child_frame_id="camera").transform.rotation.w
    1.0
    """
    if message_class is None:
        message_class = Transform if child_frame_id is None else TransformStamped
    array = _matrices(matrix)
    if array.ndim != 2:
        raise ValueError(f"matrix: expected the shape (4, 4), got {array.shape}; to_arrays takes many")
    message = message_class()
    translation, rotation = _parts_of(message)
    for name, value in (("header", header), ("child_frame_id", child_frame_id)):
        if value is not None:
            if not hasattr(message, name):
                raise TypeError(f"a {message_class.__name__} has no {name}")
            setattr(message, name, deepcopy(value))
    xyz, xyzw = _translations_and_rotations(array)
    translation.x, translation.y, translation.z = xyz.tolist()
    _set_quaternion(rotation, xyzw)
    return message


def to_arrays(transforms: Iterable[Message] | npt.NDArray[Any]) -> tuple[Array, Array]:
    """
    Make arrays of transforms or poses, or of homogeneous matrices.

    :param transforms: N messages, each as for :func:`to_matrix`, also an array of objects; or an array of
        matrices of shape (N, 4, 4), each as for :func:`from_matrix`, or NaN or masked throughout. For
        matrices, N may be any shape, or be absent for a single one.
    :return: ``(translations, rotations)``: float64 arrays of shape (N, 3), meters, and (N, 4), x y z w of
        length one; NaN for a matrix of NaN. Rotations of matrices have w >= 0.
    :raises TypeError: the type is wrong.
    :raises ValueError: the length of a rotation is zero or not finite, or a matrix is not a rigid transform.

    >>> import numpy
    >>> from tf2_ros.numpy import to_arrays
    >>> translations, rotations = to_arrays(numpy.stack([numpy.eye(4)] * 3))
    >>> translations.shape, rotations.shape
    ((3, 3), (3, 4))
    """
    if isinstance(transforms, np.ndarray) and (transforms.ndim != 1 or transforms.dtype != object):
        return _translations_and_rotations(_matrices(transforms))
    return _arrays([_numbers_of(msg) for msg in transforms])


@overload
def to_columns(transforms: Pair, times: Any) -> dict[str, npt.NDArray[Any]]: ...
@overload
def to_columns(transforms: Iterable[TransformStamped | PoseStamped]) -> dict[str, npt.NDArray[Any]]: ...
def to_columns(
    transforms: Pair | Iterable[TransformStamped | PoseStamped], times: Any = None
) -> dict[str, npt.NDArray[Any]]:
    """
    Make the columns of a data frame: ``pandas.DataFrame(to_columns(...))``, ``polars.DataFrame(...)``.

    :param transforms: a tuple ``(translations, rotations)`` of arrays of shape (N, 3), meters, and (N, 4),
        x y z w; or N stamped messages, each as for :func:`to_matrix`.
    :param times: N times, as for ``Buffer.lookup_transforms``; not for messages, which have stamps.
    :return: new arrays of shape (N,): ``stamp_ns``, int64, nanoseconds; ``x``, ``y``, ``z``, float64, meters;
        ``qx``, ``qy``, ``qz``, ``qw``, float64, of length one. NaN where the rotation is NaN.
    :raises TypeError: the type is wrong, arrays have no times, or messages have times.
    :raises AttributeError: a message has no header.
    :raises ValueError: shapes are wrong, the numbers of times and transforms differ, or the length of
        a rotation is zero or not finite.

    >>> from tf2_ros.numpy import to_columns
    >>> list(to_columns(([[1.0, 2.0, 3.0]], [[0.0, 0.0, 0.0, 1.0]]), [1_000_000_000]))
    ['stamp_ns', 'x', 'y', 'z', 'qx', 'qy', 'qz', 'qw']
    """
    if isinstance(transforms, tuple) and not any(hasattr(part, "header") for part in transforms):
        if times is None:
            raise TypeError("arrays have no stamps: pass times")
        stamps_ns = as_times_ns(times, accepts_nat=True)
        translations, rotations = _pair(transforms)
    else:
        if times is not None:
            raise TypeError("messages have stamps: omit times")
        msgs: list[Any] = list(transforms)
        stamps_ns = np.array([time_ns(msg.header.stamp, "header.stamp") for msg in msgs], dtype=np.int64)
        translations, rotations = to_arrays(msgs)
    if rotations.shape != (len(stamps_ns), 4):
        raise ValueError(
            f"times: expected one for each transform, got {len(stamps_ns)} times and rotations of shape "
            f"{rotations.shape}"
        )
    return {
        "stamp_ns": stamps_ns.copy(),
        **{name: translations[:, i].copy() for i, name in enumerate(("x", "y", "z"))},
        **{name: rotations[:, i].copy() for i, name in enumerate(("qx", "qy", "qz", "qw"))},
    }


def propagate(covariances: npt.ArrayLike, transforms: Message | Pair, *, lever_arm: bool = False) -> Array:
    """
    Propagate covariances of poses or of twists through transforms.

    :param covariances: shape (N, 6, 6), or (6, 6) for all transforms; N may be any shape. The order is the
        same as in a ``PoseWithCovariance``, in meters and radians, or in a twist, in m/s and rad/s, in the
        axes of the source frame.
    :param transforms: as for :func:`to_matrix`, N or one, which serves all covariances.
    :param lever_arm: False: the covariances belong to poses in the source frame, which rotate about their own
        origins; the results are the same as from
        ``tf2_geometry_msgs.do_transform_pose_with_covariance``, and the translation has no effect. True:
        propagate the uncertainty of the source frame's own pose to the target frame, which must be on the
        same rigid body; the lever arm turns angular into linear uncertainty.
    :return: float64, shape (N, 6, 6): in the axes of the target frame. NaN where the transform is NaN.
    :raises TypeError: the type is wrong, or there are no numbers.
    :raises ValueError: a shape is wrong, the numbers of covariances and transforms differ, or the length of a
        rotation is zero or not finite.

    A C A^T, where A has the blocks R, [t]x R / 0, R: the adjoint of the transform (R, t). T. D. Barfoot and
    P. T. Furgale, Associating Uncertainty with Three-Dimensional Poses for Use in Estimation Problems, IEEE
    Transactions on Robotics 30(3), 2014. Without ``lever_arm``, t is 0.

    >>> import numpy
    >>> from tf2_ros.numpy import propagate
    >>> a_quarter_turn = ([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0, 1.0]])
    >>> propagate(numpy.diag([0.04, 0.01, 0, 0, 0, 0]), a_quarter_turn)[0].diagonal()[:2].round(6)
    array([0.01, 0.04])
    """
    has_lever_arm = bool_of(lever_arm, "lever_arm")
    values = _floats(covariances, "covariances: expected numbers")
    if values.shape[-2:] != (6, 6):
        raise ValueError(f"covariances: expected the shape (N, 6, 6), got {values.shape}")
    translations, turns = _translations_and_turns(transforms)
    many, others = values.shape[:-2], turns.shape[:-2]
    if many and others and many != others:
        raise ValueError(
            f"covariances: expected one for each transform, got the shape {values.shape} for rotations of "
            f"shape {(*others, 4)}"
        )
    adjoint = np.zeros((*others, 6, 6))
    adjoint[..., :3, :3] = adjoint[..., 3:, 3:] = turns
    if has_lever_arm:
        adjoint[..., :3, 3:] = np.cross(translations[..., None], turns, axis=-2)
    propagated: Array = adjoint @ values @ np.swapaxes(adjoint, -1, -2)
    return propagated


def to_nanoseconds(times: TimesLike) -> npt.NDArray[np.int64]:
    """
    Convert times of any accepted type to nanoseconds.

    :param times: N times, as for ``Buffer.lookup_transforms``.
    :return: int64, shape (N,).
    :raises TypeError: these are not times; a float cannot represent current times to the nanosecond.
    :raises ValueError: the shape is wrong.
    :raises OverflowError: a time does not fit into 64 bits.

    >>> from tf2_ros import Time
    >>> from tf2_ros.numpy import to_nanoseconds
    >>> to_nanoseconds([Time(seconds=1), 2_000_000_000])
    array([1000000000, 2000000000])
    """
    return as_times_ns(times)


def _arrays(rows: Sequence[tuple[float, ...]]) -> tuple[Array, Array]:
    numbers = _floats(rows, OF_ARRAYS).reshape(len(rows), 7)
    rotations = numbers[:, 3:].copy()
    bad = normalize(rotations)
    if bad >= 0:
        given = rows[bad][3:]
        raise ValueError(f"the rotation of message {bad} must have a finite, non-zero length, got {given}")
    return numbers[:, :3].copy(), rotations


def _one(msg: Any) -> tuple[Array, Array]:
    translations, rotations = _arrays([_numbers_of(msg)])
    return translations[0], rotations[0]


def _translations_and_turns(transforms: Message | Pair) -> tuple[Array, Array]:
    """Read what :func:`to_matrix` takes: shapes (..., 3) and, matrices of rotations, (..., 3, 3)."""
    translations, rotations = _pair(transforms) if isinstance(transforms, tuple) else _one(transforms)
    turns = matrices_from_rotations(rotations.reshape(-1, 4))
    return translations, turns.reshape(*rotations.shape[:-1], 3, 3)


def _floats(values: Any, wanted: str) -> Array:
    """Convert numbers to float64, with NaN where they are masked; not necessarily a copy."""
    try:
        numbers = np.asarray(values)
        if numbers.dtype.kind == "c":
            raise TypeError("complex numbers are not supported")
        floats = numbers.astype(np.float64, copy=False)
    except (TypeError, ValueError) as reason:
        raise TypeError(f"{wanted}: {reason}") from None
    mask = mask_of(values)
    return floats if mask is None else np.where(mask, np.nan, floats)


def _parts_of(msg: Any) -> tuple[Any, Any]:
    """
    The two fields of a transform or a pose, stamped or not, that are its translation and its rotation.

    :raises TypeError: it is neither.
    """
    inner = getattr(msg, "transform", getattr(msg, "pose", msg))
    if hasattr(inner, "translation"):
        return inner.translation, inner.rotation
    if hasattr(inner, "position"):
        return inner.position, inner.orientation
    raise TypeError(f"expected a TransformStamped, Transform, PoseStamped or Pose, got {type(msg).__name__}")


def _numbers_of(msg: Any) -> tuple[float, ...]:
    """The translation and the rotation, x y z x y z w, of a transform or a pose; see ``_parts_of``."""
    v, q = _parts_of(msg)
    return (v.x, v.y, v.z, q.x, q.y, q.z, q.w)


def _pair(transforms: tuple[Any, ...]) -> tuple[Array, Array]:
    if len(transforms) != 2:
        raise TypeError(f"expected a tuple (translations, rotations), got a tuple of {len(transforms)}")
    translations, rotations = (_floats(part, OF_ARRAYS) for part in transforms)
    if translations.shape[-1:] != (3,) or rotations.shape != (*translations.shape[:-1], 4):
        raise ValueError(
            "translations and rotations: expected the shapes (N, 3) and (N, 4), "
            f"got {translations.shape} and {rotations.shape}"
        )
    return translations, _unit(rotations)


def _unit(rotations: Array) -> Array:
    """Normalize quaternions; a row of NaN, which is a missing transform, remains NaN."""
    units = rotations.reshape(-1, 4).copy()
    bad = normalize(units, nan_missing=True)
    if bad >= 0:
        which = _which("rotations", "the rotation", rotations.shape[:-1], bad)
        given = rotations.reshape(-1, 4)[bad].tolist()
        raise ValueError(f"{which} must have a finite, non-zero length, got {given}")
    return units.reshape(rotations.shape)


def _which(many: str, one: str, shape: tuple[int, ...], flat: int) -> str:
    """Name one of many by its index, given as a flat index."""
    return f"{many}[{', '.join(str(i) for i in np.unravel_index(flat, shape))}]" if shape else one


def _matrices(values: npt.ArrayLike) -> Array:
    matrices = _floats(values, "matrix: expected numbers")
    if matrices.shape[-2:] != (4, 4):
        raise ValueError(f"matrix: expected the shape (4, 4), got {matrices.shape}")
    return matrices


def _translations_and_rotations(matrices: Array) -> tuple[Array, Array]:
    shape = matrices.shape[:-2]
    flat = matrices.reshape(-1, 16)
    is_missing = np.isnan(flat).all(axis=1)
    is_affine = np.isfinite(flat).all(axis=1) & (np.abs(flat[:, 12:] - (0, 0, 0, 1)) <= TOLERANCE).all(axis=1)
    bad = np.flatnonzero(~(is_affine | is_missing))
    if bad.size:
        which = _which("matrices", "matrix", shape, bad[0])
        numbers = " ".join(f"{number:g}" for number in flat[bad[0]])
        raise ValueError(f"{which}: expected finite numbers and the last row 0 0 0 1, got {numbers}")
    # Contiguous arrays of one element of each matrix, because NumPy is slow with many small matrices.
    turns = np.ascontiguousarray(flat.reshape(-1, 4, 4)[:, :3, :3].reshape(-1, 9).T)
    xx, xy, xz, yx, yy, yz, zx, zy, zz = turns
    with np.errstate(all="ignore"):  # huge numbers
        products = np.einsum("ikn,jkn->ijn", *[turns.reshape(3, 3, -1)] * 2) - np.eye(3)[..., None]
        defects = np.fmax.reduce(np.abs(products), axis=(0, 1))
        determinants = xx * (yy * zz - yz * zy) + xy * (yz * zx - yx * zz) + xz * (yx * zy - yy * zx)
    wrong = np.flatnonzero((defects > TOLERANCE) | (determinants < 0))
    if wrong.size:
        defect = defects[wrong[0]]
        reason = "must not be a reflection; its determinant is -1"
        if defect > TOLERANCE:
            reason = f"must be orthogonal; R R^T differs from the identity by {defect:.2g}"
            if defect < ROUNDED:
                svd = "u, _, vt = numpy.linalg.svd(m[..., :3, :3]); m[..., :3, :3] = u @ vt"
                reason += f". If its numbers are rounded: {svd}"
        which = _which("matrices", "matrix", shape, wrong[0])
        raise ValueError(f"{which}: its rotation {reason}")
    # S. W. Shepperd, Quaternion from Rotation Matrix, 1978: the quaternion times four times its greatest
    # part, which loses nothing to rounding.
    x, y, z = zy - yz, xz - zx, yx - xy
    a, b, c = xy + yx, xz + zx, yz + zy
    trace = xx + yy + zz
    rest = 1 - trace
    multiples = np.array(
        [(2 * xx + rest, a, b, x), (a, 2 * yy + rest, c, y), (b, c, 2 * zz + rest, z), (x, y, z, 1 + trace)]
    )
    greatest = np.einsum("iin->in", multiples).argmax(axis=0)
    rotations = multiples[greatest, :, np.arange(len(flat))]
    rotations[rotations[:, 3] < 0] *= -1
    normalize(rotations, nan_missing=True)
    return matrices[..., :3, 3].copy(), rotations.reshape(*shape, 4)


def _set_quaternion(message: Quaternion, rotation: Array) -> None:
    if np.isnan(rotation).any():
        raise ValueError("the rotation of a message: expected finite numbers, got NaN")
    message.x, message.y, message.z, message.w = (-rotation if rotation[3] < 0 else rotation).tolist()

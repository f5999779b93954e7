"""Owns the conversion between messages and NumPy: 4x4 matrices, and arrays of many transforms."""

from collections.abc import Iterable
from typing import Any, TypeVar, overload

import numpy as np
import numpy.typing as npt
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Transform, TransformStamped, Vector3

from tf2_py._internal import normalise

__all__ = ["from_matrix", "to_arrays", "to_matrix"]

Array = npt.NDArray[np.float64]

_Message = TypeVar("_Message", Transform, TransformStamped, Pose, PoseStamped)

# How far a matrix may differ from a rotation; a product of a few that were rounded to float32 differs less.
TOLERANCE = 1e-5


def to_matrix(msg: Any) -> Array:
    """
    Make the homogeneous matrix of a transform or a pose.

    :param msg: a ``TransformStamped``, ``Transform``, ``PoseStamped`` or ``Pose``, or an object with the
        fields of one.
    :return: shape (4, 4), float64: ``to_matrix(t) @ [x, y, z, 1]`` is the point (x, y, z), in metres,
        transformed by ``t``.
    :raises TypeError: another type.
    :raises ValueError: the rotation has no finite length above zero.
    """
    translations, rotations = to_arrays([msg])
    x, y, z, w = rotations[0]
    matrix = np.eye(4)
    # Of a unit quaternion; J. Diebel, Representing Attitude, 2006.
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = translations[0]
    return matrix


@overload
def from_matrix(matrix: npt.ArrayLike) -> Transform: ...


@overload
def from_matrix(matrix: npt.ArrayLike, message_class: type[_Message]) -> _Message: ...


def from_matrix(matrix: npt.ArrayLike, message_class: Any = Transform) -> Any:
    """
    Make a message of a homogeneous matrix.

    :param matrix: shape (4, 4): a rotation, a translation in metres, and the last row 0 0 0 1.
    :param message_class: ``Transform``, ``TransformStamped``, ``Pose`` or ``PoseStamped``, then with an
        empty header.
    :return: a new message; its quaternion has length one and w >= 0.
    :raises TypeError: another class, or no numbers.
    :raises ValueError: another shape, or a matrix that is no rigid transform.
    """
    if message_class not in (Transform, TransformStamped, Pose, PoseStamped):
        raise TypeError(f"a matrix can become a Transform or a Pose, stamped or not; not a {message_class}")
    translation, rotation = _translation_and_rotation(matrix)
    x, y, z = translation.tolist()
    quaternion = Quaternion(**dict(zip("xyzw", rotation.tolist(), strict=True)))
    if message_class in (Transform, TransformStamped):
        transform = Transform(translation=Vector3(x=x, y=y, z=z), rotation=quaternion)
        return transform if message_class is Transform else TransformStamped(transform=transform)
    pose = Pose(position=Point(x=x, y=y, z=z), orientation=quaternion)
    return pose if message_class is Pose else PoseStamped(pose=pose)


def to_arrays(msgs: Iterable[Any]) -> tuple[Array, Array]:
    """
    Make arrays of transforms or poses.

    :param msgs: N messages, each as for :func:`to_matrix`.
    :return: translations, shape (N, 3), metres; rotations, shape (N, 4), x y z w of length one; both float64,
        in the order in which ``scipy.spatial.transform.Rotation.from_quat`` takes them.
    :raises TypeError: another type.
    :raises ValueError: a rotation has no finite length above zero.
    """
    rows = [_row(msg) for msg in msgs]
    try:
        numbers = np.array(rows, dtype=np.float64).reshape(len(rows), 7)
    except ValueError as reason:
        raise TypeError(f"the fields of transforms and poses must be numbers: {reason}") from None
    rotations = numbers[:, 3:].copy()
    bad = normalise(rotations)
    if bad >= 0:
        raise ValueError(f"the rotation of message {bad} must have a finite length above zero")
    return numbers[:, :3].copy(), rotations


def _row(msg: Any) -> tuple[float, ...]:
    inner = getattr(msg, "transform", getattr(msg, "pose", msg))
    try:
        if hasattr(inner, "translation"):
            v, q = inner.translation, inner.rotation
        else:
            v, q = inner.position, inner.orientation
        return (v.x, v.y, v.z, q.x, q.y, q.z, q.w)
    except AttributeError as missing:
        wanted = "a TransformStamped, Transform, PoseStamped or Pose"
        raise TypeError(f"expected {wanted}, got {type(msg).__name__}: {missing}") from None


def _translation_and_rotation(matrix: npt.ArrayLike) -> tuple[Array, Array]:
    try:
        m = np.asarray(matrix, dtype=np.float64)
    except (TypeError, ValueError) as reason:
        raise TypeError(f"a matrix must be made of numbers: {reason}") from None
    if m.shape != (4, 4):
        raise ValueError(f"a matrix must have the shape (4, 4), not {m.shape}")
    if not np.isfinite(m).all():
        raise ValueError("a matrix must be finite")
    if not np.allclose(m[3], (0, 0, 0, 1), rtol=0, atol=TOLERANCE):
        raise ValueError(f"the last row of a matrix must be 0 0 0 1, not {m[3]}")
    r = m[:3, :3]
    error = np.abs(r @ r.T - np.eye(3)).max()
    if error > TOLERANCE:
        raise ValueError(f"the rotation of a matrix must be orthogonal; R R^T is off by {error:.2g}")
    if np.linalg.det(r) < 0:
        raise ValueError("the rotation of a matrix must not be a reflection; its determinant is -1")
    return m[:3, 3], _quaternion(r)


def _quaternion(r: Array) -> Array:
    # S. W. Shepperd, Quaternion from Rotation Matrix, 1978: each row below is the quaternion x y z w times
    # four times one of its parts; the row of the greatest part loses nothing to rounding.
    trace = np.trace(r)
    products = np.array(
        [
            [1 + 2 * r[0, 0] - trace, r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], 1 + 2 * r[1, 1] - trace, r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 + 2 * r[2, 2] - trace, r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + trace],
        ]
    )
    q = products[np.argmax(products.diagonal())]
    q /= np.linalg.norm(q)
    return -q if q[3] < 0 else q

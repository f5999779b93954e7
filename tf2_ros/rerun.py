"""Owns handing a buffer's frames and their motion to rerun, which draws them; needs no ROS."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore
from tf2_py._internal import History, as_times_ns, histories
from tf2_ros._recordings.problems import needing
from tf2_ros._recordings.tables import look_up, times_at_rate
from tf2_ros._traffic.chains import path_to_root
from tf2_ros._whole_files import write_whole

if TYPE_CHECKING:
    from rerun import RecordingStream

    from tf2_py.typing import TimesLike

__all__ = ["ViewerError", "log", "save", "view"]

APPLICATION = "tf2_ros"
TIMELINE = "stamp"
ROOT = "tf"
AXES_M = 0.3


class ViewerError(RuntimeError):
    """The viewer of rerun did not open; the text says why, in one line."""


def log(
    buffer: BufferCore,
    recording: RecordingStream | None = None,
    *,
    root: str = ROOT,
    origin: str | None = None,
    frames: Iterable[str] | None = None,
    times: TimesLike | None = None,
    rate: float | None = None,
    axes: float = AXES_M,
) -> None:
    """
    Put the frames of a buffer, and how they moved, into a recording of rerun.

    Each frame becomes the entity ``<root>/<frame>``: a ``Transform3D`` between frames of the same names, its
    axes and its name. What a program logs with ``rerun.CoordinateFrame("camera")`` appears where that frame
    is. Unless ``times`` or ``rate`` is given, these are the samples of the buffer as they were inserted, each
    below the parent that it names. Between two samples rerun shows the earlier one, where a lookup
    interpolates. Static transforms are static in rerun, too.

    :param recording: by default the current one, for example that of ``rerun.init``.
    :param root: the path of the entity above all of these.
    :param origin: what stands still in a view of ``root``; by default the root of the largest tree.
    :param frames: the names of those to show, by default all. The frames above them are logged without axes.
    :param times: as of ``Buffer.lookup_transforms``, shape (N,). In the place of its samples, the transforms
        of each moving frame in its newest parent at these times are logged, where there is an answer.
    :param rate: the same in Hz, over the time of all samples.
    :param axes: their length in metres.
    :raises LookupException: the buffer has no frame ``origin``, or none of ``frames``.
    :raises ValueError: both ``times`` and ``rate``, or a rate that is not above 0.
    :raises ModuleNotFoundError: rerun is not installed.

    The timeline is named ``stamp``, its times are the stamps in nanoseconds since 1970. Rerun keeps numbers
    as float32.
    """
    rr = _rerun()
    if times is not None and rate is not None:
        raise ValueError("use either times or rate")
    tree = buffer.frames()
    if not tree:
        return
    if origin is None:
        tops = Counter(path_to_root(tree, name)[-1] for name in sorted(tree))
        [(origin, _)] = tops.most_common(1)
    shown = set(tree if frames is None else frames)
    for name in (origin, *sorted(shown)):
        if name not in buffer:
            buffer.lookup_transform_core(name, next(iter(tree)), 0)  # raises what is wrong with it
    times_ns = None if times is None else as_times_ns(times)
    if rate is not None:
        times_ns = times_at_rate(buffer, origin, origin, rate)
    samples = {one.frame: one for one in histories(BufferCore.__getstate__(buffer))}
    where: dict[str, Any] = {"recording": recording, "strict": True}

    rr.log(root, rr.CoordinateFrame(origin), static=True, **where)
    for name in sorted(shown | _above(samples, shown)):
        path = f"{root}/{rr.escape_entity_path_part(name)}"
        if name in shown:
            its_axes = rr.TransformAxes3D(axes, show_frame=True)
            rr.log(path, rr.CoordinateFrame(name), its_axes, static=True, **where)
        history = samples.get(name)
        if history is not None:
            if times_ns is not None and not history.static:
                history = _at(buffer, history, times_ns)
            _log_motion(rr, path, history, where)


def save(buffer: BufferCore, path: str | os.PathLike[str], **how: Any) -> None:
    """
    Write a buffer as a recording of rerun; ``rerun FILE.rrd`` opens it.

    :param how: what :func:`log` takes beside the recording, for example ``rate=30``.
    :raises OSError: the file cannot be written; what was there before stays. As :func:`log` besides.
    """
    recording = _rerun().RecordingStream(APPLICATION)
    stream = recording.binary_stream()
    log(buffer, recording, **how)
    write_whole(path, stream.read() or b"")


def view(buffer: BufferCore, **how: Any) -> None:
    """
    Show a buffer in the viewer of rerun, until it is closed.

    :param how: what :func:`log` takes beside the recording.
    :raises ViewerError: the viewer did not open, for example without a screen; :func:`save` needs none. As
        :func:`log` besides.
    """
    with tempfile.TemporaryDirectory(prefix="tf2-ros-cython-") as folder:
        path = os.path.join(folder, f"{APPLICATION}.rrd")
        save(buffer, path, **how)
        # Not by rerun.spawn: it looks for the program in PATH alone, where that of a virtual environment may
        # not be, and its viewer listens on all networks.
        command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", path]
        ended = subprocess.run(command, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    # Some versions end with 0 in any case.
    errors = [line for line in ended.stderr.splitlines() if line.startswith("Error: ")]
    if errors or ended.returncode:
        why = errors[-1].removeprefix("Error: ") if errors else f"it ended with {ended.returncode}"
        raise ViewerError(f"the viewer of rerun did not open: {why}")


def _rerun() -> Any:
    with needing("rerun", "rerun"):
        import rerun
    return rerun


def _log_motion(rr: Any, path: str, history: History, where: Mapping[str, Any]) -> None:
    count = len(history.stamps_ns)
    columns = {
        "translation": history.translations,
        "quaternion": history.rotations,
        "child_frame": [history.frame] * count,
        "parent_frame": history.parents.tolist(),
    }
    if history.static:
        only = {name: column[0] for name, column in columns.items()}
        rr.log(path, rr.Transform3D(**only), static=True, **where)
    elif count:
        stamps = rr.TimeColumn(TIMELINE, timestamp=history.stamps_ns.view("datetime64[ns]"))
        rr.send_columns(path, [stamps], rr.Transform3D.columns(**columns), **where)


def _above(samples: Mapping[str, History], frames: set[str]) -> set[str]:
    """All frames that were ever above these."""
    above: set[str] = set()
    waiting = list(frames)
    while waiting:
        history = samples.get(waiting.pop())
        if history is not None:
            new = set(history.parents) - above
            above |= new
            waiting += new
    return above


def _at(buffer: BufferCore, history: History, times_ns: NDArray[np.int64]) -> History:
    """The same frame at other times, in its newest parent."""
    parent = history.parents[-1]
    table = look_up(buffer, parent, history.frame, times_ns)
    valid = table.valid
    return history._replace(
        parents=np.full(np.count_nonzero(valid), parent, object),
        stamps_ns=table.stamps_ns[valid],
        translations=table.translations[valid],
        rotations=table.rotations[valid],
    )

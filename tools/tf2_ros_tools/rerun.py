"""Show the frames of a buffer and their motion in rerun, recorded or live, without ROS."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, History, TransformException
from tf2_ros_tools.optional_libraries import require
from tf2_ros_tools.output import write_whole
from tf2_ros_tools.pose_tables import look_up
from tf2_ros_tools.stream_statistics import moving_on, path_to_root

if TYPE_CHECKING:
    from rerun import RecordingStream

__all__ = ["ViewerError", "log", "save", "view"]

APPLICATION = "tf2_ros"
TIMELINE = "stamp"
ROOT = "tf"
SAMPLES = "tf_samples"  # the entity of all moving transforms: an entity for each frame takes 30 times as long
AXES_M = 0.3


class ViewerError(RuntimeError):
    """The viewer of rerun did not open; the text says why, on one line."""


def log(
    buffer: BufferCore,
    recording: RecordingStream | None = None,
    *,
    origin: str | None = None,
    axes: float = AXES_M,
) -> None:
    """
    Log the frames of a buffer and their motion to a recording of rerun.

    Each frame becomes the entity ``tf/<frame>`` with its axes and its name, and what a program logs with
    ``rerun.CoordinateFrame("camera")`` moves with that frame. All samples of the buffer are logged, each
    relative to its own parent. Between two samples, rerun shows the earlier one, whereas a lookup
    interpolates. Static transforms are static in rerun, too.

    :param buffer: the frames and samples.
    :param recording: None: the current recording of rerun, for example from ``rerun.init``.
    :param origin: the frame that does not move; by default the root of the largest tree.
    :param axes: the length of the axes in meters.
    :raises LookupException: the buffer does not know ``origin``.
    :raises ModuleNotFoundError: rerun is not installed.

    The timeline is named ``stamp``; its times are the stamps in nanoseconds since 1970. Rerun stores numbers
    as float32.
    """
    rr = _rerun()
    tree, samples = buffer.frames(), buffer.histories()
    if not tree:
        return
    if origin is None:
        origin = _top_of(tree)
    elif origin not in buffer:
        buffer.lookup_transform_core(origin, next(iter(tree)), 0)  # raises what is wrong with it
    where: dict[str, Any] = {"recording": recording, "strict": True}
    rr.log(ROOT, rr.CoordinateFrame(origin), static=True, **where)
    for name in sorted(tree):
        _log_axes(rr, name, axes, where)
    for one in samples.values():
        if one.static:
            _log_static(rr, one, where)
    _log_moving(rr, [one for one in samples.values() if not one.static], where)


def save(buffer: BufferCore, path: str | os.PathLike[str], **how: Any) -> None:
    """
    Write a buffer to a recording of rerun, which ``rerun FILE.rrd`` opens.

    :param buffer: the frames and samples.
    :param path: the file, usually with the ending ``.rrd``.
    :param how: further arguments of :func:`log`, for example ``axes=0.1``.
    :raises OSError: the file cannot be written; an existing file remains unchanged.

    Also raises the errors of :func:`log`.
    """
    recording = _rerun().RecordingStream(APPLICATION)
    stream = recording.binary_stream()
    log(buffer, recording, **how)
    write_whole(path, stream.read() or b"")


def view(buffer: BufferCore, **how: Any) -> None:
    """
    Show a buffer in the viewer of rerun until the viewer is closed.

    :param buffer: the frames and samples.
    :param how: further arguments of :func:`log`.
    :raises ViewerError: the viewer did not open, for example without a screen, which :func:`save` does not
        need.

    Also raises the errors of :func:`log`.
    """
    with tempfile.TemporaryDirectory(prefix="tf2-ros-cython-") as folder:
        path = os.path.join(folder, f"{APPLICATION}.rrd")
        save(buffer, path, **how)
        ended = subprocess.run([*VIEWER, path], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    _check_ended(ended.returncode, ended.stderr)


# A running robot.


TRAILS = "trails"
TRAIL_S = 10.0
TRAIL_RADIUS = -1.5  # negative: in pixels, not meters
TRAIL_COLOR = 0xE69F00FF  # red, green, blue, opacity
OPENING_S = 0.05  # between two checks whether the viewer has opened
MEMORY = "1GB"  # the limit of the viewer, above which it drops the oldest data


class Live:
    """
    Sends the frames of a buffer to a recording of rerun, ``recording``, while they move.

    :param buffer: must keep each sample at least until the next call of :meth:`send`.
    :param origin: the frame that does not move; by default the root of the largest tree.
    :param trails: the frames whose paths over the last TRAIL_S seconds are drawn.
    :param axes: the length of the axes in meters.
    """

    def __init__(
        self,
        buffer: BufferCore,
        *,
        origin: str | None = None,
        trails: Iterable[str] = (),
        axes: float = AXES_M,
    ) -> None:
        self._rr = _rerun()
        self._buffer = buffer
        self.recording: RecordingStream = self._rr.RecordingStream(APPLICATION)
        self._where: dict[str, Any] = {"recording": self.recording, "strict": True}
        self._origin = origin
        self._axes = axes
        self._top: str | None = None  # what was last logged as the origin
        self._frames: set[str] = set()  # that have axes
        self._static: dict[str, bytes] = {}  # what was last logged of each
        self._sent_ns: dict[str, int] = {}  # of each moving frame, its newest stamp
        # Up to which stamp each was sent, and its last point, shape (1, 3).
        self._trails: dict[str, tuple[int, NDArray[np.float64] | None]] = dict.fromkeys(trails, (0, None))

    def send(self) -> None:
        """Send what was inserted since the last call; if the clock jumped back, continue at the new time."""
        tree, samples = self._buffer.frames(), self._buffer.histories()
        if not tree:
            return
        self._send_frames(tree)
        moving = [one for one in samples.values() if not one.static and len(one.stamps_ns)]
        self._send_static([one for one in samples.values() if one.static])
        _log_moving(self._rr, [_since(one, self._sent_ns) for one in moving], self._where)
        for name in self._trails:
            if name in tree:
                self._send_trail(name, tree, samples)

    def _send_frames(self, tree: Mapping[str, Any]) -> None:
        rr = self._rr
        top = self._origin or _top_of(tree)
        if top != self._top:
            self._top = top
            self._trails = dict.fromkeys(self._trails, (0, None))
            for path in (ROOT, *map(self._trail_path, self._trails)):
                rr.log(path, rr.CoordinateFrame(top), static=True, **self._where)
            self._send_view()
        for name in sorted(tree.keys() - self._frames):
            _log_axes(rr, name, self._axes, self._where)
            self._frames.add(name)

    def _send_static(self, histories: Iterable[History]) -> None:
        for one in histories:
            said = b"".join((one.parents[0].encode(), one.translations.tobytes(), one.rotations.tobytes()))
            if self._static.get(one.frame) != said:
                self._static[one.frame] = said
                _log_static(self._rr, one, self._where)

    def _send_trail(self, name: str, tree: Mapping[str, Any], samples: Mapping[str, History]) -> None:
        top = self._top or name
        stamps: list[NDArray[np.int64]] = []
        with suppress(TransformException):  # not connected yet
            stamps = [samples[one].stamps_ns for one in moving_on(tree, self._buffer.path(top, name))]
        if not stamps:
            return
        stamps_ns = np.unique(np.concatenate(stamps))
        if len(stamps_ns) and stamps_ns[-1] < self._trails[name][0]:  # the clock jumped back
            self._trails[name] = 0, None
        last_ns, last = self._trails[name]
        times = stamps_ns[stamps_ns > last_ns]
        points = look_up(self._buffer, top, name, times)[:, :3]
        valid = ~np.isnan(points[:, 0])
        points, times = points[valid], times[valid]
        if not len(times):
            return  # nothing is new, or a frame has no sample yet; the next call tries again
        self._trails[name] = int(times[-1]), points[-1:]
        strips = np.stack(
            [np.concatenate([points[:1] if last is None else last, points[:-1]]), points], axis=1
        )
        rr = self._rr
        look = {
            "radii": np.full(len(strips), TRAIL_RADIUS),
            "colors": np.full(len(strips), TRAIL_COLOR, np.uint32),
        }
        columns = rr.LineStrips3D.columns(strips=strips, **look)
        rr.send_columns(self._trail_path(name), [_times(rr, times)], columns, **self._where)

    def _send_view(self) -> None:
        """Choose what the viewer shows: only the last part of trails, relative to the current origin."""
        import rerun.blueprint as rrb

        recent = rrb.VisibleTimeRange(
            TIMELINE,
            start=rrb.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
            end=rrb.TimeRangeBoundary.cursor_relative(),
        )
        shown = [self._trail_path(name) for name in self._trails]
        overrides: Any = {path: rrb.VisibleTimeRanges([recent]) for path in shown}
        contents = ["/**", f"- /{TRAILS}/**", *(f"+ /{path}" for path in shown)]
        view = rrb.Spatial3DView(origin=ROOT, contents=contents, overrides=overrides)
        time_panel = rrb.TimePanel(state="expanded", timeline=TIMELINE)
        self.recording.send_blueprint(rrb.Blueprint(view, time_panel, collapse_panels=True))

    def _trail_path(self, name: str) -> str:
        # Each origin has its own trails.
        return "/".join((TRAILS, *map(self._rr.escape_entity_path_part, (self._top or "", name))))


@contextmanager
def open_viewer(
    recording: RecordingStream, *, web: bool
) -> Iterator[tuple[subprocess.Popen[bytes], str | None]]:
    """
    Open the viewer of rerun for a ``with`` statement, which gets its process and its page for a browser.

    The viewer is closed at the end.

    :param recording: what the viewer shows.
    :param web: serve it to browsers on this machine.
    :raises ViewerError: at the end, if the viewer did not open.
    """
    port, page_port = _free_ports(2)
    ports = [port, page_port] if web else [port]
    options = [f"--port={port}", f"--memory-limit={MEMORY}", f"--server-memory-limit={MEMORY}"]
    if web:
        options += ["--serve-web", f"--web-viewer-port={page_port}"]
    address = f"rerun+http://127.0.0.1:{port}/proxy"
    page = f"http://127.0.0.1:{page_port}?url={address.replace('+', '%2B')}" if web else None
    with tempfile.TemporaryFile() as said, ExitStack() as stack:
        # In a separate process group, because the started process runs the viewer as its child.
        process = subprocess.Popen(
            [*VIEWER, *options], stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True
        )
        stack.callback(_end, process)
        # A recording that cannot connect would keep the program from exiting.
        while process.poll() is None and not all(map(_accepts, ports)):
            time.sleep(OPENING_S)
        if process.poll() is None:
            recording.connect_grpc(address)
            stack.callback(recording.disconnect)
        yield process, page
        if process.poll() is not None:
            said.seek(0)
            _check_ended(process.returncode, said.read().decode(errors="replace"))


def _accepts(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def _end(process: subprocess.Popen[bytes]) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGTERM)
    process.wait()


def _free_ports(count: int) -> list[int]:
    with ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]


# Shared by recordings and live views.


# Not rerun.spawn, because it searches only PATH, which may lack the programs of a virtual environment, and
# because its viewer listens on all network interfaces.
VIEWER = (sys.executable, "-m", "rerun", "--bind", "127.0.0.1")


def _check_ended(status: int, said: str) -> None:
    # Some versions always exit with 0.
    errors = [line for line in said.splitlines() if line.startswith("Error: ")]
    if errors or status:
        why = errors[-1].removeprefix("Error: ") if errors else f"it ended with {status}"
        if "EventLoopError" in why:  # of winit, which opens windows; a place in its source code follows
            why = f"there is no screen ({why.rpartition(': ')[2].rstrip('.')})"
        raise ViewerError(f"the viewer of rerun did not open: {why}")


def _rerun() -> Any:
    require("rerun", "rerun")
    import rerun

    return rerun


def _path_of(rr: Any, frame: str) -> str:
    return f"{ROOT}/{rr.escape_entity_path_part(frame)}"


def _top_of(tree: Mapping[str, Any]) -> str:
    """Get the root of the largest tree."""
    tops = Counter(path_to_root(tree, name)[-1] for name in sorted(tree))
    return tops.most_common(1)[0][0]


def _times(rr: Any, stamps_ns: NDArray[np.int64]) -> Any:
    return rr.TimeColumn(TIMELINE, timestamp=stamps_ns.view("datetime64[ns]"))


def _since(history: History, sent_ns: dict[str, int]) -> History:
    """Get the samples that are newer than what was sent."""
    newest_ns = int(history.stamps_ns[-1])
    last_ns = sent_ns.get(history.frame, -1)
    sent_ns[history.frame] = newest_ns
    if newest_ns < last_ns:
        return history  # the clock jumped back
    new = slice(int(np.searchsorted(history.stamps_ns, last_ns, "right")), None)
    columns = ("parents", "stamps_ns", "translations", "rotations")
    return history._replace(**{name: getattr(history, name)[new] for name in columns})


def _log_axes(rr: Any, frame: str, axes: float, where: Mapping[str, Any]) -> None:
    """Place the entity of a frame in the frame, and draw its axes and name there."""
    its_axes = rr.TransformAxes3D(axes, show_frame=True)
    rr.log(_path_of(rr, frame), rr.CoordinateFrame(frame), its_axes, static=True, **where)


def _log_static(rr: Any, history: History, where: Mapping[str, Any]) -> None:
    transform = rr.Transform3D(
        translation=history.translations[0],
        quaternion=history.rotations[0],
        child_frame=history.frame,
        parent_frame=history.parents[0],
    )
    rr.log(_path_of(rr, history.frame), transform, static=True, **where)


def _log_moving(rr: Any, histories: list[History], where: Mapping[str, Any]) -> None:
    """Log samples in the order of their stamps."""
    stamps = np.concatenate([one.stamps_ns for one in histories] or [np.zeros(0, np.int64)])
    if not len(stamps):
        return
    order = np.argsort(stamps, kind="stable")
    frames = np.concatenate([np.full(len(one.stamps_ns), one.frame, object) for one in histories])
    columns = rr.Transform3D.columns(
        translation=np.concatenate([one.translations for one in histories])[order],
        quaternion=np.concatenate([one.rotations for one in histories])[order],
        child_frame=frames[order].tolist(),
        parent_frame=np.concatenate([one.parents for one in histories])[order].tolist(),
    )
    rr.send_columns(SAMPLES, [_times(rr, stamps[order])], columns, **where)

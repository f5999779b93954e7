# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Draws the pictures in docs/images and tools/docs/images: `make pictures`, in two minutes.

Most are what a program draws, or shows on a terminal, while a robot drives: the robot of examples/demo.py,
that of docs/getting-started.md, or that with faults, of faulty_robot.py. One is drawn from the recording
`slam` of docs/samples. Two others are drawn by programs in docs: the bar chart of lookups, from the results
of `make bench`, and the path of a transform.
"""

import contextlib
import itertools
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pexpect
import pyte
from rich._export_format import CONSOLE_SVG_FORMAT
from rich.color import Color
from rich.console import Console
from rich.style import Style
from rich.text import Text

TOOLS = Path(__file__).resolve().parent.parent
ROOT = TOOLS.parent
DEMO = ROOT / "examples" / "demo.py"
ROBOT = [sys.executable, DEMO, "broadcast"]  # ends by itself after 18 s
FAULTS = [sys.executable, TOOLS / "docs" / "faulty_robot.py"]
IMAGES = TOOLS / "docs" / "images"
GETTING_STARTED = ROOT / "docs" / "getting-started.md"
# What draws each picture: a command that is on the page before it. A test compares them.
PICTURES = {
    "demo-tree.svg": "view_frames -o robot.svg",
    "faults-tree.svg": "view_frames -o robot.svg",
    "getting-started-tree.svg": "view_frames -o robot.svg",
    "demo-path.png": "tf2_plot --path map camera -t 8 -o path.png",
    "demo-heard.png": "tf2_plot -t 8 -o received.png",
    "corrected-path.png": (
        "tf2_bag plot slam --path map base_link --trajectory /slam/path map odom base_link -o path.png"
    ),
    "demo-monitor.svg": "tf2_monitor map camera",
    "faults-monitor-tree.svg": "tf2_monitor",
}
sys.path[:0] = [str(DEMO.parent), str(ROOT / "docs")]

import data_path_figure  # noqa: E402
import performance_from_results  # noqa: E402

import demo  # noqa: E402

COLUMNS = 80
# The fonts of the reader: a picture in the docs asks no other host for any.
WITHOUT_FONTS = re.sub(r"@font-face \{\{.*?\}\}\s*", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)


def main() -> None:
    performance_from_results.draw(ROOT / "docs" / "images" / "speed.svg")
    data_path_figure.draw()
    domain, _claim = demo.claim_domain()
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    os.environ.pop("ROS_LOCALHOST_ONLY", None)
    draw(IMAGES / "demo-tree.svg")
    draw(IMAGES / "faults-tree.svg", robot=FAULTS)
    draw(ROOT / "docs" / "images" / "getting-started-tree.svg", robot=first_robot())
    draw(IMAGES / "demo-path.png", stopped=True)
    draw(IMAGES / "demo-heard.png", stopped=True)
    draw_recorded(IMAGES / "corrected-path.png")
    show_monitor(IMAGES / "demo-monitor.svg", rows=16)
    show_monitor(IMAGES / "faults-monitor-tree.svg", rows=34, keys="e", robot=FAULTS)


def first_robot() -> list[str]:
    """The program of the page for beginners."""
    [code] = re.findall(
        r"```python\n(# robot\.py\n.*?)```", GETTING_STARTED.read_text(encoding="utf-8"), re.DOTALL
    )
    return [sys.executable, "-c", code]


def draw(picture: Path, *, stopped: bool = False, robot: Sequence[str | Path] = ROBOT) -> None:
    """Let the command of a picture draw it; ``stopped``: the robot stands still for a second of it."""
    program, *arguments, file = shlex.split(PICTURES[picture.name])

    def run(process: subprocess.Popen) -> None:
        with tempfile.TemporaryDirectory() as folder:  # view_frames writes the input of Graphviz beside it
            command = [*_command(program), *arguments, Path(folder) / file]
            drawing = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
            for line in drawing.stderr:  # on a busy machine, it takes seconds to begin
                for after_s, number in ((4.0, signal.SIGSTOP), (5.0, signal.SIGCONT)):
                    if stopped and "Listening" in line:
                        threading.Timer(after_s, process.send_signal, [number]).start()
            if drawing.wait() != 0:
                raise SystemExit(f"{shlex.join(map(str, command))} failed")
            shutil.copy(Path(folder) / file, picture)

    with_robot(run, robot)


def show_monitor(picture: Path, *, rows: int, keys: str = "", robot: Sequence[str | Path] = ROBOT) -> None:
    """Draw what tf2_monitor shows on a terminal some seconds after keys were pressed."""
    with_robot(lambda _: _show_monitor(picture, rows, keys), robot)


def _show_monitor(picture: Path, rows: int, keys: str) -> None:
    screen = pyte.Screen(COLUMNS, rows)
    stream = pyte.Stream(screen)
    program, *frames = shlex.split(PICTURES[picture.name])
    [python, *arguments] = _command(program)
    monitor = pexpect.spawn(
        python,
        [*arguments, *frames],
        dimensions=(rows, COLUMNS),
        env={**os.environ, "TERM": "xterm-256color", "COLORTERM": "truecolor"},
        encoding="utf-8",
    )
    try:
        for pressed in ("", keys):
            monitor.send(pressed)
            end = time.monotonic() + 4.0
            while time.monotonic() < end:
                with contextlib.suppress(pexpect.TIMEOUT):
                    stream.feed(monitor.read_nonblocking(65536, timeout=0.1))
    finally:
        monitor.terminate(force=True)
    console = Console(record=True, width=COLUMNS, file=open(os.devnull, "w"), color_system="truecolor")
    for number in range(rows):
        console.print(_line(screen, number))
    console.save_svg(str(picture), title=PICTURES[picture.name], code_format=WITHOUT_FONTS)


def draw_recorded(picture: Path) -> None:
    """Let the command of a picture draw it from a sample."""
    program, *arguments, file = shlex.split(PICTURES[picture.name])
    with tempfile.TemporaryDirectory() as folder:
        command = [*_command(program), *arguments, Path(folder) / file]
        subprocess.run(command, cwd=TOOLS / "docs" / "samples", check=True)
        shutil.copy(Path(folder) / file, picture)


def with_robot(run: Callable[[subprocess.Popen], None], robot: Sequence[str | Path] = ROBOT) -> None:
    process = subprocess.Popen(robot)
    try:
        run(process)
    finally:
        process.send_signal(signal.SIGCONT)
        demo.end(process)


def _command(program: str) -> list[str]:
    return [sys.executable, "-m", f"tf2_ros_tools.programs.{program}"]


def _line(screen: pyte.Screen, number: int) -> Text:
    cells = [screen.buffer[number][column] for column in range(COLUMNS)]
    line = Text()
    for (foreground, background, bold), run in itertools.groupby(
        cells, lambda one: (one.fg, one.bg, one.bold)
    ):
        style = Style(color=_color(foreground), bgcolor=_color(background), bold=bold)
        line.append("".join(cell.data for cell in run), style)
    return line


def _color(name: str) -> Color | None:
    if name == "default":
        return None
    return Color.parse(f"#{name}" if re.fullmatch("[0-9a-f]{6}", name) else name.replace("brown", "yellow"))


if __name__ == "__main__":
    main()

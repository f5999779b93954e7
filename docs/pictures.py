"""Draws the pictures in docs/images of the robot of examples/demo.py: `make pictures`, in a minute.

Each is what a program draws, or shows on a terminal, while that robot drives.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

import pexpect
import pyte
from rich._export_format import CONSOLE_SVG_FORMAT
from rich.color import Color
from rich.console import Console
from rich.style import Style
from rich.text import Text

ROOT = Path(__file__).resolve().parent.parent
DEMO = ROOT / "examples" / "demo.py"
IMAGES = ROOT / "docs" / "images"
sys.path.insert(0, str(DEMO.parent))

import demo  # noqa: E402

COLUMNS, ROWS = 86, 12
# The fonts of the reader: a picture in the docs asks no other host for any.
WITHOUT_FONTS = re.sub(r"@font-face \{\{.*?\}\}\s*", "", CONSOLE_SVG_FORMAT, flags=re.DOTALL)


def main() -> None:
    domain, _lock = demo.claim_domain()
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    os.environ.pop("ROS_LOCALHOST_ONLY", None)
    draw("demo-tree.svg", "view_frames", "-o")
    draw("demo-path.png", "tf2_plot", "--path", "map", "camera", "-t", "8", "-o")
    draw("demo-heard.png", "tf2_plot", "-t", "8", "-o", stopped=True)
    with_robot(show_monitor)


def draw(name: str, program: str, *arguments: str, stopped: bool = False) -> None:
    """Let a program draw a picture; ``stopped``: the robot's program stands still for a second of it."""

    def run(robot: subprocess.Popen) -> None:
        pauses = [
            threading.Timer(5.0, robot.send_signal, [signal.SIGSTOP]),
            threading.Timer(6.0, robot.send_signal, [signal.SIGCONT]),
        ]
        for pause in pauses if stopped else ():
            pause.start()
        with tempfile.TemporaryDirectory() as folder:  # view_frames writes the input of Graphviz beside it
            subprocess.run([*_command(program), *arguments, Path(folder) / name], check=True)
            shutil.copy(Path(folder) / name, IMAGES)

    with_robot(run)


def show_monitor(_robot: subprocess.Popen) -> None:
    """What tf2_monitor shows on a terminal after some seconds."""
    screen = pyte.Screen(COLUMNS, ROWS)
    stream = pyte.Stream(screen)
    [python, *arguments] = _command("tf2_monitor")
    monitor = pexpect.spawn(
        python,
        [*arguments, "map", "camera"],
        dimensions=(ROWS, COLUMNS),
        env={**os.environ, "TERM": "xterm-256color"},
        encoding="utf-8",
    )
    try:
        for _report in range(6):
            monitor.expect("┘")  # below the table, to the right
            stream.feed(monitor.before + monitor.after)
    finally:
        monitor.terminate(force=True)
    console = Console(record=True, width=COLUMNS, file=open(os.devnull, "w"), color_system="truecolor")
    used = [number for number, line in enumerate(screen.display) if line.strip()]
    for number in range(used[-1] + 1):
        console.print(_line(screen, number))
    console.save_svg(
        str(IMAGES / "demo-monitor.svg"), title="tf2_monitor map camera", code_format=WITHOUT_FONTS
    )


def with_robot(run: Callable[[subprocess.Popen], None]) -> None:
    robot = subprocess.Popen([sys.executable, DEMO, "broadcast"])  # ends by itself after 18 s
    try:
        run(robot)
    finally:
        robot.send_signal(signal.SIGCONT)
        demo.end(robot)


def _command(program: str) -> list[str]:
    return [sys.executable, "-m", f"tf2_ros.cli.{program}"]


def _line(screen: pyte.Screen, number: int) -> Text:
    line = Text()
    for column in range(COLUMNS):
        cell = screen.buffer[number][column]
        line.append(cell.data, Style(color=_color(cell.fg), bold=cell.bold, italic=cell.italics))
    return line


def _color(name: str) -> Color | None:
    if name == "default":
        return None
    return Color.parse(f"#{name}" if re.fullmatch("[0-9a-f]{6}", name) else name.replace("brown", "yellow"))


if __name__ == "__main__":
    main()

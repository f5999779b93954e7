# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of pictures draw: streams, and names that are hard to draw; and how files then begin."""

from tf2_ros_tools.diagnosis.stream_statistics import Stream

STARTS = {"svg": b"<?xml", "png": b"\x89PNG\r\n\x1a\n", "pdf": b"%PDF-"}
# What means something to Graphviz, to SVG, or to a terminal.
HOSTILE = [
    "a:b",
    "<b>bold</b>",
    'say "hi"',
    "back\\slash\\n\\G",
    "&amp;",
    "]; evil [",
    "subgraph",
    "$a$",
    "中文",
]


def stream(frame, parent="map", publisher="/robot", static=False, **figures):
    timed = {} if static else {"rate": 50.0, "delay": 0.001, "delay_max": 0.004, "period": 0.02}
    figures = {
        **dict.fromkeys(("rate", "delay", "delay_max", "delay_min", "jitter", "period")),
        "publisher_id": 0,
        "count": 9,
        "gap": 0.02,
        "first": 3.0,
        "silence": 0.01,
        "stalled": 0.01,
        **timed,
        **figures,
    }
    return Stream(frame=frame, parent=parent, publisher=publisher, static=static, **figures)

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read the texts of pictures in SVG."""

from pathlib import Path
from xml.etree import ElementTree

from tf2_ros_tools.pictures.style import file_of

SVG = "{http://www.w3.org/2000/svg}"


def groups(svg, kind):
    """The texts of the parts of one class, each as a list of lines."""
    return [
        [text.text for text in group.iter(f"{SVG}text") if text.text.strip()]
        for group in ElementTree.fromstring(svg).iter(f"{SVG}g")
        if kind in group.get("class", "").split()
    ]


def texts_of(drawn):
    """The texts of a figure, or of a file of SVG."""
    root = ElementTree.fromstring(drawn.read_bytes() if isinstance(drawn, Path) else file_of(drawn, "svg"))
    return ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]

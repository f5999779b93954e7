# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Spans of time as texts; and files that are written as a whole, into links and pipes."""

import os

import pytest

from tf2_ros_tools.common.output import span, write_whole


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0123456, "0.0123 s"),
        (2.5, "2.5 s"),
        (86399.0, "86399 s"),
        (86400.0, "1 day"),
        (-3.5 * 86400, "-3.5 days"),
        (365 * 86400.0, "365 days"),
        (1_699_999_999.043, "53.9 years"),
    ],
)
def test_a_span_of_a_day_or_more_is_in_days_or_years(seconds, text):
    assert span(seconds) == text


def test_a_link_stays_one(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "file")
    write_whole(str(tmp_path / "link"), b"text")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == b"text"


def test_a_pipe_is_written_to_and_stays_one(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(str(pipe), b"text")
        assert os.read(reader, 100) == b"text"
    finally:
        os.close(reader)
    assert [*tmp_path.iterdir()] == [pipe] and pipe.is_fifo()

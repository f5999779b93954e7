# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write docs/development/feature-inventory.md: what each feature promises, to whom, and how much serves it.

`python -m release.feature_inventory`; it fails if a file belongs to no feature.
"""

import fnmatch
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/development/feature-inventory.md"
CODE = (".py", ".pyx", ".pxd", ".pxi", ".c", ".h", ".cpp")

# Each feature, what it promises, to whom; below it the files that only it needs, and last, those that several
# share. A file belongs to the first feature with a pattern for it; `*` also matches `/`.
TABLE = """
deskew | users of lidars: each point of a cloud at its own time
    *deskew* *time_field* *point_field_numbers* *avx2* *piecewise_linear*
clouds, IMU, magnetometer | users of tf2_sensor_msgs: its functions, for every layout of a cloud
    tf2_sensor_msgs/* *cloud* tests/core/test_tf2_sensor_msgs.py
rewriting the past | users of SLAM and of filters: new samples replace old ones at once
    *replacing* *rewriting* *correction* *trajector*
explained lookups | whoever doubts a pose: its hops, with their samples, gaps, ages and publishers
    tf2_py/*/explained* */explanations.py tests/core/test_explain*
frozen files | trainers on many processes: one copy of a recording's transforms in memory
    *frozen*
ages, tolerances, gaps | robots that must stop: no lookup silently uses old data
    tests/ros/test_max_age* */test_ages* tests/core/test_lookup_policies.py tests/core/test_clocks*
    *model_policies* *time_of_day* *time_is_set* docs/time.md
lookups of many times, arrays | users of NumPy: thousands of lookups in one call
    tf2_py/core/series* tf2_py/engine/arrays* tf2_ros/numpy* tests/core/test_numpy.py *matri* *many_times*
    *test_lookups_at* *propagate_cov* *test_time_range* docs/arrays.md
message filters | users of tf2_ros in C++: messages wait for their transforms
    tf2_ros/message_filter* *filtered_messages* *test_message_filter* examples/message_filter.py
buffer server and client | programs without a buffer of their own: lookups by an action
    *buffer_client* *buffer_server* *buffer-server*
waits, futures, callbacks | nodes that wait: timeouts count in callbacks, and waits end at the arrival
    tf2_ros/_wait/* *wait* *futures* *test_callbacks* *changes* *spin* */threads.py
    *test_threads* *call_queue* */background.py *rclpy_inside* tf2_ros/_rclpy* *async* *awaiting* *coroutine*
    */_live_objects.py tf2_ros/_sources.py
    *sources_without_node* docs/callbacks.md docs/asyncio.md
    *ended_nodes* *ends_listeners_in_any_order* */_running_loop.py
forks and signals | users of multiprocessing and Ctrl-C: children and handlers do not hang
    *fork* *interrupt* *late_signals* *stack_at_alarm* *exits_while_active*
receiver | nodes with a listener: transforms arrive without spinning, at a tenth of the CPU time
    tf2_ros/_receive/* tf2_ros/_rcl.* tf2_ros/*listen* tf2_py/core/batch* tf2_ros/_qos.py *hidden_nodes*
    tf2_ros/_process/inbox*
    tf2_py/engine/engine_hooks* tests/ros/test_inbox* *who_takes* *listener* *receiver* *reception_in_texts*
    *lost_messages* *publishes_in_bursts* *rcl_declarations* *faulty_middleware* *excused_faults*
    *half_discovered_server* *large_messages* *floods* *listed_source* *test_cdr* */core/cdr*
    *cdr_encoder* */topic_publishers.py *takes_after* *frame_prefix*
    tf2_ros/_registration.py docs/several-robots.md docs/environment-and-qos.md
records and serialized messages | writers of recorders and bridges: bytes in and out, without ROS
    tf2_ros/records* tf2_ros/serialization* tests/ros/test_records.py *test_serialization*
    tests/core/test_insert_messages.py
broadcasters | publishers of transforms: tf2_ros's classes
    tf2_ros/*broadcaster* tests/ros/test_broadcasters.py docs/broadcasting.md
types of messages | users of tf2_geometry_msgs: do_transform_* and transform for every type, registered types
    tf2_geometry_msgs/* tests/core/test_tf2_geometry_msgs.py tests/core/test_every_message_type.py
    tests/core/test_type_tables.py tests/ros/test_buffer_interface.py *quaternions*
    tests/core/test_roll_pitch_yaw.py docs/message-types.md *type_tables* *new-message-type*
    *new_message_type* *rotations*
without ROS | laptops without ROS: the same imports, with stand-ins for messages
    *without_ros* *message_standins* *messages_with_or_without* */_messages.py
installation beside other tf2 | users of a sourced ROS 2: the right tf2 is imported, and a command says which
    tf2_ros_cython/* *which* *sourced* docs/installing.md docs/creating-a-package.md docs/switching.md
    *installing* *unknown_rclpy* *creating_a_package*
buffer | everybody: tf2's tree, lookups and errors, with the reason
    tf2_py/* tf2_ros/* docs/debugging.md docs/differences.md docs/limits.md docs/cheat-sheet.md
    docs/getting-started.md docs/index.md
robot models | users of a URDF: frames of joints in recordings
    tools/*urdf* tools/*joint*
recordings | analysts: a buffer, tables and files from .mcap, .db3, .bag, with or without ROS
    tools/*bag* tools/*recording* tools/*pose* tools/*foxglove_messages* tools/*yaml_files* tools/*dataset*
    tools/*saved* tools/*loading* tools/*optional_libraries* tools/*poses-and-joint*
live feeds | laptops beside a robot: its transforms over DDS, Zenoh or Foxglove, without ROS
    tools/*/live/* tools/*live* tools/*laptop* tools/*robot_with* tools/*zenoh* tools/*foxglove*
diagnosis and pictures | whoever looks for a fault: tf2_check, tf2_monitor, tf2_echo, view_frames, plots
    tools/*check* tools/*monitor* tools/*echo* tools/*view_frames* tools/*picture* tools/*plot* tools/*stream*
    tools/*finding* tools/*/diagnosis/* tools/*listening* tools/*session*
    tools/*roll_pitch* tools/*output* tools/*view*
static publisher | robots with mounted frames: their transforms from a command, a file or a recording
    tools/*static_transform*
commands in common | users of all commands: options, texts and exit codes alike
    tools/*
tf2_msgs wheels | users of PyPI's ROS 2: the messages that it lacks
    messages/* *tf2_msgs_packaging*
measurements | readers of the claims about speed: each figure can be repeated
    bench/* docs/performance.md *instruction_counts*
searches for faults | users who rely on it: fuzzing, sanitizers, stress
    reliability/* *fuzz* docs/development/reliability.md *failing_allocations* *allocation_failures*
build and release | packagers: wheels, debs and checks
    build_backend/* setup.py release/* docs/*.py docs/development/release.md
    docs/development/distribution-packages.md
    tests/packaging/* *typed* *type_checkers*
examples and internals | readers of the code: where what is, and programs to begin with
    examples/* docs/development/* docs/tests-and-types.md docs/*.md
tests in common | maintainers: the model, recorded answers, users' programs
    tests/*
"""


def _features():
    found, patterns = {}, []
    for line in TABLE.strip().splitlines():
        if line.startswith(" "):
            patterns += line.split()
        else:
            name, promise = line.split(" | ")
            patterns = []
            found[name] = promise, patterns
    return found


FEATURES = _features()


def feature_of(path):
    for feature, (_, patterns) in FEATURES.items():
        if any(fnmatch.fnmatch(path, pattern) for pattern in patterns):
            return feature
    return None


def counted(path):
    """The column of a file, and what it adds to it; None: it does not count."""
    if path.startswith(("tests/", "tools/tests/")):
        column = "tests" if path.endswith(CODE) else None
    elif path.endswith(".md") and path.startswith(("docs/", "tools/docs/")):
        column = "pages"
    else:
        column = "code" if path.endswith(CODE) else None
    if column is None or path == str(PAGE.relative_to(ROOT)):
        return None
    text = (ROOT / path).read_text()
    if column == "pages":
        return column, len(text.split())
    # Without those of the license.
    return column, sum("SPDX" not in line for line in text.splitlines())


def table(paths):
    """The lines of the table, and the files that count and have no feature."""
    sums = {feature: dict.fromkeys(("code", "tests", "pages"), 0) for feature in FEATURES}
    strays = []
    for path in paths:
        if (found := counted(path)) is None:
            continue
        feature = feature_of(path)
        if feature is None:
            strays.append(path)
        else:
            sums[feature][found[0]] += found[1]
    rows = [(name, FEATURES[name][0], *one.values()) for name, one in sums.items()]
    rows.sort(key=lambda row: -row[2] - row[3])
    rows.append(("all", "", *(sum(row[i] for row in rows) for i in (2, 3, 4))))
    lines = ["| feature | what it promises, and to whom | code | tests | pages |", "|---|---|---|---|---|"]
    lines += [
        f"| {name} | {to} | {code:,} | {tests:,} | {pages:,} |" for name, to, code, tests, pages in rows
    ]
    return lines, strays


def main():
    paths = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()
    lines, strays = table(paths)
    if strays:
        sys.exit(f"add to TABLE of {Path(__file__).name}: {' '.join(strays)}")
    head = PAGE.read_text().partition("\n| feature")[0]
    PAGE.write_text("\n".join([head, *lines, ""]))


if __name__ == "__main__":
    main()

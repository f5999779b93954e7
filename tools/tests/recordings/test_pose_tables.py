# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tables of looked-up transforms: at which times, and what a file says of a stamp."""

import numpy as np
import pytest
from making_bags import S, Sent, Tf, drive, write_mcap
from times_and_transforms import about_z

from tf2_ros_tools.bag import load
from tf2_ros_tools.recordings.bag_loader import read_contents
from tf2_ros_tools.recordings.pose_tables import Table, as_tum, look_up_table, times_at_rate, times_when


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """From 100 s to 101.9 s, and an arm that begins later, above an island."""
    arm = [Sent(stamp, "/tf", [Tf("base", "arm", stamp)]) for stamp in (100_950_000_000, 101_450_000_000)]
    island = [Sent(100 * S, "/tf_static", [Tf("sea", "boat", 0)])]
    messages = sorted([*drive(20), *arm, *island], key=lambda one: one.log_ns)
    return write_mcap(tmp_path_factory.mktemp("bag") / "drive.mcap", messages)


@pytest.mark.parametrize(
    ("ends", "hz", "begin", "count"),
    [
        (("map", "camera"), 10, 100.0, 20),
        (("camera", "map"), 3, 100.0, 6),
        (("map", "arm"), 2, 100.95, 2),
        (("base", "camera"), 10, 100.0, 20),  # static: over the span of all frames
        (("map", "map"), 1, 100.0, 2),
    ],
)
def test_a_rate_is_over_the_span_that_all_frames_between_share(path, ends, hz, begin, count):
    times = times_at_rate(load(path), *ends, hz)
    assert times.dtype == np.int64
    assert times.tolist() == [round(begin * S) + round(i * S / hz) for i in range(count)]


def test_times_far_apart_do_not_fill_the_memory(tmp_path):
    moving = [Sent(i, "/tf", [Tf("map", "base", stamp)]) for i, stamp in enumerate((5, 1_700_000_000 * S))]
    buffer = load(write_mcap(tmp_path / "a.mcap", moving))
    for hz, count in ((100.0, r"17\d{10}"), (1e300, "inf")):
        with pytest.raises(ValueError, match=f"at most 50000000 times, got {count}"):
            times_at_rate(buffer, "map", "base", hz)


def test_a_chain_has_the_stamps_of_its_own_frames(path):
    heard = read_contents(path)
    stamps = [100 * S + i * S // 10 for i in range(20)]
    assert times_when(heard, "map", "camera", None).tolist() == stamps
    of_arm = [100_950_000_000, 101_450_000_000]
    assert times_when(heard, "arm", "base", None).tolist() == of_arm
    # Those at which a part of the chain is not known have a row without an answer.
    table, _ = look_up_table(heard, "map", ["arm"], times_when(heard, "map", "arm", None))
    assert table.stamps_ns.tolist() == sorted(stamps + of_arm)
    assert table.stamps_ns[table.valid[:, 0]].tolist() == [
        stamp for stamp in sorted(stamps + of_arm) if of_arm[0] <= stamp <= of_arm[1]
    ]


@pytest.mark.parametrize("seed", range(20))
def test_a_frame_between_others_counts_only_while_it_is_there(seed, tmp_path):
    rng = np.random.default_rng(seed)
    sent = []
    for child, parents in (
        ("odom", ["map", "lift"]),
        ("base", ["map", "odom", "lift", "truck"]),
        ("lift", ["map", "odom"]),
    ):
        stamps = np.sort(rng.choice(np.arange(100, 160), 25, replace=seed % 2 == 1)).tolist()
        own = rng.permutation(parents)[np.sort(rng.integers(len(parents), size=25))]
        sent += [
            Sent(ns * S, "/tf", [Tf(str(one), child, ns * S)]) for ns, one in zip(stamps, own, strict=True)
        ]
    sent += [Sent(100 * S, "/tf_static", [Tf("base", "camera", 0)])]
    heard = read_contents(write_mcap(tmp_path / "a.mcap", sorted(sent, key=lambda one: one.log_ns)))
    buffer, histories = heard.buffer, heard.buffer.histories()
    every = [ns * S // 2 for ns in range(2 * 98, 2 * 162)]
    for target, source in (("map", "camera"), ("lift", "base"), ("base", "odom")):
        hops = {
            ns: [one for one in buffer.explain(target, source, ns).hops if not one.static]
            for ns in every
            if buffer.can_transform(target, source, ns)
        }
        table, _ = look_up_table(heard, target, [source], every)
        gaps = [max((one.gap for one in hops[ns]), default=0.0) if ns in hops else np.nan for ns in every]
        np.testing.assert_array_equal(table.gaps[:, 0], gaps)
        measured = [
            ns for ns, own in hops.items() if any(ns in histories[one.frame].stamps_ns for one in own)
        ]
        times = times_when(heard, target, source, None)
        assert [ns for ns in times.tolist() if ns in hops] == measured
        at_rate = times_at_rate(buffer, target, source, 2.0)
        moves = [ns for ns, own in hops.items() if own]
        assert (at_rate[0], at_rate[-1]) == (moves[0], moves[-1])


def test_neighboring_rows_do_not_jump_to_the_opposite_quaternion(tmp_path):
    stamps = [100 * S + i * S for i in range(101)]  # two turns
    turns = [about_z(2 * np.pi * i / 50) for i in range(101)]
    poses = zip(stamps, turns, strict=True)
    moving = [Sent(ns, "/tf", [Tf("map", "base", ns, (0, 0, 0), q)]) for ns, q in poses]
    heard = read_contents(write_mcap(tmp_path / "a.mcap", moving))
    _, rotations = heard.buffer.lookup_transforms("map", "base", stamps)
    assert (np.einsum("ij,ij->i", rotations[1:], rotations[:-1]) < 0).sum() == 2  # as with tf2
    times = [stamps[0] - 1, *stamps[:30], -(2**63), *stamps[30:], stamps[-1] + 1, *reversed(stamps)]
    table, _ = look_up_table(heard, "map", ["base"], times)
    answers = table.poses[table.valid, 3:]
    assert len(answers) == 202
    assert (np.einsum("ij,ij->i", answers[1:], answers[:-1]) > 0.99).all()
    np.testing.assert_allclose(answers[:101], turns, atol=1e-15)
    assert np.isnan(table.poses[~table.valid]).all()


@pytest.mark.parametrize("stamps", [(0,), (0, 1, 2), (0, S), (0, 0, 5)])
def test_the_row_of_the_stamp_0_is_the_pose_at_0(stamps, tmp_path):
    sent = [Sent(i, "/tf", [Tf("map", "base", ns, (ns, i, 0))]) for i, ns in enumerate(stamps)]
    sent += [Sent(9, "/tf", [Tf("world", "map", ns, (0, 8, ns))]) for ns in (0, 2 * S)]
    sent += [Sent(9, "/tf_static", [Tf("base", "/camera", 7 * S, (0, 0, 3))])]
    heard = read_contents(write_mcap(tmp_path / "a.mcap", sent))
    table, reasons = look_up_table(heard, "world", ["camera"], [0, stamps[-1], 0])
    assert reasons == {}
    # Of several samples of one stamp, the one that lookups of other times use, too.
    assert table.poses[[0, 2], 0, :3].tolist() == [[0, 8 + (stamps.count(0) - 1), 3]] * 2
    assert table.poses[1, 0, 0] == stamps[-1]


def test_a_stamp_0_without_data_has_no_answer(path):
    table, reasons = look_up_table(read_contents(path), "map", ["camera"], [0, 101 * S])
    assert (table.valid[:, 0].tolist(), reasons) == ([False, True], {})


def test_a_stamp_in_seconds_keeps_its_nanoseconds():
    stamps = [0, 1, -1, 1_700_000_000 * S + 7]
    poses = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (4, 1, 1))
    table = Table(np.array(stamps), poses, np.zeros((4, 1)))
    texts = [
        line.removesuffix(" 0.0 0.0 0.0 0.0 0.0 0.0 1.0") for line in as_tum(table).decode().splitlines()
    ]
    assert texts == ["0.000000000", "0.000000001", "-0.000000001", "1700000000.000000007"]

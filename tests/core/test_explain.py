# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Explained lookups: the hops, the samples that have answered, and what is printed."""

import itertools
import pickle
import random
from xml.etree import ElementTree

import numpy as np
import pytest
import random_runs
from buffer_beside_model import GOOD_PLACES, GOOD_TURNS, Pair, SetClock
from model_terms import TF2
from questions_beside_model import compare_explained, some_policy
from rotations import Turn
from times_and_transforms import S, about_z, at_ns, insert, transform

from tf2_py import BufferCore, Explanation, Hop


def lines(explanation):
    return str(explanation).splitlines()


@pytest.fixture
def buffer():
    """A robot whose odometry is dense, and whose localization is not."""
    made = BufferCore()
    made.set_transform_static(transform("base_link", "lidar", xyz=(0.2, 0, 0.5)), "/robot_state_publisher")
    for ms in range(12_000, 13_001, 50):
        made.set_transform(transform("odom", "base_link", ns=ms * 10**6, xyz=(ms / 1000, 0, 0)), "/odometry")
    for ms in (11_800, 12_300, 12_800):
        made.set_transform(transform("map", "odom", ns=ms * 10**6, xyzw=about_z(ms / 1000)), "/amcl")
    return made


def test_the_hops_of_a_walk_up_and_down_follow_one_another(buffer):
    found = buffer.explain("map", "lidar", at_ns(12_500_000_000))
    assert isinstance(found, Explanation)
    assert [(hop.frame, hop.parent, hop.direction) for hop in found.hops] == [
        *[("lidar", "base_link", "up"), ("base_link", "odom", "up"), ("odom", "map", "up")]
    ]
    mount, wheels, localization = found.hops
    assert isinstance(mount, Hop)
    assert (mount.static, mount.how, mount.older_ns, mount.newer_ns) == (True, "static", None, None)
    assert (wheels.static, wheels.how, wheels.older_ns) == (False, "sample", 12_500_000_000)
    assert localization[2:8] == ("up", "interpolated", 12_300_000_000, 12_800_000_000, 0.4, 0.5)
    assert found.weakest == localization
    assert localization.transform.header.frame_id == "map"
    assert localization.transform.child_frame_id == "odom"
    back = buffer.explain("lidar", "map", 12_500_000_000)
    assert [hop._replace(direction="up") for hop in reversed(back.hops)] == found.hops
    assert {hop.direction for hop in back.hops} == {"down"}
    assert str(back).splitlines()[1].startswith("  odom ← map  interpolated 40 %")


def test_what_is_printed_names_samples_gaps_and_authorities(buffer):
    assert lines(buffer.explain("map", "lidar", 12_500_000_000)) == [
        "map ← lidar at 12.500000000",
        "  base_link ← lidar  static, last from /robot_state_publisher",
        "  odom ← base_link  sample at 12.500 s, last from /odometry",
        "  map ← odom  interpolated 40 % between 12.300 and 12.800 s (gap 0.500 s), last from /amcl",
        "weakest: map ← odom",
    ]
    for extrapolate, text in (
        (False, "held from its newest sample at 12.800 s (gap 0.200 s)"),
        (True, "extrapolated 140 % of 12.300 to 12.800 s (gap 0.200 s)"),
    ):
        found = buffer.explain("map", "odom", 13 * S, tolerance=0.5, extrapolate=extrapolate)
        assert lines(found)[1] == f"  map ← odom  {text}, last from /amcl"
    buffer.set_transform(transform("earth", "odom", 13), "/gps\n")
    assert lines(buffer.explain("map", "odom", 12_900_000_000))[1] == (
        "  map ← odom  kept from 12.800 s, because the sample at 13.000 s has another parent (gap 0.200 s), "
        r"last from /gps\n"
    )
    assert lines(buffer.explain("lidar", "base_link", 0)) == [
        "lidar ← base_link at 0.000000000",
        "  lidar ← base_link  static, last from /robot_state_publisher",
    ]
    assert lines(buffer.explain("map", "map", 5)) == ["map ← map at 0.000000005"]


def test_the_time_is_the_latest_one_unless_it_is_given(buffer):
    assert buffer.explain("map", "lidar") == buffer.explain("map", "lidar", 0)
    assert buffer.explain("map", "lidar", max_gap=1) == buffer.explain("map", "lidar", 0, max_gap=1)


def test_the_age_decides_which_hop_is_the_weakest_where_a_clock_shows_it(tf2_ros):
    buffer = tf2_ros.Buffer()
    buffer.clock = SetClock(round(13.1 * S))
    insert(buffer, "map", "odom", 12, 12.5)
    insert(buffer, "odom", "base_link", 12, 12.4, 13)
    found = buffer.explain("map", "base_link", 0)
    assert {hop.frame: hop.age for hop in found.hops} == buffer.ages("map", "base_link")
    assert [hop.gap for hop in found.hops] == [0.6, 0]
    assert found.weakest.frame == "base_link"
    buffer.clock = SetClock(13_200_000_000)
    assert buffer.explain("map", "base_link", 0).weakest.frame == "odom"
    text = str(buffer.explain("odom", "base_link", 12 * S + 1))
    assert "(gap 0.400 s), newest 0.200 s old, last from x" in text
    buffer.clock = SetClock(0)  # simulated time has not begun
    assert "newest of unknown age" in str(buffer.explain("map", "odom", 0))
    buffer.clock = None
    assert [hop.age for hop in buffer.explain("map", "base_link", 0).hops] == [None, None]


def rows_of(explanation):
    """The title of the table that notebooks show, its cells, and the styles of its rows."""
    table = ElementTree.fromstring(explanation._repr_html_())
    rows = table.findall("tr")
    styles = [row.get("style") for row in rows[1:]]
    return table.findtext("caption"), [["".join(cell.itertext()) for cell in row] for row in rows], styles


def test_notebooks_show_a_table_with_the_weakest_hop_in_bold(tf2_ros, buffer):
    shown = tf2_ros.Buffer()
    shown.__setstate__(buffer.__getstate__())
    shown.clock = SetClock(13_300_000_000)
    title, rows, styles = rows_of(shown.explain("map", "lidar", 12_500_000_000))
    assert title == "map ← lidar at 12.500000000"
    assert rows == [
        ["hop", "answer", "gap", "newest sample", "last from"],
        ["base_link ← lidar", "static", "", "", "/robot_state_publisher"],
        ["odom ← base_link", "sample at 12.500 s", "", "0.300 s old", "/odometry"],
        ["map ← odom", "interpolated 40 % between 12.300 and 12.800 s", "0.500 s", "0.500 s old", "/amcl"],
    ]
    assert styles == [None, None, "font-weight: bold"]
    assert rows_of(shown.explain("map", "map", 5))[1] == rows[:1]


@pytest.mark.parametrize("extrapolate", [False, True])
def test_in_the_table_hops_after_their_newest_sample_are_red(extrapolate, buffer):
    found = buffer.explain("map", "base_link", 13 * S, tolerance=0.5, extrapolate=extrapolate)
    assert rows_of(found)[2] == [None, "color: #D55E00; font-weight: bold"]


def test_a_name_in_the_table_is_not_markup():
    buffer = BufferCore()
    insert(buffer, "<b>map</b>", "&amp;\x1b", 1)
    assert rows_of(buffer.explain("<b>map</b>", "&amp;\x1b", 0))[1][1][0] == r"<b>map</b> ← &amp;\x1b"


def test_where_a_lookup_fails_the_explanation_raises_its_error(tf2_ros, buffer):
    both = tf2_ros.Buffer()
    both.__setstate__(buffer.__getstate__())
    for query, policy in (
        (("map", "lidr", 0), {}),
        (("map", "/lidar", 0), {}),
        (("map", "lidar", 13 * S), {}),
        (("map", "lidar", 12_500_000_000), {"max_gap": 0.4}),
        (("map", "lidar", 0), {"tolerance": {"nowhere": 1}}),
    ):
        with pytest.raises((tf2_ros.TransformException, ValueError)) as wanted:
            both.lookup_transform(*query, **policy)
        with pytest.raises(type(wanted.value)) as raised:
            both.explain(*query, **policy)
        assert str(raised.value) == str(wanted.value)
    with pytest.raises(ValueError, match="ages need a clock"):
        buffer.explain("map", "lidar", 0, max_age=1)
    with pytest.raises(ValueError, match="max_age limits the age of the latest transform, so time must"):
        both.explain("map", "lidar", 1, max_age=1)
    with pytest.raises(TypeError, match=r"explain\(\) got an unexpected keyword argument 'timeout'"):
        both.explain("map", "lidar", 0, timeout=1.0)


def test_explanations_are_pickled_and_compared(buffer):
    found = buffer.explain("map", "lidar", 12_425_000_000)
    assert pickle.loads(pickle.dumps(found)) == found
    assert found != buffer.explain("map", "lidar", 12_425_000_001)


def test_a_path_of_a_thousand_hops_is_explained():
    buffer, random_ = BufferCore(), np.random.default_rng(5)
    for i, q in enumerate(Turn.random(random_, 2000).q):
        parent = f"f{i}" if i not in (0, 1000) else "root"
        buffer.set_transform(transform(parent, f"f{i + 1}", 1, random_.normal(size=3), q), f"a{i}")
    found = buffer.explain("f1000", "f2000", S)
    assert [hop.frame for hop in found.hops] == [
        *(f"f{i}" for i in range(2000, 1000, -1)),
        *(f"f{i}" for i in range(1, 1001)),
    ]
    assert [hop.last_authority for hop in found.hops[:2]] == ["a1999", "a1998"]
    assert found.transform == buffer.lookup_transform_core("f1000", "f2000", at_ns(S))


@pytest.mark.usefixtures("no_refusals_logged")
@pytest.mark.parametrize("seed", range(random_runs.times(12, 60)))
def test_explanations_of_small_trees_are_those_of_the_model(seed):
    """With several parents, loops, stamps of 0, equal ones, one sample, and frames that become static."""
    dice, pair = random.Random(seed), Pair()
    pair.init(2**62)
    pair.set_clock(dice.choice((None, 0, 12)))
    for _ in range(dice.randrange(4, 30)):
        parent, child = dice.choice(("ab", "bc", "bd", "ab", "bc", "bd", "ac", "da"))
        link = parent, child, dice.randrange(12), dice.randrange(GOOD_PLACES), dice.randrange(GOOD_TURNS)
        pair.insert(dice.choice(("set", "set", "set", "static")), (link,), dice.choice(("one", "two")))
    for target, source in itertools.product(pair.model.names, repeat=2):
        for ns in {0, *dice.sample(pair.times(), 8)}:
            latest = ns == 0 and pair.now_ns is not None
            for policy in (TF2, some_policy(dice, latest), some_policy(dice, latest)):
                compare_explained(pair, target, source, ns, policy)

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Use a ROS domain that no other test, run or demonstration on this machine uses."""

import os
import sys

from reliability.flagged_builds import ROOT

SUPPORT = ROOT / "tests" / "support"
sys.path.insert(0, str(SUPPORT))

from ros_domains import claim_domain  # noqa: E402


def use_own_domain():
    """Claim a domain for this process and its children; before rclpy is imported."""
    domain = claim_domain()
    os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    for profiles in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
        os.environ.setdefault(profiles, str(SUPPORT / "fastdds.xml"))
    os.environ.pop("ROS_LOCALHOST_ONLY", None)  # it would override the range
    return domain

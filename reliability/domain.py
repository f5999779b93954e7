"""Choose a ROS domain that no other test, run or demonstration on this machine uses."""

import fcntl
import os
import random
import tempfile
from pathlib import Path

from reliability.builds import ROOT

DOMAINS = range(1, 102)  # the ports of higher ones may be taken by the system
_locks = []


def use_own_domain():
    """Claim a domain for as long as this process lives, for it and its children; before rclpy is imported."""
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        lock = open(Path(tempfile.gettempdir()) / f"tf2-ros-cython-domain-{domain}.lock", "w")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        _locks.append(lock)
        os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
        for profiles in ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"):
            os.environ.setdefault(profiles, str(ROOT / "tests" / "support" / "fastdds.xml"))
        # The first would override the range, with the second listeners would not subscribe.
        for variable in ("ROS_LOCALHOST_ONLY", "TF2_SHARED_BUFFER"):
            os.environ.pop(variable, None)
        return domain
    raise SystemExit("every ROS domain is in use")

# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Choose a ROS domain that nothing else on this machine uses."""

import random
import socket

# The ports of others may be taken by the system. The low ones come last, because people choose them for
# programs that do not claim a domain.
DOMAINS = range(215, 232), range(1, 102)
LAST_PORT, FIRST_PORTS = 249, range(64)  # of a domain: none uses so many as to need the last one
_claims = []


def _bound(port, host=""):
    """A socket with a UDP port of this machine; None: somebody else has it."""
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        one.bind((host, port))
    except OSError:
        one.close()
        return None
    return one


def claim_domain():
    """
    Claim a ROS domain that nobody on this machine uses, for as long as this process lives.

    Simultaneous test runs must not share topics, nor must the processes of one run, `pytest -n`. A port is
    seen by all users, where a file in /tmp may be unreadable.
    """
    for domain in [one for some in DOMAINS for one in random.Random().sample(some, len(some))]:
        first = 7400 + 250 * domain
        claim = _bound(first + LAST_PORT, "127.0.0.1")
        if claim is None:
            continue
        # Another ROS 2 may use the domain.
        tried = [_bound(first + offset) for offset in FIRST_PORTS]
        for one in filter(None, tried):
            one.close()
        if all(tried):
            _claims.append(claim)
            return domain
        claim.close()
    raise SystemExit("every ROS domain is in use")

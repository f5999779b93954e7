# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The addresses of robots, which ``connect`` is given."""

import os
from typing import NamedTuple
from urllib.parse import parse_qsl, urlsplit

EXAMPLES = "zenoh://robot:7447, dds://, dds://?peers=192.168.0.7 or ws://robot:8765"


class Address(NamedTuple):
    """Where a robot is: what ``connect`` was given, in parts."""

    where: str  # as a whole
    scheme: str
    host: str  # "" if there is none
    port: int | None
    options: dict[str, str]  # what follows the question mark
    domain: int  # of ROS
    topics: tuple[str, str]  # of dynamic and of static transforms, with their slashes


def parse(where: str, domain: int | None, topics: tuple[str, str]) -> Address:
    """
    Take apart what ``connect`` was given.

    :raises TypeError: the address is not a str.
    :raises ValueError: the address, the domain or the name of a topic is invalid.
    """
    if not isinstance(where, str):
        raise TypeError(f"where: expected a str, such as {EXAMPLES}, got {type(where).__name__}")
    try:
        parts = urlsplit(where)
        port = parts.port
        if port == 0:
            raise ValueError("a port is a number from 1 to 65535")
        options = parse_qsl(parts.query, keep_blank_values=True)
        if len(options) > len(dict(options)):
            raise ValueError("an option is given twice")
        if "://" in where and (parts.path.strip("/") or parts.fragment or parts.username is not None):
            raise ValueError("only a host, a port and options are understood")
    except ValueError as error:
        raise ValueError(f"expected an address such as {EXAMPLES}, got {where!r}: {error}") from None
    names = tuple(_topic(name) for name in topics)
    if names[0] == names[1]:
        raise ValueError(f"topic and static_topic must differ, but both are {names[0]!r}")
    return Address(
        where,
        parts.scheme,
        parts.hostname or "",
        port,
        dict(options),
        _domain(domain),
        (names[0], names[1]),
    )


def refuse_options(address: Address, *known: str) -> None:
    """Raise a ValueError if an address has options other than these."""
    if unknown := [name for name in address.options if name not in known]:
        accepted = " and ".join(known) or "none"
        text = f"unknown option {unknown[0]!r}; {address.scheme}:// accepts {accepted}"
        raise ValueError(f"{address.where}: {text}")


def _topic(name: str) -> str:
    if not isinstance(name, str) or not name.strip("/"):
        raise ValueError(f"expected the name of a topic, such as /tf, got {name!r}")
    return f"/{name.strip('/')}"


def _domain(domain: int | None) -> int:
    if domain is None:
        text = os.environ.get("ROS_DOMAIN_ID") or "0"
        if not text.isdecimal() or int(text) > 232:
            raise ValueError(f"ROS_DOMAIN_ID: expected a number from 0 to 232, got {text!r}")
        return int(text)
    if not isinstance(domain, int) or isinstance(domain, bool) or not 0 <= domain <= 232:
        raise ValueError(f"domain: expected a number from 0 to 232, got {domain!r}")
    return domain

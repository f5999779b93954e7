# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rename frames in recorded messages of any type, by the definitions that the recording has of these."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

from tf2_py import stored_name
from tf2_ros_tools.recordings.bag_reader import Raw, encoding_of, full_name

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

# Fields of type string that name a frame: of a std_msgs/Header, of messages with a child, and of Foxglove's.
FIELDS = {"frame_id", "child_frame_id", "parent_frame_id"}
HEADER = "std_msgs/msg/Header"
ALIGNMENT = 8  # the largest one of CDR
BEGIN = 12  # of the first string: after the encapsulation and the stamp
LENGTH = {order: struct.Struct(f"{order}I") for order in "<>"}
# Where the frames are in a message: the fields that name one, and the fields whose values contain some, with
# whether these are lists.
Plan: TypeAlias = "tuple[list[str], list[tuple[str, bool, Plan]]]"


class Names:
    """
    The new names of frames.

    ``seen`` has the recorded names that were asked for, as buffers store them.

    :param renamed: from the recorded name, as buffers store it, to the new one.
    :param prefix: is put in front of all other names, unless they are empty.
    """

    def __init__(self, renamed: Mapping[str, str], prefix: str) -> None:
        self.seen: set[str] = set()
        self._renamed, self._prefix = {**renamed}, prefix

    def __bool__(self) -> bool:
        return bool(self._renamed or self._prefix)

    def of(self, frame: str) -> str:
        """Get the new name of a frame."""
        name = stored_name(frame)
        self.seen.add(name)
        if name in self._renamed:
            return self._renamed[name]
        return f"{self._prefix}{name}" if self._prefix and name else frame

    @property
    def changed(self) -> set[str]:
        """The names in ``seen`` that have another one."""
        return {name for name in [*self.seen] if self.of(name) != name}


def renaming(connection: Connection, names: Names) -> Callable[[Raw], Raw] | None:
    """
    Make a function that renames the frames in messages.

    :return: None: messages of this type do not name frames.
    :raises ValueError: where they do so is not known: they are not in CDR, or their type is not defined. Of
        the parsers' errors, any kind.
    """
    if (encoding := encoding_of(connection)) != "cdr":
        raise ValueError(f"expected the encoding cdr, got {encoding}")
    msgtype = full_name(connection.msgtype)
    store = _store_of(connection, msgtype)
    try:
        plan = _plan_of(store, msgtype)
    except KeyError as error:
        raise ValueError(f"the recording has no definition of {error.args[0]}") from None
    if plan is None:
        return None
    store.get_msgdef(msgtype)  # fails if the codec lacks one of its types, such as wstring
    first, (_, about) = store.fielddefs[msgtype][1][0]
    is_only_header = about == HEADER and plan == ([], [(first, False, (["frame_id"], []))])

    def rename(raw: Raw) -> Raw:
        if is_only_header and (patched := _patched(raw, names)) is not None:
            return patched
        message = store.deserialize_cdr(raw, msgtype)
        return store.serialize_cdr(message, msgtype) if _rename(message, plan, names) else raw

    return rename


def _patched(raw: Raw, names: Names) -> Raw | None:
    """Rename the frame of a header that a message begins with, unless this moves what follows; then, None."""
    length = LENGTH["<" if raw[1] & 1 else ">"]
    (size,) = length.unpack_from(raw, BEGIN)
    begin, end = BEGIN + length.size, BEGIN + length.size + size
    if end > len(raw) or not size:
        return None  # malformed, which the decoder says
    frame = str(bytes(raw[begin : end - 1]), "utf-8")
    if (name := names.of(frame)) == frame:
        return raw
    text = name.encode() + b"\0"
    if (len(text) - size) % ALIGNMENT:
        return None
    return b"".join((raw[:BEGIN], length.pack(len(text)), text, raw[end:]))


def _store_of(connection: Connection, msgtype: str) -> Typestore:
    """Get the types that a connection's messages consist of."""
    from rosbags.interfaces import MessageDefinitionFormat as Format
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    form, text = connection.msgdef
    store = get_typestore(Stores.EMPTY)
    if form == Format.NONE:
        return store
    store.register(get_types_from_idl(text) if form == Format.IDL else get_types_from_msg(text, msgtype))
    return store


def _plan_of(store: Typestore, msgtype: str) -> Plan | None:
    from rosbags.interfaces import Nodetype
    from rosbags.typesys.base import normalize_fieldname

    fields: list[str] = []
    parts: list[tuple[str, bool, Plan]] = []
    for name, (kind, about) in store.fielddefs[msgtype][1]:
        field = normalize_fieldname(name)
        if kind == Nodetype.BASE and about[0] == "string" and name in FIELDS:
            fields.append(field)
        is_list = kind in (Nodetype.ARRAY, Nodetype.SEQUENCE)
        one: Any = about[0] if is_list else (kind, about)  # which of both it is, the checker cannot know
        if one[0] == Nodetype.NAME and (plan := _plan_of(store, one[1])) is not None:
            parts.append((field, is_list, plan))
    return (fields, parts) if fields or parts else None


def _rename(message: Any, plan: Plan, names: Names) -> bool:
    """Rename the frames in a decoded message; return whether something has changed."""
    fields, parts = plan
    is_changed = False
    for field in fields:
        frame = getattr(message, field)
        if (name := names.of(frame)) != frame:
            setattr(message, field, name)
            is_changed = True
    for field, is_list, own in parts:
        value = getattr(message, field)
        for one in value if is_list else [value]:
            is_changed |= _rename(one, own, names)
    return is_changed

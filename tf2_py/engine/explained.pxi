# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Make Python objects of explained lookups."""

cdef dict HOP_DATA = {
    HOP_STATIC: "static",
    HOP_SAMPLE: "sample",
    HOP_INTERPOLATED: "interpolated",
    HOP_KEPT: "kept",
    HOP_HELD: "held",
    HOP_EXTRAPOLATED: "extrapolated",
}


cdef object _age(const Hop* hop, const ClockReading* clock):
    # In seconds; None: there is no clock, or the frame is static. As in BufferCore.ages.
    cdef int64_t age_ns
    if clock == NULL or hop.data == HOP_STATIC:
        return None
    age_ns = age_at(hop.newest_ns, clock.now_ns)
    return float("inf") if age_ns == INT64_MAX else <object>age_ns / 1e9


cdef object _new_hop(const Hop* hop, int64_t time_ns, const ClockReading* clock, list names,
                     list authorities):
    cdef int64_t gap_ns = 0
    if hop.data in (HOP_INTERPOLATED, HOP_KEPT):
        gap_ns = hop.newer_ns - hop.older_ns
    elif hop.data in (HOP_HELD, HOP_EXTRAPOLATED):
        gap_ns = time_ns - hop.newer_ns
    frame, parent = name_of(names, hop.frame), name_of(names, hop.parent)
    return explanations.Hop(
        frame=frame,
        parent=parent,
        direction="down" if hop.is_down else "up",
        how=HOP_DATA[hop.data],
        older_ns=None if hop.data == HOP_STATIC else hop.older_ns,
        newer_ns=None if hop.data == HOP_STATIC else hop.newer_ns,
        weight=hop.weight,
        gap=<object>gap_ns / 1e9,
        age=_age(hop, clock),
        last_authority=name_of(authorities, hop.authority),
        transform=new_transform_stamped(&hop.transform, hop.used_ns, parent, frame),
    )


cdef object new_explanation(const Query* query, const Explained* explained, const ClockReading* clock,
                            list names, list authorities):
    # The object of an explained query. `clock`: for the ages; NULL: there is none. `names` and `authorities`:
    # those of the tree.
    target, source, _ = query_names(query)
    return explanations.Explanation(
        transform=new_transform_stamped(&explained.transform, explained.stamp_ns, target, source),
        time_ns=explained.time_ns,
        hops=[_new_hop(&explained.hops[i], explained.time_ns, clock, names, authorities)
              for i in range(explained.count)],
    )

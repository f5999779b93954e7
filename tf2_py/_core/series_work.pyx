"""Owns the arithmetic of many times: each step computes a whole batch, so that the compiler can use SIMD."""

from libc.math cimport fabs, sqrt
from libc.stdint cimport int64_t, uint32_t

from tf2_py._core.cache cimport CACHE_STATIC, NEWEST_HINT, Cache, cache_newest_transform
from tf2_py._core.cache_find cimport cache_neighbours, cache_prefetch
from tf2_py._core.geometry cimport (
    SLERP_SERIES_LIMIT,
    slerp_weights_exact,
    slerp_weights_series,
    vector_rotate,
)
from tf2_py._core.types cimport GAP_NONE, Transform

cdef extern from *:
    """
    /* The functions below are compiled once for every x86-64 and once for AVX2, and the loader selects one.
       The numbers are the same: -ffp-contract=off keeps multiply and add apart. Only glibc's loader can. */
    #if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__)
    struct tf2_work;
    #define TF2_WIDE __attribute__((target_clones("avx2", "default")))
    static void tf2_interpolate(struct tf2_work *) TF2_WIDE;
    static void tf2_climb_source(struct tf2_work *) TF2_WIDE;
    static void tf2_climb_target(struct tf2_work *) TF2_WIDE;
    static void tf2_finish(struct tf2_work *) TF2_WIDE;
    static void tf2_between(struct tf2_work *) TF2_WIDE;
    static void tf2_apply(struct tf2_work *) TF2_WIDE;
    #endif
    """


cdef inline void _put(Columns* columns, uint32_t i, const Transform* value) noexcept nogil:
    columns.tx[i] = value.translation[0]
    columns.ty[i] = value.translation[1]
    columns.tz[i] = value.translation[2]
    columns.qx[i] = value.rotation[0]
    columns.qy[i] = value.rotation[1]
    columns.qz[i] = value.rotation[2]
    columns.qw[i] = value.rotation[3]


cdef inline void _put_identity(Columns* columns, uint32_t i) noexcept nogil:
    columns.tx[i] = columns.ty[i] = columns.tz[i] = 0.0
    columns.qx[i] = columns.qy[i] = columns.qz[i] = 0.0
    columns.qw[i] = 1.0


cdef void _gather(SeriesWork* work, const Cache* cache, const int64_t* times_ns, uint32_t count,
                  uint32_t* hint) noexcept nogil:
    cdef uint32_t hints[BATCH_TIMES]
    cdef uint32_t i
    cdef const Transform* older
    cdef const Transform* newer
    for i in range(count):
        hints[i] = cache_prefetch(cache, times_ns[i])
    for i in range(count):
        # In a short history the place of the previous time is the better hint.
        if hints[i] != NEWEST_HINT:
            hint[0] = hints[i]
        if cache_neighbours(cache, times_ns[i], hint, &older, &newer, &work.ratio[i]) != GAP_NONE:
            work.missing[i] = 1
            _put_identity(&work.older, i)
            _put_identity(&work.newer, i)
            work.ratio[i] = 0.0
            continue
        _put(&work.older, i, older)
        _put(&work.newer, i, newer)
    for i in range(count, BATCH_TIMES):
        _put_identity(&work.older, i)
        _put_identity(&work.newer, i)
        work.ratio[i] = 0.0


cdef void _interpolate "tf2_interpolate"(SeriesWork* work) noexcept nogil:
    cdef uint32_t i
    cdef double ratio, dot, sign, dx, dy, dz, dw, weight_a, weight_b
    for i in range(BATCH_TIMES):
        ratio = work.ratio[i]
        work.hop.tx[i] = (1.0 - ratio) * work.older.tx[i] + ratio * work.newer.tx[i]
        work.hop.ty[i] = (1.0 - ratio) * work.older.ty[i] + ratio * work.newer.ty[i]
        work.hop.tz[i] = (1.0 - ratio) * work.older.tz[i] + ratio * work.newer.tz[i]
        dot = (work.older.qx[i] * work.newer.qx[i] + work.older.qy[i] * work.newer.qy[i]
               + work.older.qz[i] * work.newer.qz[i] + work.older.qw[i] * work.newer.qw[i])
        sign = 1.0 if dot >= 0.0 else -1.0
        dx = sign * work.newer.qx[i] - work.older.qx[i]
        dy = sign * work.newer.qy[i] - work.older.qy[i]
        dz = sign * work.newer.qz[i] - work.older.qz[i]
        dw = sign * work.newer.qw[i] - work.older.qw[i]
        work.sign[i] = sign
        work.distance[i] = 0.5 * (dx * dx + dy * dy + dz * dz + dw * dw)
        slerp_weights_series(work.distance[i], ratio, &weight_a, &weight_b)
        weight_b *= sign
        work.hop.qx[i] = weight_a * work.older.qx[i] + weight_b * work.newer.qx[i]
        work.hop.qy[i] = weight_a * work.older.qy[i] + weight_b * work.newer.qy[i]
        work.hop.qz[i] = weight_a * work.older.qz[i] + weight_b * work.newer.qz[i]
        work.hop.qw[i] = weight_a * work.older.qw[i] + weight_b * work.newer.qw[i]
    # Neighbours that are far apart are rare; for them the series above is not exact enough.
    for i in range(BATCH_TIMES):
        if work.distance[i] > SLERP_SERIES_LIMIT:
            slerp_weights_exact(work.distance[i], work.ratio[i], &weight_a, &weight_b)
            weight_b *= work.sign[i]
            work.hop.qx[i] = weight_a * work.older.qx[i] + weight_b * work.newer.qx[i]
            work.hop.qy[i] = weight_a * work.older.qy[i] + weight_b * work.newer.qy[i]
            work.hop.qz[i] = weight_a * work.older.qz[i] + weight_b * work.newer.qz[i]
            work.hop.qw[i] = weight_a * work.older.qw[i] + weight_b * work.newer.qw[i]


cdef void work_hop(SeriesWork* work, const Cache* cache, const int64_t* times_ns, uint32_t count,
                   uint32_t* hint) noexcept nogil:
    cdef uint32_t i
    if cache.kind == CACHE_STATIC:
        for i in range(BATCH_TIMES):
            _put(&work.hop, i, cache_newest_transform(cache))
        return
    _gather(work, cache, times_ns, count, hint)
    _interpolate(work)


cdef inline void _compose(Columns* a, Columns* b) noexcept nogil:
    # b = a b, as transform_compose
    cdef uint32_t i
    cdef double ux, uy, uz, w, vx, vy, vz, cx, cy, cz, bx, by, bz, bw
    for i in range(BATCH_TIMES):
        ux = a.qx[i]
        uy = a.qy[i]
        uz = a.qz[i]
        w = a.qw[i]
        vx = b.tx[i]
        vy = b.ty[i]
        vz = b.tz[i]
        cx = 2.0 * (uy * vz - uz * vy)
        cy = 2.0 * (uz * vx - ux * vz)
        cz = 2.0 * (ux * vy - uy * vx)
        b.tx[i] = vx + w * cx + (uy * cz - uz * cy) + a.tx[i]
        b.ty[i] = vy + w * cy + (uz * cx - ux * cz) + a.ty[i]
        b.tz[i] = vz + w * cz + (ux * cy - uy * cx) + a.tz[i]
        bx = b.qx[i]
        by = b.qy[i]
        bz = b.qz[i]
        bw = b.qw[i]
        b.qx[i] = w * bx + ux * bw + uy * bz - uz * by
        b.qy[i] = w * by + uy * bw + uz * bx - ux * bz
        b.qz[i] = w * bz + uz * bw + ux * by - uy * bx
        b.qw[i] = w * bw - ux * bx - uy * by - uz * bz


cdef void work_begin_source(SeriesWork* work) noexcept nogil:
    work.source = work.hop


cdef void work_begin_source_identity(SeriesWork* work) noexcept nogil:
    cdef uint32_t i
    for i in range(BATCH_TIMES):
        _put_identity(&work.source, i)


cdef void work_begin_target(SeriesWork* work) noexcept nogil:
    work.target = work.hop


cdef void _climb_source "tf2_climb_source"(SeriesWork* work) noexcept nogil:
    _compose(&work.hop, &work.source)


cdef void _climb_target "tf2_climb_target"(SeriesWork* work) noexcept nogil:
    _compose(&work.hop, &work.target)


cdef void work_climb_source(SeriesWork* work) noexcept nogil:
    _climb_source(work)


cdef void work_climb_target(SeriesWork* work) noexcept nogil:
    _climb_target(work)


cdef void _between "tf2_between"(SeriesWork* work) noexcept nogil:
    # result = target^-1 source, as transform_between
    cdef uint32_t i
    cdef double ux, uy, uz, w, vx, vy, vz, cx, cy, cz
    for i in range(BATCH_TIMES):
        ux = -work.target.qx[i]
        uy = -work.target.qy[i]
        uz = -work.target.qz[i]
        w = work.target.qw[i]
        vx = work.source.tx[i] - work.target.tx[i]
        vy = work.source.ty[i] - work.target.ty[i]
        vz = work.source.tz[i] - work.target.tz[i]
        cx = 2.0 * (uy * vz - uz * vy)
        cy = 2.0 * (uz * vx - ux * vz)
        cz = 2.0 * (ux * vy - uy * vx)
        work.result.tx[i] = vx + w * cx + (uy * cz - uz * cy)
        work.result.ty[i] = vy + w * cy + (uz * cx - ux * cz)
        work.result.tz[i] = vz + w * cz + (ux * cy - uy * cx)
        vx = work.source.qx[i]
        vy = work.source.qy[i]
        vz = work.source.qz[i]
        cx = work.source.qw[i]
        work.result.qx[i] = w * vx + ux * cx + uy * vz - uz * vy
        work.result.qy[i] = w * vy + uy * cx + uz * vx - ux * vz
        work.result.qz[i] = w * vz + uz * cx + ux * vy - uy * vx
        work.result.qw[i] = w * cx - ux * vx - uy * vy - uz * vz


cdef inline void _canonicalise(SeriesWork* work) noexcept nogil:
    # As quaternion_canonicalise; without branches
    cdef uint32_t i
    cdef double lead, sign
    for i in range(BATCH_TIMES):
        lead = work.result.qx[i]
        lead = work.result.qy[i] if fabs(work.result.qy[i]) > fabs(lead) else lead
        lead = work.result.qz[i] if fabs(work.result.qz[i]) > fabs(lead) else lead
        lead = lead if 4.0 * work.result.qw[i] * work.result.qw[i] <= 1.0 else work.result.qw[i]
        sign = -1.0 if lead < 0.0 else 1.0
        work.result.qx[i] *= sign
        work.result.qy[i] *= sign
        work.result.qz[i] *= sign
        work.result.qw[i] *= sign


cdef void _finish "tf2_finish"(SeriesWork* work) noexcept nogil:
    # Unit length and canonical sign, as at the end of a single lookup.
    cdef uint32_t i
    cdef double scale
    for i in range(BATCH_TIMES):
        scale = 1.0 / sqrt(work.result.qx[i] * work.result.qx[i] + work.result.qy[i] * work.result.qy[i]
                           + work.result.qz[i] * work.result.qz[i] + work.result.qw[i] * work.result.qw[i])
        work.result.qx[i] *= scale
        work.result.qy[i] *= scale
        work.result.qz[i] *= scale
        work.result.qw[i] *= scale
    _canonicalise(work)


cdef void work_result(SeriesWork* work, bint with_target) noexcept nogil:
    if with_target:
        _between(work)
    else:
        work.result = work.source
    _finish(work)


cdef void work_identity(SeriesWork* work) noexcept nogil:
    cdef uint32_t i
    for i in range(BATCH_TIMES):
        _put_identity(&work.result, i)


cdef void work_put(SeriesWork* work, uint32_t i, const Transform* value) noexcept nogil:
    _put(&work.result, i, value)


cdef void _apply "tf2_apply"(SeriesWork* work) noexcept nogil:
    _compose(&work.hop, &work.result)
    _canonicalise(work)


cdef void work_apply(SeriesWork* work, const Transform* after) noexcept nogil:
    cdef uint32_t i
    for i in range(BATCH_TIMES):
        _put(&work.hop, i, after)
    _apply(work)


cdef void work_store(const SeriesWork* work, uint32_t count, double* translations,
                     double* rotations) noexcept nogil:
    cdef uint32_t i
    for i in range(count):
        translations[3 * i] = work.result.tx[i]
        translations[3 * i + 1] = work.result.ty[i]
        translations[3 * i + 2] = work.result.tz[i]
        rotations[4 * i] = work.result.qx[i]
        rotations[4 * i + 1] = work.result.qy[i]
        rotations[4 * i + 2] = work.result.qz[i]
        rotations[4 * i + 3] = work.result.qw[i]


cdef void work_transform_points(const SeriesWork* work, uint32_t count, const double* points,
                                double* out) noexcept nogil:
    cdef uint32_t i
    cdef double q[4]
    for i in range(count):
        q[0] = work.result.qx[i]
        q[1] = work.result.qy[i]
        q[2] = work.result.qz[i]
        q[3] = work.result.qw[i]
        vector_rotate(q, points + 3 * i, out + 3 * i)
        out[3 * i] += work.result.tx[i]
        out[3 * i + 1] += work.result.ty[i]
        out[3 * i + 2] += work.result.tz[i]

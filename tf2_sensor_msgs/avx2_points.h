// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/* Transform points, read the span of their times, and move each with its own pose, with the vector registers of
   AVX2; and the search among knots, which the plain loop shares. See _avx2_points.pxd.

   Products and sums are those of the plain loop, in double precision and in the same order: the same bits. */

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* Where the time of a point is, and what the number means. */
struct TimeSource {
    ptrdiff_t offset;       /* bytes from the start of the point */
    int number;             /* its type, see Number; 0: there is no field */
    int64_t unit_ns;        /* of a 1 */
    int64_t base_ns;        /* the time that 0 means */
    double minus, times, plus;  /* what gives ns since the first knot: (number - minus) * times + plus */
};

struct PoseKnots {
    const double *ns;       /* ascending, the first one is 0 */
    const double *columns;  /* 16 for each: columns of the rotation, and the translation, each x y z 0 */
    const double *slopes;   /* 16 for each: change per ns, up to the next knot; 0 for the last one */
    size_t last;            /* index of the last one */
};

/* What the numbers in a field of times are like. */
struct FieldSpan {
    double lowest, highest; /* of the finite ones; infinite if there are none */
    int64_t points;         /* that have coordinates */
    int64_t finite;         /* how many of them have a finite number */
    int64_t large;          /* how many have one of at least 2^31 and less than 2^62 */
};

/* Whether a time, rounded to ns, is between the first and the last knot; NaN is not. */
static inline int knots_include(const struct PoseKnots *knots, double ns)
{
    return ns > -0.5 && ns < knots->ns[knots->last] + 0.5;
}

static inline size_t knot_before(const struct PoseKnots *knots, double ns)
{
    size_t low = 0, high = knots->last + 1;
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (knots->ns[middle] <= ns)
            low = middle;
        else
            high = middle;
    }
    return low;
}

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#include <immintrin.h>

/* One point at a time, as x y z w; w is written as it was read. */
#define WIDE_COLUMNS \
    __m256d column0 = _mm256_setr_pd(matrix[0], matrix[3], matrix[6], 0.0); \
    __m256d column1 = _mm256_setr_pd(matrix[1], matrix[4], matrix[7], 0.0); \
    __m256d column2 = _mm256_setr_pd(matrix[2], matrix[5], matrix[8], 0.0); \
    __m256d column3 = _mm256_setr_pd(translation[0], translation[1], translation[2], 0.0)
#define WIDE_POINT(point) \
    _mm256_add_pd(_mm256_add_pd(_mm256_add_pd( \
        _mm256_mul_pd(column0, _mm256_permute4x64_pd(point, 0x00)), \
        _mm256_mul_pd(column1, _mm256_permute4x64_pd(point, 0x55))), \
        _mm256_mul_pd(column2, _mm256_permute4x64_pd(point, 0xaa))), column3)

__attribute__((target("avx2")))
static size_t avx2_floats(const char *source, size_t step, char *target, size_t target_step,
                          size_t count, const double *matrix, const double *translation)
{
    WIDE_COLUMNS;
    for (size_t i = 0; i < count; i++, source += step, target += target_step) {
        __m128 point = _mm_loadu_ps((const float *)source);
        __m256d wider = _mm256_cvtps_pd(point);
        _mm_storeu_ps((float *)target, _mm_blend_ps(_mm256_cvtpd_ps(WIDE_POINT(wider)), point, 8));
    }
    return count;
}

__attribute__((target("avx2")))
static size_t avx2_doubles(const char *source, size_t step, char *target, size_t target_step,
                           size_t count, const double *matrix, const double *translation)
{
    WIDE_COLUMNS;
    for (size_t i = 0; i < count; i++, source += step, target += target_step) {
        __m256d point = _mm256_loadu_pd((const double *)source);
        _mm256_storeu_pd((double *)target, _mm256_blend_pd(WIDE_POINT(point), point, 8));
    }
    return count;
}

__attribute__((always_inline))
static inline double load_time(const char *place, int number)
{
    double value;
    float single;
    int32_t whole;
    uint32_t positive;
    switch (number) {
    case 8:
        memcpy(&value, place, 8);
        return value;
    case 7:
        memcpy(&single, place, 4);
        return single;
    case 5:
        memcpy(&whole, place, 4);
        return whole;
    default:
        memcpy(&positive, place, 4);
        return positive;
    }
}

/* Four points at a time, without branches, because NaN is hard to predict. */
__attribute__((target("avx2"), always_inline))
static inline size_t span_of_floats(const char *points, size_t step, size_t count, ptrdiff_t xyz,
                                    ptrdiff_t offset, int number, struct FieldSpan *span)
{
    const __m128i first_three = _mm_set1_epi32(0xffffff);
    const __m256d infinity = _mm256_set1_pd(__builtin_inf()), sign = _mm256_set1_pd(-0.0);
    const __m256d large_from = _mm256_set1_pd(0x1p31), large_to = _mm256_set1_pd(0x1p62);
    __m256d lowest = infinity, highest = _mm256_or_pd(infinity, sign);
    __m256i having = _mm256_setzero_si256(), finite = having, large = having;
    size_t done = 0;
    for (; done + 4 <= count; done += 4, points += 4 * step) {
        __m128i lacks[4];
        for (int i = 0; i < 4; i++) {
            __m128 point = _mm_loadu_ps((const float *)(points + i * step + xyz));
            lacks[i] = _mm_castps_si128(_mm_cmpunord_ps(point, point));
        }
        /* One byte for each coordinate, and a fourth for what follows them. */
        __m128i pairs[2] = {_mm_packs_epi32(lacks[0], lacks[1]), _mm_packs_epi32(lacks[2], lacks[3])};
        __m128i bytes = _mm_packs_epi16(pairs[0], pairs[1]);
        __m256i has = _mm256_cvtepi32_epi64(
            _mm_cmpeq_epi32(_mm_and_si128(bytes, first_three), _mm_setzero_si128()));
        __m256d value = _mm256_setr_pd(
            load_time(points + offset, number), load_time(points + step + offset, number),
            load_time(points + 2 * step + offset, number), load_time(points + 3 * step + offset, number));
        __m256d is_finite = _mm256_and_pd(
            _mm256_castsi256_pd(has), _mm256_cmp_pd(_mm256_andnot_pd(sign, value), infinity, _CMP_LT_OQ));
        __m256d is_large = _mm256_and_pd(
            is_finite, _mm256_and_pd(_mm256_cmp_pd(value, large_from, _CMP_GE_OQ),
                                     _mm256_cmp_pd(value, large_to, _CMP_LT_OQ)));
        having = _mm256_sub_epi64(having, has);
        finite = _mm256_sub_epi64(finite, _mm256_castpd_si256(is_finite));
        large = _mm256_sub_epi64(large, _mm256_castpd_si256(is_large));
        lowest = _mm256_min_pd(lowest, _mm256_blendv_pd(infinity, value, is_finite));
        highest = _mm256_max_pd(highest, _mm256_blendv_pd(_mm256_or_pd(infinity, sign), value, is_finite));
    }
    double low[4], high[4];
    int64_t counts[3][4];
    _mm256_storeu_pd(low, lowest);
    _mm256_storeu_pd(high, highest);
    _mm256_storeu_si256((__m256i *)counts[0], having);
    _mm256_storeu_si256((__m256i *)counts[1], finite);
    _mm256_storeu_si256((__m256i *)counts[2], large);
    for (int i = 0; i < 4; i++) {
        span->lowest = low[i] < span->lowest ? low[i] : span->lowest;
        span->highest = high[i] > span->highest ? high[i] : span->highest;
        span->points += counts[0][i];
        span->finite += counts[1][i];
        span->large += counts[2][i];
    }
    return done;
}

__attribute__((target("avx2")))
static size_t avx2_extend_span(const char *points, size_t step, size_t count, ptrdiff_t xyz,
                               const struct TimeSource *time, struct FieldSpan *span)
{
    if (time->number == 7)
        return span_of_floats(points, step, count, xyz, time->offset, 7, span);
    if (time->number == 8)
        return span_of_floats(points, step, count, xyz, time->offset, 8, span);
    if (time->number == 5)
        return span_of_floats(points, step, count, xyz, time->offset, 5, span);
    if (time->number == 6)
        return span_of_floats(points, step, count, xyz, time->offset, 6, span);
    return 0;
}

/* Called with constant types of the time, so that the loop has no branch for it. Stops at a point whose
   time is not between the knots. */
__attribute__((target("avx2,fma"), always_inline))
static inline size_t move_floats(char *points, size_t step, size_t count, const ptrdiff_t xyz,
                                 const struct TimeSource *time, int number, const struct PoseKnots *knots)
{
    size_t knot = 0;
    double begin = 0.0, end = 0.0, minus = time->minus, times = time->times, plus = time->plus;
    __m256d pose0, pose1, pose2, pose3, slope0, slope1, slope2, slope3;
    pose0 = pose1 = pose2 = pose3 = slope0 = slope1 = slope2 = slope3 = _mm256_setzero_pd();
    for (size_t i = 0; i < count; i++, points += step) {
        double after = load_time(points + time->offset, number);
        if (number == 8)  /* of the others, minus is 0 */
            after -= minus;
        after = __builtin_fma(after, times, plus);
        if (!(after >= begin && after < end)) {
            if (!knots_include(knots, after))
                return i;
            /* Most points follow each other in time, so the next knot is tried before a search. */
            if (knot + 1 < knots->last && after >= knots->ns[knot + 1] && after < knots->ns[knot + 2])
                knot++;
            else
                knot = knot_before(knots, after);
            const double *pose = knots->columns + 16 * knot, *slope = knots->slopes + 16 * knot;
            pose0 = _mm256_loadu_pd(pose), slope0 = _mm256_loadu_pd(slope);
            pose1 = _mm256_loadu_pd(pose + 4), slope1 = _mm256_loadu_pd(slope + 4);
            pose2 = _mm256_loadu_pd(pose + 8), slope2 = _mm256_loadu_pd(slope + 8);
            pose3 = _mm256_loadu_pd(pose + 12), slope3 = _mm256_loadu_pd(slope + 12);
            begin = knots->ns[knot];
            end = knot < knots->last ? knots->ns[knot + 1] : begin;
            if (after < begin)  /* by rounding */
                after = begin;
        }
        /* Fused, as in the plain loop, because these operations take most of the time. */
        __m256d part = _mm256_set1_pd(after - begin);
        __m256d column0 = _mm256_fmadd_pd(part, slope0, pose0);
        __m256d column1 = _mm256_fmadd_pd(part, slope1, pose1);
        __m256d column2 = _mm256_fmadd_pd(part, slope2, pose2);
        __m256d column3 = _mm256_fmadd_pd(part, slope3, pose3);
        __m128 point = _mm_loadu_ps((const float *)(points + xyz));
        __m256d wider = _mm256_cvtps_pd(point);
        __m256d moved = _mm256_fmadd_pd(column2, _mm256_permute4x64_pd(wider, 0xaa), column3);
        moved = _mm256_fmadd_pd(column1, _mm256_permute4x64_pd(wider, 0x55), moved);
        moved = _mm256_fmadd_pd(column0, _mm256_permute4x64_pd(wider, 0x00), moved);
        _mm_storeu_ps((float *)(points + xyz), _mm_blend_ps(_mm256_cvtpd_ps(moved), point, 8));
    }
    return count;
}

__attribute__((target("avx2,fma")))
static size_t avx2_move_floats(char *points, size_t step, size_t count, ptrdiff_t xyz,
                               const struct TimeSource *time, const struct PoseKnots *knots)
{
    if (time->number == 7)
        return move_floats(points, step, count, xyz, time, 7, knots);
    if (time->number == 8)
        return move_floats(points, step, count, xyz, time, 8, knots);
    if (time->number == 5)
        return move_floats(points, step, count, xyz, time, 5, knots);
    if (time->number == 6)
        return move_floats(points, step, count, xyz, time, 6, knots);
    return 0;
}

#define avx2_is_supported() (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))

#else
#define avx2_is_supported() 0
#define avx2_floats(source, step, target, target_step, count, matrix, translation) ((size_t)0)
#define avx2_doubles(source, step, target, target_step, count, matrix, translation) ((size_t)0)
#define avx2_extend_span(points, step, count, xyz, time, span) ((size_t)0)
#define avx2_move_floats(points, step, count, xyz, time, knots) ((size_t)0)
#endif

"""Triples of coordinates transformed with the widest vector registers that the machine has.

Products and sums are those of the plain loop, in double precision and in the same order: same bits.
"""

cdef extern from *:
    """
    #include <stddef.h>

    #if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
    #include <immintrin.h>

    #define WIDE_ROW(k) \\
        _mm512_cvtpd_ps(_mm512_add_pd(_mm512_add_pd(_mm512_add_pd( \\
            _mm512_mul_pd(m[3 * k], x), _mm512_mul_pd(m[3 * k + 1], y)), \\
            _mm512_mul_pd(m[3 * k + 2], z)), t[k]))

    __attribute__((target("avx512f"))) static inline __m512 wide_gather(const char *place, size_t step)
    {
        __m512 four = _mm512_castps128_ps512(_mm_loadu_ps((const float *)place));
        four = _mm512_insertf32x4(four, _mm_loadu_ps((const float *)(place + step)), 1);
        four = _mm512_insertf32x4(four, _mm_loadu_ps((const float *)(place + 2 * step)), 2);
        return _mm512_insertf32x4(four, _mm_loadu_ps((const float *)(place + 3 * step)), 3);
    }

    __attribute__((target("avx512f"))) static inline void wide_scatter(char *place, size_t step, __m512 four)
    {
        _mm_storeu_ps((float *)place, _mm512_castps512_ps128(four));
        _mm_storeu_ps((float *)(place + step), _mm512_extractf32x4_ps(four, 1));
        _mm_storeu_ps((float *)(place + 2 * step), _mm512_extractf32x4_ps(four, 2));
        _mm_storeu_ps((float *)(place + 3 * step), _mm512_extractf32x4_ps(four, 3));
    }

    /* Eight points at a time, in two registers: x y z w of each, w being what follows z; or, where points
       of 12 bytes leave no w, in one and a half. Steps are alike, or the target's is 12. */
    __attribute__((target("avx512f")))
    static size_t wide_eight(const char *source, size_t step, char *target, size_t target_step, size_t count,
                             const double *matrix, const double *translation)
    {
        __m512d m[9], t[3];
        int split[2][16], join[2][16];
        int floats = step == 12 ? 3 : 4, target_floats = target_step == 12 ? 3 : 4;
        __mmask16 second = floats == 3 ? 0x00ff : 0xffff;
        __mmask16 target_second = target_floats == 3 ? 0x00ff : 0xffff;
        size_t done;
        for (int i = 0; i < 9; i++) m[i] = _mm512_set1_pd(matrix[i]);
        for (int i = 0; i < 3; i++) t[i] = _mm512_set1_pd(translation[i]);
        for (int i = 0; i < 8; i++) {
            /* To x0..x7 y0..y7 and z0..z7 w0..w7. */
            split[0][i] = floats * i;
            split[0][8 + i] = floats * i + 1;
            split[1][i] = floats * i + 2;
            split[1][8 + i] = floats == 4 ? floats * i + 3 : 0;
        }
        for (int i = 0; i < 32; i++)
            join[i / 16][i % 16] = i < 8 * target_floats ? 8 * (i % target_floats) + i / target_floats : 0;
        __m512i split_xy = _mm512_loadu_si512(split[0]), split_zw = _mm512_loadu_si512(split[1]);
        __m512i join_first = _mm512_loadu_si512(join[0]), join_second = _mm512_loadu_si512(join[1]);
        for (done = 0; done + 8 <= count; done += 8, source += 8 * step, target += 8 * target_step) {
            __m512 a, b;
            if (step > 16) {
                a = wide_gather(source, step);
                b = wide_gather(source + 4 * step, step);
            } else {
                a = _mm512_loadu_ps(source);
                b = _mm512_maskz_loadu_ps(second, source + 64);
            }
            __m512 xy = _mm512_permutex2var_ps(a, split_xy, b);
            __m512 zw = _mm512_permutex2var_ps(a, split_zw, b);
            __m256 upper = _mm256_castpd_ps(_mm512_extractf64x4_pd(_mm512_castps_pd(xy), 1));
            __m512d x = _mm512_cvtps_pd(_mm512_castps512_ps256(xy));
            __m512d y = _mm512_cvtps_pd(upper);
            __m512d z = _mm512_cvtps_pd(_mm512_castps512_ps256(zw));
            __m512d lower = _mm512_castps_pd(_mm512_castps256_ps512(WIDE_ROW(0)));
            xy = _mm512_castpd_ps(_mm512_insertf64x4(lower, _mm256_castps_pd(WIDE_ROW(1)), 1));
            lower = _mm512_castps_pd(zw);
            zw = _mm512_castpd_ps(_mm512_insertf64x4(lower, _mm256_castps_pd(WIDE_ROW(2)), 0));
            a = _mm512_permutex2var_ps(xy, join_first, zw);
            b = _mm512_permutex2var_ps(xy, join_second, zw);
            if (target_step > 16) {
                wide_scatter(target, target_step, a);
                wide_scatter(target + 4 * target_step, target_step, b);
            } else {
                _mm512_storeu_ps(target, a);
                _mm512_mask_storeu_ps(target + 64, target_second, b);
            }
        }
        return done;
    }

    /* One point at a time, as x y z w; w, whatever it is, is written as it was read. */
    #define WIDE_COLUMNS \\
        __m256d column0 = _mm256_setr_pd(matrix[0], matrix[3], matrix[6], 0.0); \\
        __m256d column1 = _mm256_setr_pd(matrix[1], matrix[4], matrix[7], 0.0); \\
        __m256d column2 = _mm256_setr_pd(matrix[2], matrix[5], matrix[8], 0.0); \\
        __m256d column3 = _mm256_setr_pd(translation[0], translation[1], translation[2], 0.0)
    #define WIDE_POINT(point) \\
        _mm256_add_pd(_mm256_add_pd(_mm256_add_pd( \\
            _mm256_mul_pd(column0, _mm256_permute4x64_pd(point, 0x00)), \\
            _mm256_mul_pd(column1, _mm256_permute4x64_pd(point, 0x55))), \\
            _mm256_mul_pd(column2, _mm256_permute4x64_pd(point, 0xaa))), column3)

    __attribute__((target("avx2")))
    static size_t wide_floats(const char *source, size_t step, char *target, size_t target_step,
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
    static size_t wide_doubles(const char *source, size_t step, char *target, size_t target_step,
                               size_t count, const double *matrix, const double *translation)
    {
        WIDE_COLUMNS;
        for (size_t i = 0; i < count; i++, source += step, target += target_step) {
            __m256d point = _mm256_loadu_pd((const double *)source);
            _mm256_storeu_pd((double *)target, _mm256_blend_pd(WIDE_POINT(point), point, 8));
        }
        return count;
    }

    static size_t wide_transform_floats(const char *source, size_t step, char *target, size_t target_step,
                                        size_t count, const double *matrix, const double *translation)
    {
        if ((step == 12 || step >= 16) && __builtin_cpu_supports("avx512f"))
            return wide_eight(source, step, target, target_step, count, matrix, translation);
        if (__builtin_cpu_supports("avx2"))
            return wide_floats(source, step, target, target_step, count, matrix, translation);
        return 0;
    }

    static size_t wide_transform_doubles(const char *source, size_t step, char *target, size_t target_step,
                                         size_t count, const double *matrix, const double *translation)
    {
        if (__builtin_cpu_supports("avx2"))
            return wide_doubles(source, step, target, target_step, count, matrix, translation);
        return 0;
    }

    #else
    #define wide_transform_floats(source, step, target, target_step, count, matrix, translation) ((size_t)0)
    #define wide_transform_doubles(source, step, target, target_step, count, matrix, translation) ((size_t)0)
    #endif
    """
    # x y z beside each other, of this machine's byte order, at the start of each of `count` points that do
    # not overlap. Where the steps are alike, `source` and `target` may be the same; otherwise `target_step`
    # is that of three numbers. The bytes after the last z, as many as a number has, must be there in both;
    # in the target they are written as they were read.
    # How many points were done, from the first on; 0 where the machine has no wide registers.
    size_t wide_transform_floats(const char* source, size_t step, char* target, size_t target_step,
                                 size_t count, const double* matrix, const double* translation) noexcept nogil
    size_t wide_transform_doubles(const char* source, size_t step, char* target, size_t target_step,
                                  size_t count, const double* matrix,
                                  const double* translation) noexcept nogil

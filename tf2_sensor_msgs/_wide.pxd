"""Transform triples of coordinates with the vector registers of AVX2.

Products and sums are those of the plain loop, in double precision and in the same order: the same bits.
"""

cdef extern from *:
    """
    #include <stddef.h>

    #if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
    #include <immintrin.h>

    /* One point at a time, as x y z w; w is written as it was read. */
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
    # x y z lie beside each other, in this machine's byte order, at the start of each of `count` points that
    # do not overlap. `source` and `target` may be the same if the steps are equal; otherwise `target_step` is
    # that of three numbers. After the last z, as many bytes as a number has must be accessible in both; in
    # the target they are written as they were read.
    # Returns how many points were done, from the first on; 0 if the machine has no AVX2.
    size_t wide_transform_floats(const char* source, size_t step, char* target, size_t target_step,
                                 size_t count, const double* matrix, const double* translation) noexcept nogil
    size_t wide_transform_doubles(const char* source, size_t step, char* target, size_t target_step,
                                  size_t count, const double* matrix,
                                  const double* translation) noexcept nogil

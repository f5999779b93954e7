/*
 * Holds a thread that moves a long history, or fails it, until a test's program lets it go on.
 *
 * Loaded with LD_PRELOAD. The program sets the variables below, by ctypes.
 */
#define _GNU_SOURCE
#include <errno.h>
#include <stddef.h>
#include <time.h>

enum { HELD_S = 60 };

volatile long held_bytes;       /* the next allocation of this size or more is held; 0: none */
volatile long fails;            /* and fails then */
volatile long is_held;
volatile long goes_on;
volatile long gave_up;          /* nobody let it go on */

extern void *__libc_memalign(size_t, size_t);

void *aligned_alloc(size_t alignment, size_t size)
{
    const struct timespec pause = {.tv_nsec = 1000000};
    if (held_bytes == 0 || size < (size_t)held_bytes)
        return __libc_memalign(alignment, size);
    held_bytes = 0;
    __atomic_store_n(&is_held, 1, __ATOMIC_SEQ_CST);
    for (long left = HELD_S * 1000; !__atomic_load_n(&goes_on, __ATOMIC_SEQ_CST) && !gave_up; --left) {
        nanosleep(&pause, NULL);
        gave_up = left == 0;
    }
    __atomic_store_n(&is_held, 0, __ATOMIC_SEQ_CST);
    if (!fails)
        return __libc_memalign(alignment, size);
    errno = ENOMEM;
    return NULL;
}

"""Sleep on words in memory that processes share, and give back what a file takes."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t

cdef extern from * nogil:
    """
    #include <fcntl.h>
    #include <linux/falloc.h>
    #include <linux/futex.h>
    #include <stdint.h>
    #include <sys/syscall.h>
    #include <time.h>
    #include <unistd.h>

    static void tf2_give_back(int descriptor, size_t start, size_t size)
    {
        /* A kernel that cannot do this keeps the memory, which does no harm. */
        (void)!fallocate(descriptor, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)start, (off_t)size);
    }

    static void tf2_futex_wake(const void *word)
    {
        syscall(SYS_futex, word, FUTEX_WAKE, 0x7fffffff, NULL, NULL, 0);
    }

    static void tf2_futex_wait(const void *word, uint32_t seen, int64_t ns)
    {
        struct timespec duration = {.tv_sec = ns / 1000000000, .tv_nsec = ns % 1000000000};
        syscall(SYS_futex, word, FUTEX_WAIT, seen, &duration, NULL, 0);
    }
    """
    void give_back "tf2_give_back"(int descriptor, size_t start, size_t size)
    # Of words in mapped memory. Waiting ends at once if the word is not the one that was seen.
    void futex_wake "tf2_futex_wake"(const void* word)
    void futex_wait "tf2_futex_wait"(const void* word, uint32_t seen, int64_t ns)

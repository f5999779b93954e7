"""Map, read, write and sleep on a file in memory."""

from libc.stddef cimport size_t
from libc.stdint cimport int64_t, uint32_t, uint64_t

cdef extern from * nogil:
    """
    #include <errno.h>
    #include <fcntl.h>
    #include <linux/falloc.h>
    #include <linux/futex.h>
    #include <stdint.h>
    #include <sys/mman.h>
    #include <sys/syscall.h>
    #include <sys/uio.h>
    #include <time.h>
    #include <unistd.h>

    static int tf2_commit(int descriptor, size_t start, size_t size)
    {
        int result;
        do
            result = posix_fallocate(descriptor, (off_t)start, (off_t)size);
        while (result == EINTR);
        return result ? -1 : 0;
    }

    static void tf2_give_back(int descriptor, size_t start, size_t size)
    {
        /* A kernel that cannot do this keeps the memory, which does no harm. */
        (void)!fallocate(descriptor, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, (off_t)start, (off_t)size);
    }

    static int tf2_read(int descriptor, void *to, size_t size, size_t start)
    {
        return pread(descriptor, to, size, (off_t)start) == (ssize_t)size ? 0 : -1;
    }

    static int tf2_write(int descriptor, const void *first, size_t first_size, const void *second,
                         size_t second_size, const void *third, size_t third_size, size_t start)
    {
        struct iovec parts[3] = {
            {(void *)first, first_size}, {(void *)second, second_size}, {(void *)third, third_size}};
        ssize_t size = (ssize_t)(first_size + second_size + third_size);
        return pwritev(descriptor, parts, 3, (off_t)start) == size ? 0 : -1;
    }

    static void tf2_futex_wake(const void *word)
    {
        syscall(SYS_futex, word, FUTEX_WAKE, 0x7fffffff, NULL, NULL, 0);
    }

    static void tf2_futex_wait(const void *word, uint32_t seen, int64_t ns)
    {
        struct timespec duration = {.tv_sec = ns / 1000000000, .tv_nsec = ns % 1000000000};
        if (ns > 0)
            syscall(SYS_futex, word, FUTEX_WAIT, seen, &duration, NULL, 0);
    }

    static int64_t tf2_coarse_ns(void)
    {
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC_COARSE, &now);
        return now.tv_sec * (int64_t)1000000000 + now.tv_nsec;
    }

    #define TF2_MAPPED_BYTES 4096

    static void *tf2_map(int descriptor)
    {
        void *made = mmap(NULL, TF2_MAPPED_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
        return made == MAP_FAILED ? NULL : made;
    }

    static void tf2_unmap(void *base)
    {
        if (base)
            munmap(base, TF2_MAPPED_BYTES);
    }

    #define TF2_LOAD64(place) __atomic_load_n(place, __ATOMIC_ACQUIRE)
    #define TF2_STORE64(place, value) __atomic_store_n(place, value, __ATOMIC_RELEASE)
    #define TF2_FENCE() __atomic_thread_fence(__ATOMIC_SEQ_CST)
    """
    const size_t MAPPED_BYTES "TF2_MAPPED_BYTES"
    int errno

    # These three return 0; or -1 if it was not possible, or only for a part of the bytes.
    int commit_file "tf2_commit"(int descriptor, size_t start, size_t size)
    int read_file "tf2_read"(int descriptor, void* to, size_t size, size_t start)
    int write_file "tf2_write"(int descriptor, const void* first, size_t first_size, const void* second,
                               size_t second_size, const void* third, size_t third_size, size_t start)
    void give_back "tf2_give_back"(int descriptor, size_t start, size_t size)
    int close_file "close"(int descriptor)

    # Maps the first MAPPED_BYTES of a file, which nobody may truncate to less; NULL: see errno.
    void* map_file "tf2_map"(int descriptor)
    void unmap_file "tf2_unmap"(void* base)             # NULL is allowed
    # Of words in mapped memory. With `ns` of 0 or less, do not wait.
    void futex_wake "tf2_futex_wake"(const void* word)
    void futex_wait "tf2_futex_wait"(const void* word, uint32_t seen, int64_t ns)
    int64_t coarse_ns "tf2_coarse_ns"()     # steady time of some milliseconds ago, at a quarter of the cost
    uint64_t load64 "TF2_LOAD64"(const uint64_t* place)
    void store64 "TF2_STORE64"(uint64_t* place, uint64_t value)
    void fence "TF2_FENCE"()

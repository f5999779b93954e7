/*
 * Spoils the sizes in each record of a shared buffer once its head was read, before what follows it is read.
 * A file of a shared buffer is recognised by the place from which is read: behind its first 64 KiB. Where
 * off_t has 64 bits, both names are the same function.
 */

#include <dlfcn.h>
#include <stdint.h>
#include <sys/types.h>
#include <unistd.h>

enum { RING_AT = 1 << 16, SIZES_AT = 32 };

ssize_t pread(int descriptor, void *to, size_t size, off_t start)
{
    static ssize_t (*real)(int, void *, size_t, off_t);
    const uint32_t sizes[2] = {0xFFFFFF00, 0x7FFFFFFF};
    ssize_t count;
    if (real == NULL)
        real = (ssize_t (*)(int, void *, size_t, off_t))dlsym(RTLD_NEXT, "pread");
    count = real(descriptor, to, size, start);
    if (start >= RING_AT && count > SIZES_AT && pwrite(descriptor, sizes, sizeof sizes, start + SIZES_AT) < 0)
        return -1;
    return count;
}

ssize_t pread64(int descriptor, void *to, size_t size, off_t start)
{
    return pread(descriptor, to, size, start);
}

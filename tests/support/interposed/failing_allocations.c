// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/*
 * Owns the memory of a test's program: it counts allocations, and lets chosen ones fail.
 *
 * Loaded with LD_PRELOAD. The program sets the variables below, by ctypes, which allocates nothing.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <link.h>
#include <pthread.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { NOBODY, OURS };

volatile long counted_of = NOBODY;      /* whose allocations are counted */
volatile unsigned long counted_thread;  /* and in which thread, as pthread_self has it; 0: in all */
volatile long counted;                  /* how many there were */
volatile long first_to_fail;            /* counted from 1; 0: none fails */
volatile long last_to_fail;
volatile long failed;                   /* how many failed */
volatile long live;                     /* blocks of malloc and its kin that nobody has freed yet */

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
extern void __libc_free(void *);

#define MOST_OBJECTS 256
static struct { const char *start, *end; } ours[MOST_OBJECTS];
static volatile int ours_count;

static int note_object(struct dl_phdr_info *object, size_t size, void *folders)
{
    (void)size;
    for (char *const *folder = folders; *folder; ++folder) {
        if (!strstr(object->dlpi_name, *folder) || !strstr(object->dlpi_name, ".cpython-"))
            continue;
        for (int j = 0; j < object->dlpi_phnum; ++j) {
            const ElfW(Phdr) *part = &object->dlpi_phdr[j];
            if (part->p_type != PT_LOAD || !(part->p_flags & PF_X) || ours_count == MOST_OBJECTS)
                continue;
            ours[ours_count].start = (const char *)(object->dlpi_addr + part->p_vaddr);
            ours[ours_count].end = ours[ours_count].start + part->p_memsz;
            ++ours_count;
        }
    }
    return 0;
}

/*
 * To be called once all of the project's extension modules are loaded, with parts of their paths and a NULL; how
 * many there are.
 */
int find_ours(char *const *folders)
{
    ours_count = 0;
    dl_iterate_phdr(note_object, (void *)folders);
    return ours_count;
}

static int is_ours(const char *caller)
{
    for (int i = 0; i < ours_count; ++i)
        if (caller >= ours[i].start && caller < ours[i].end)
            return 1;
    return 0;
}

/* Whether this allocation is to fail. */
static int fails(void *caller)
{
    if (counted_of == NOBODY)
        return 0;
    if (counted_thread && counted_thread != (unsigned long)pthread_self())
        return 0;
    if (!is_ours(caller))
        return 0;
    long number = __atomic_add_fetch(&counted, 1, __ATOMIC_RELAXED);
    if (!first_to_fail || number < first_to_fail || number > last_to_fail)
        return 0;
    __atomic_add_fetch(&failed, 1, __ATOMIC_RELAXED);
    errno = ENOMEM;
    return 1;
}

#define CALLER __builtin_return_address(0)

static void *born(void *block)
{
    if (block)
        __atomic_add_fetch(&live, 1, __ATOMIC_RELAXED);
    return block;
}

void *malloc(size_t size)
{
    return fails(CALLER) ? NULL : born(__libc_malloc(size));
}

void *calloc(size_t count, size_t size)
{
    return fails(CALLER) ? NULL : born(__libc_calloc(count, size));
}

void *realloc(void *old, size_t size)
{
    if (fails(CALLER))
        return NULL;
    void *block = __libc_realloc(old, size);
    if (!old)
        return born(block);
    if (!block && !size)
        __atomic_add_fetch(&live, -1, __ATOMIC_RELAXED);
    return block;
}

void *aligned_alloc(size_t alignment, size_t size)
{
    return fails(CALLER) ? NULL : born(__libc_memalign(alignment, size));
}

void free(void *block)
{
    if (block)
        __atomic_add_fetch(&live, -1, __ATOMIC_RELAXED);
    __libc_free(block);
}

void *mmap64(void *at, size_t size, int protection, int flags, int file, off64_t start)
{
    return fails(CALLER) ? MAP_FAILED : (void *)syscall(SYS_mmap, at, size, protection, flags, file, start);
}

// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/*
 * Delays each thread of Python before it begins, as a busy machine may, and the exit of the process until
 * all have begun: a thread that begins after the end of Python uses what was freed.
 *
 * Loaded with LD_PRELOAD. A new thread checks whether Python ends, asks which thread it is, and begins.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define DELAY_US 300000

struct start {
    void *(*run)(void *);
    void *argument;
};

static __thread int is_new;

static void *run_late(void *given)
{
    struct start start = *(struct start *)given;
    free(given);
    is_new = 1;
    return start.run(start.argument);
}

pthread_t pthread_self(void)
{
    static pthread_t (*volatile next)(void);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "pthread_self");
    if (is_new) {
        is_new = 0;
        usleep(DELAY_US);
    }
    return next();
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*run)(void *), void *argument)
{
    static int (*volatile next)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
    struct start *start;
    Dl_info python;
    int result;
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "pthread_create");
    /* In the program or the library of Python, not in a package. */
    if (!dladdr((void *)run, &python) || !python.dli_fname || !strstr(python.dli_fname, "python")
            || strstr(python.dli_fname, "-packages/") || !(start = malloc(sizeof *start)))
        return next(thread, attributes, run, argument);
    start->run = run;
    start->argument = argument;
    result = next(thread, attributes, run_late, start);
    if (result)
        free(start);
    return result;
}

static void __attribute__((destructor)) wait_for_late_threads(void)
{
    usleep(3 * DELAY_US);
}

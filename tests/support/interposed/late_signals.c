// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/*
 * Delays the thread in which rclpy handles a signal, as a busy machine may: each time it has woken an executor.
 *
 * Loaded with LD_PRELOAD. It is the thread that waits for rclpy's own semaphore.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <semaphore.h>
#include <string.h>
#include <unistd.h>

#define DELAY_US 200000

static __thread int handles_signals;

int sem_wait(sem_t *semaphore)
{
    static int (*volatile next)(sem_t *);
    int result;
    Dl_info caller;
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "sem_wait");
    result = next(semaphore);
    if (dladdr(__builtin_return_address(0), &caller) && caller.dli_fname
            && strstr(caller.dli_fname, "_rclpy_pybind11"))
        handles_signals = 1;
    return result;
}

int rcl_trigger_guard_condition(void *condition)
{
    static int (*volatile next)(void *);
    int result;
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "rcl_trigger_guard_condition");
    if (!next)      /* loaded by Python, for its own use */
        *(void **)&next = dlsym(dlopen("librcl.so", RTLD_LAZY | RTLD_NOLOAD), "rcl_trigger_guard_condition");
    result = next(condition);
    if (handles_signals)
        usleep(DELAY_US);
    return result;
}

// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/*
 * Owns the time of day of a test's program: it can be set, and what waits until a time of day follows.
 *
 * Loaded with LD_PRELOAD. The program sets the variables below, by ctypes. The other clocks stay as they are.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define NS 1000000000L

volatile long wall_offset_ns;       /* added to the time of day */
volatile long steady_offset_ns;     /* added to the steady clock, for programs in which nothing waits */

static struct timespec moved(const struct timespec *time, long ns)
{
    struct timespec result = *time;
    result.tv_sec += ns / NS;
    result.tv_nsec += ns % NS;
    if (result.tv_nsec < 0) {
        result.tv_nsec += NS;
        result.tv_sec -= 1;
    } else if (result.tv_nsec >= NS) {
        result.tv_nsec -= NS;
        result.tv_sec += 1;
    }
    if (result.tv_sec < 0)
        result.tv_sec = result.tv_nsec = 0;
    return result;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    if (syscall(SYS_clock_gettime, clock, now) != 0)
        return -1;
    if (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE)
        *now = moved(now, wall_offset_ns);
    if (clock == CLOCK_MONOTONIC)
        *now = moved(now, steady_offset_ns);
    return 0;
}

/* The clock of Fast DDS: its threads spin if it disagrees with the waits below. */
int gettimeofday(struct timeval *now, void *zone)
{
    struct timespec time;
    (void)zone;
    clock_gettime(CLOCK_REALTIME, &time);
    now->tv_sec = time.tv_sec;
    now->tv_usec = time.tv_nsec / 1000;
    return 0;
}

time_t time(time_t *result)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (result)
        *result = now.tv_sec;
    return now.tv_sec;
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until)
{
    static int (*volatile next)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);
    /* Which clock the condition is of cannot be asked; since it started, no machine has run for 20 years. */
    struct timespec real = moved(until, until->tv_sec > 20L * 366 * 86400 ? -wall_offset_ns : 0);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "pthread_cond_timedwait");
    return next(condition, mutex, &real);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until)
{
    static int (*volatile next)(sem_t *, const struct timespec *);
    struct timespec real = moved(until, -wall_offset_ns);
    if (!next)
        *(void **)&next = dlsym(RTLD_NEXT, "sem_timedwait");
    return next(semaphore, &real);
}

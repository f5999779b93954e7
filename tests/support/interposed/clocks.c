/*
 * Owns the time of day of a test's program: it can be set, and sleeping until a time of day follows.
 *
 * Loaded with LD_PRELOAD. The program sets the variable below, by ctypes. The other clocks stay as they are.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <pthread.h>
#include <semaphore.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define NS 1000000000L

volatile long wall_offset_ns;       /* added to the time of day */

static long offset_of(clockid_t clock)
{
    return clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE ? wall_offset_ns : 0;
}

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
    *now = moved(now, offset_of(clock));
    return 0;
}

int clock_nanosleep(clockid_t clock, int flags, const struct timespec *until, struct timespec *left)
{
    struct timespec real = flags & TIMER_ABSTIME ? moved(until, -offset_of(clock)) : *until;
    return syscall(SYS_clock_nanosleep, clock, flags, &real, left) ? errno : 0;
}

/* The function of this name that these stand before. */
#define NEXT(name) ((__typeof__(&name))next_##name())
#define DEFINE_NEXT(name)                                   \
    static void *next_##name(void)                          \
    {                                                       \
        static void *volatile found;                        \
        if (!found)                                         \
            found = dlsym(RTLD_NEXT, #name);                \
        return found;                                       \
    }
DEFINE_NEXT(pthread_cond_timedwait)
DEFINE_NEXT(pthread_cond_clockwait)
DEFINE_NEXT(sem_timedwait)
DEFINE_NEXT(sem_clockwait)

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until)
{
    /* Which clock the condition is of cannot be asked; since it started, no machine has run for 20 years. */
    struct timespec real = moved(until, until->tv_sec > 20L * 366 * 86400 ? -wall_offset_ns : 0);
    return NEXT(pthread_cond_timedwait)(condition, mutex, &real);
}

int pthread_cond_clockwait(pthread_cond_t *condition, pthread_mutex_t *mutex, clockid_t clock,
                           const struct timespec *until)
{
    struct timespec real = moved(until, -offset_of(clock));
    return NEXT(pthread_cond_clockwait)(condition, mutex, clock, &real);
}

int sem_timedwait(sem_t *semaphore, const struct timespec *until)
{
    struct timespec real = moved(until, -wall_offset_ns);
    return NEXT(sem_timedwait)(semaphore, &real);
}

int sem_clockwait(sem_t *semaphore, clockid_t clock, const struct timespec *until)
{
    struct timespec real = moved(until, -offset_of(clock));
    return NEXT(sem_clockwait)(semaphore, clock, &real);
}

// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/*
 * Ends a process at its SIGALRM, and says where in C the thread stands that gets it: the main thread.
 *
 * Loaded with LD_PRELOAD. No code in Python, which a thread that holds the GIL would keep from running.
 */
#define _GNU_SOURCE
#include <execinfo.h>
#include <signal.h>
#include <unistd.h>

#define MOST_FRAMES 64

static void say(int number)
{
    void *frames[MOST_FRAMES];
    (void)number;
    backtrace_symbols_fd(frames, backtrace(frames, MOST_FRAMES), STDERR_FILENO);
    _exit(1);
}

__attribute__((constructor)) static void begin(void)
{
    void *frame;
    backtrace(&frame, 1);   /* it allocates when it is called for the first time */
    signal(SIGALRM, say);
}

// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/*
 * A middleware that cannot do everything. The environment variable TF2_TEST_MIDDLEWARE says what is wrong with it:
 *
 * - "no_arrivals": it does not report that a message has arrived;
 * - "two_reports": it reports each message twice, as others also report what is no message;
 * - "no_gids": the publisher's gid that comes with a message is zero;
 * - "local_gids": that gid is not the one by which the graph knows the publisher;
 * - "no_times": the time at which a message was received is zero;
 * - "no_memory_once": there is no memory for the first message that is taken, which is lost;
 * - "no_loss_events": it has no event that says that messages were lost;
 * - "times_of_taking": that time is the one at which the message is taken.
 *
 * Loaded with LD_PRELOAD: rcl calls these functions of rmw, which call those of the real middleware.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { RMW_RET_UNSUPPORTED = 3, RMW_RET_BAD_ALLOC = 10, GID_SIZE = 16, MESSAGE_LOST = 3 };

/* rmw_message_info_t. */
typedef struct {
    int64_t source_timestamp, received_timestamp;
    uint64_t publication_sequence_number, reception_sequence_number;
    const char *implementation_identifier;
    uint8_t gid[GID_SIZE];
} message_info;

static bool has(const char *fault)
{
    const char *given = getenv("TF2_TEST_MIDDLEWARE");
    return given && strcmp(given, fault) == 0;
}

/* A function of the libraries that rcl is linked with, which RTLD_NEXT does not search. */
static void *function_of_rcl(const char *name)
{
    return dlsym(dlopen("librcl.so", RTLD_LAZY | RTLD_NOLOAD), name);
}

typedef void arrived(const void *, size_t);

typedef struct {
    arrived *callback;
    const void *data;
} reported;

static void report_twice(const void *data, size_t count)
{
    const reported *to = data;
    to->callback(to->data, 2 * count);
}

int rmw_subscription_set_on_new_message_callback(void *subscription, arrived *callback, const void *data)
{
    if (has("no_arrivals")) {
        void (*set_error)(const char *, const char *, size_t);
        *(void **)&set_error = function_of_rcl("rcutils_set_error_state");
        set_error("not supported", __FILE__, __LINE__);
        return RMW_RET_UNSUPPORTED;
    }
    int (*next)(void *, arrived *, const void *);
    *(void **)&next = function_of_rcl(__func__);
    if (has("two_reports") && callback) {
        reported *to = malloc(sizeof *to); /* for ever, because a call may be running */
        *to = (reported){callback, data};
        return next(subscription, report_twice, to);
    }
    return next(subscription, callback, data);
}

int rmw_subscription_event_init(void *event, const void *subscription, int kind)
{
    if (has("no_loss_events") && kind == MESSAGE_LOST) {
        void (*set_error)(const char *, const char *, size_t);
        *(void **)&set_error = function_of_rcl("rcutils_set_error_state");
        set_error("not supported", __FILE__, __LINE__);
        return RMW_RET_UNSUPPORTED;
    }
    int (*next)(void *, const void *, int);
    *(void **)&next = function_of_rcl(__func__);
    return next(event, subscription, kind);
}

int rmw_take_serialized_message_with_info(const void *subscription, void *message, bool *taken, message_info *info,
                                          void *allocation)
{
    int (*next)(const void *, void *, bool *, message_info *, void *);
    *(void **)&next = function_of_rcl(__func__);
    int result = next(subscription, message, taken, info, allocation);
    static bool has_failed;
    if (has("no_memory_once") && *taken && !has_failed) {
        has_failed = true;
        *taken = false;
        return RMW_RET_BAD_ALLOC;
    }
    if (has("no_gids"))
        memset(info->gid, 0, GID_SIZE);
    if (has("local_gids"))
        for (int i = 0; i < GID_SIZE / 2; ++i) {
            info->gid[i] ^= info->gid[GID_SIZE / 2 + i];
            info->gid[GID_SIZE / 2 + i] = 0;
        }
    if (has("no_times"))
        info->received_timestamp = 0;
    if (has("times_of_taking")) {
        struct timespec now;
        clock_gettime(CLOCK_REALTIME, &now);
        info->received_timestamp = now.tv_sec * 1000000000L + now.tv_nsec;
    }
    return result;
}

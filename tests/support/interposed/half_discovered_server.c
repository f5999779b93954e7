// SPDX-FileCopyrightText: tf2-ros-cython contributors
// SPDX-License-Identifier: BSD-3-Clause

/*
 * Action servers and clients that have discovered each other in part. The first two responses to goals, and the
 * first two with results, are dropped, as by a server that has not discovered its client yet. Every other time
 * the server seems unavailable, as if another one of its name were half discovered: Fast DDS compares the number
 * of request topics with the number of response topics.
 *
 * Loaded with LD_PRELOAD.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdbool.h>

typedef int Send(const void *, void *, void *);
typedef int Check(const void *, const void *, bool *);

static void find(void *function, const char *name)
{
    void **found = function;
    *found = dlsym(RTLD_NEXT, name);
    if (!*found)      /* loaded by Python, for its own use */
        *found = dlsym(dlopen("librcl_action.so", RTLD_LAZY | RTLD_NOLOAD), name);
}

static int send_unless(int *dropped, const char *name, const void *server, void *header, void *response)
{
    Send *next;
    if (++*dropped <= 2)
        return 0;
    find(&next, name);
    return next(server, header, response);
}

int rcl_action_send_goal_response(const void *server, void *header, void *response)
{
    static int dropped;
    return send_unless(&dropped, "rcl_action_send_goal_response", server, header, response);
}

int rcl_action_send_result_response(const void *server, void *header, void *response)
{
    static int dropped;
    return send_unless(&dropped, "rcl_action_send_result_response", server, header, response);
}

int rcl_action_server_is_available(const void *node, const void *client, bool *is_available)
{
    static int checks;
    Check *next;
    int code;
    find(&next, "rcl_action_server_is_available");
    code = next(node, client, is_available);
    if (checks++ % 2)
        *is_available = false;
    return code;
}

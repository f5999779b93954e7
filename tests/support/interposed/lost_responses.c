/*
 * Drops the first two responses of action servers to goals, and the first two of results, as a middleware does
 * whose server has not discovered the client yet.
 *
 * Loaded with LD_PRELOAD.
 */
#define _GNU_SOURCE
#include <dlfcn.h>

typedef int Send(const void *, void *, void *);

static int send_unless(int *dropped, const char *name, const void *server, void *header, void *response)
{
    Send *next;
    if (++*dropped <= 2)
        return 0;
    *(void **)&next = dlsym(RTLD_NEXT, name);
    if (!next)      /* loaded by Python, for its own use */
        *(void **)&next = dlsym(dlopen("librcl_action.so", RTLD_LAZY | RTLD_NOLOAD), name);
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

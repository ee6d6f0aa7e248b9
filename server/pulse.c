/* pulse.c - see pulse.h. */
#include "pulse.h"

#include <errno.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <microhttpd.h>

#include "clock.h"

/* The connection is made anew so often. For when the library has run out of descriptors it does not accept
 * again until a connection closes, and this one may be all it has. */
#define RENEW_MS 1000

static const char question[] = "GET /pulse HTTP/1.1\r\nHost: pulse\r\n\r\n";

struct pulse {
    int ours;        /* -1: not connected */
    bool asked;      /* and not answered yet */
    int64_t made_ms; /* monotonic; when the pair was made */
    unsigned answers;
    _Atomic int64_t answered_ms;
};

struct pulse *pulse_new(void)
{
    struct pulse *pulse = calloc(1, sizeof *pulse);
    if (pulse == NULL)
        return NULL;
    pulse->ours = -1;
    atomic_store(&pulse->answered_ms, clock_monotonic_ms());
    return pulse;
}

static void hang_up(struct pulse *pulse)
{
    if (pulse->ours >= 0)
        close(pulse->ours);
    pulse->ours = -1;
    pulse->asked = false;
}

struct pulse *pulse_free(struct pulse *pulse)
{
    if (pulse != NULL)
        hang_up(pulse);
    free(pulse);
    return NULL;
}

/* Where there is no descriptor, no memory or no place for another, the old pair goes on. */
static void connect_pair(struct pulse *pulse, struct MHD_Daemon *daemon)
{
    /* By which it is known: what is accepted has a family. Not by its descriptor, which another connection
     * has as soon as the library closes one that it does not take. */
    static const struct sockaddr nowhere = {.sa_family = AF_UNSPEC};
    int pair[2];
    pulse->made_ms = clock_monotonic_ms();
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0, pair) != 0)
        return;
    if (MHD_add_connection(daemon, pair[1], &nowhere, sizeof nowhere) != MHD_YES) {
        close(pair[0]); /* the library has closed the other one */
        return;
    }
    hang_up(pulse);
    pulse->ours = pair[0];
}

/* A connection that the library has closed, for it was idle while we slept, is made again. */
static void take_answer(struct pulse *pulse)
{
    char answer[1024];
    ssize_t n = recv(pulse->ours, answer, sizeof answer, 0);
    if (n > 0) {
        atomic_store(&pulse->answered_ms, clock_monotonic_ms());
        pulse->asked = false;
        pulse->answers++;
    } else if (n == 0 || (errno != EAGAIN && errno != EINTR)) {
        hang_up(pulse);
    }
}

void pulse_tick(struct pulse *pulse, struct MHD_Daemon *daemon)
{
    if (pulse->ours >= 0)
        take_answer(pulse);
    if (pulse->ours < 0 || (!pulse->asked && clock_monotonic_ms() - pulse->made_ms >= RENEW_MS))
        connect_pair(pulse, daemon);
    if (pulse->ours >= 0 && !pulse->asked)
        pulse->asked = send(pulse->ours, question, sizeof question - 1, MSG_NOSIGNAL) > 0;
}

int64_t pulse_answered_ms(const struct pulse *pulse)
{
    return atomic_load(&pulse->answered_ms);
}

unsigned pulse_answers(const struct pulse *pulse)
{
    return pulse->answers;
}

bool pulse_connection(struct pulse *pulse, struct MHD_Connection *mhd, void **socket_context,
                      enum MHD_ConnectionNotificationCode code)
{
    const union MHD_ConnectionInfo *info = MHD_get_connection_info(mhd, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
    const struct sockaddr *address = info == NULL ? NULL : info->client_addr;
    if (code == MHD_CONNECTION_NOTIFY_STARTED && address != NULL && address->sa_family == AF_UNSPEC)
        *socket_context = pulse;
    return *socket_context == pulse;
}

bool pulse_is_mine(const struct pulse *pulse, struct MHD_Connection *mhd)
{
    const union MHD_ConnectionInfo *info = MHD_get_connection_info(mhd, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    return info != NULL && info->socket_context == pulse;
}

enum MHD_Result pulse_answer(struct MHD_Connection *mhd)
{
    static char nothing[1];
    struct MHD_Response *response = MHD_create_response_from_buffer(0, nothing, MHD_RESPMEM_PERSISTENT);
    if (response == NULL)
        return MHD_NO;
    enum MHD_Result result = MHD_queue_response(mhd, MHD_HTTP_NO_CONTENT, response);
    MHD_destroy_response(response);
    return result;
}

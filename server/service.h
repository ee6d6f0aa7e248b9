/* service.h - what a service manager gives and is told: sockets, readiness, the watchdog, time to stop.
 *
 * Without one (no NOTIFY_SOCKET, no LISTEN_FDS, no WATCHDOG_USEC) nothing happens. Main's thread only. */
#ifndef DRAPED_SERVICE_H
#define DRAPED_SERVICE_H

#include <stdbool.h>
#include <stdint.h>

/* Their FileDescriptorName= in the units. */
#define SERVICE_SOCKETS 2
#define SERVICE_API     "api"
#define SERVICE_ADMIN   "admin"

struct service {
    struct service_socket { /* passed by systemd */
        char name[32];
        int fd; /* -1: taken */
    } socket[SERVICE_SOCKETS];
    int sockets;
    int64_t watchdog_ms; /* 0: there is none */
    int64_t told_ms;     /* the last notice */
};

/* Takes what is passed. 0, or -1 with a line in `why`: sockets that are none of ours. */
int service_open(struct service *ret, char *why, unsigned size);

/* The listening socket of this name, non-blocking, which the caller owns from then on; -1: none was passed.
 */
int service_take_socket(struct service *service, const char *name);

/* How long a part of the daemon may go unseen: half of the watchdog's time; 0: there is none. */
int64_t service_patience_ms(const struct service *service);

void service_ready(const char *status);
void service_stopping(void);

/* Every tick. About once a second, or more often where the watchdog is shorter: STATUS=, the ping if `well`,
 * and, if `more_time` is wanted to stop, the request for it. */
void service_tick(struct service *service, int64_t now_ms, bool well, bool more_time, const char *status);

#endif

/* service.c - see service.h. */
#include "service.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include <systemd/sd-daemon.h>

#define NOTICE_MS  1000
#define EXTRA_TIME "EXTEND_TIMEOUT_USEC=15000000\n" /* asked for again long before it is over */

static bool is_wanted(const struct service *service, const char *name)
{
    for (int i = 0; i < service->sockets; i++)
        if (strcmp(service->socket[i].name, name) == 0)
            return false; /* a second one */
    return strcmp(name, SERVICE_API) == 0 || strcmp(name, SERVICE_ADMIN) == 0;
}

static int take_fds(struct service *service, int count, char **name, char *why, unsigned size)
{
    for (int i = 0; i < count; i++) {
        int fd = SD_LISTEN_FDS_START + i;
        struct service_socket *s = &service->socket[i];
        if (!is_wanted(service, name[i]) || sd_is_socket(fd, AF_UNSPEC, SOCK_STREAM, 1) <= 0) {
            snprintf(why, size, "descriptor %d, \"%s\", is not a listening socket that is wanted", fd,
                     name[i]);
            return -1;
        }
        snprintf(s->name, sizeof s->name, "%s", name[i]);
        s->fd = fd;
        service->sockets = i + 1;
    }
    return 0;
}

int service_open(struct service *ret, char *why, unsigned size)
{
    char **name = NULL;
    uint64_t watchdog_us = 0;
    *ret = (struct service){0};
    if (sd_watchdog_enabled(1, &watchdog_us) > 0)
        ret->watchdog_ms = (int64_t)(watchdog_us / 1000);
    int count = sd_listen_fds_with_names(1, &name);
    int failed = take_fds(ret, count, name, why, size);
    for (int i = 0; i < count; i++)
        free(name[i]);
    free(name);
    return failed;
}

int service_take_socket(struct service *service, const char *name)
{
    for (int i = 0; i < service->sockets; i++) {
        struct service_socket *s = &service->socket[i];
        int fd = s->fd;
        if (fd < 0 || strcmp(s->name, name) != 0)
            continue;
        s->fd = -1;
        fcntl(fd, F_SETFL, fcntl(fd, F_GETFL) | O_NONBLOCK);
        return fd;
    }
    return -1;
}

int64_t service_patience_ms(const struct service *service)
{
    return service->watchdog_ms / 2;
}

void service_ready(const char *status)
{
    sd_notifyf(0, "READY=1\nSTATUS=%s", status);
}

void service_stopping(void)
{
    sd_notify(0, "STOPPING=1");
}

void service_tick(struct service *service, int64_t now_ms, bool well, bool more_time, const char *status)
{
    int64_t period = service->watchdog_ms > 0 && service->watchdog_ms / 4 < NOTICE_MS
                         ? service->watchdog_ms / 4
                         : NOTICE_MS;
    if (now_ms - service->told_ms < period)
        return;
    service->told_ms = now_ms;
    sd_notifyf(0, "%s%sSTATUS=%s", well && service->watchdog_ms > 0 ? "WATCHDOG=1\n" : "",
               more_time ? EXTRA_TIME : "", status);
}

/* slow_clients.c - clients that hold connections and hardly move: what a daemon must outlive.
 *
 * usage: slow_clients head|body|reader CLIENTS SECONDS PORT [PATH]
 *   head     sends the head of a request, a byte a second, and never ends it
 *   body     announces a body of 100 000 bytes to POST PATH, and sends a byte a second
 *   reader   asks for PATH through a small window, and reads nothing
 * All to 127.0.0.1. Waits until the daemon has cut them all, SECONDS at the most, and prints
 *   CLIENTS opened, N cut, first after S s, last after S s
 * Of readers it cannot see from here whether they were cut: the daemon's own count of connections tells. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

enum kind { HEAD, BODY, READER };

struct client {
    int fd; /* -1: cut, or never connected */
    double opened;
};

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* A connected socket that has sent the beginning of its request, or -1. */
static int open_client(const struct sockaddr_in *address, const char *beginning, bool small_window)
{
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0), window = 1024;
    if (fd < 0)
        return -1;
    if (small_window)
        setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &window, sizeof window);
    if (connect(fd, (const struct sockaddr *)address, sizeof *address) != 0 ||
        send(fd, beginning, strlen(beginning), MSG_NOSIGNAL) < 0) {
        close(fd);
        return -1;
    }
    fcntl(fd, F_SETFL, O_NONBLOCK);
    return fd;
}

/* Whether the other side has closed it, or answered (with a refusal), which comes to the same here. */
static bool is_cut(int fd)
{
    char answer[512];
    ssize_t n = recv(fd, answer, sizeof answer, 0);
    return n >= 0 || (errno != EAGAIN && errno != EINTR);
}

static bool drip(int fd)
{
    return send(fd, "a", 1, MSG_NOSIGNAL) == 1 || errno == EAGAIN;
}

int main(int argc, char **argv)
{
    static const char *const names[] = {"head", "body", "reader"};
    char beginning[512];
    int kind = 0;
    while (argc >= 5 && kind < 3 && strcmp(argv[1], names[kind]) != 0)
        kind++;
    if (argc < 5 || kind == 3 || (kind != HEAD && argc < 6)) {
        fprintf(stderr, "usage: slow_clients head|body|reader CLIENTS SECONDS PORT [PATH]\n");
        return 2;
    }
    int clients = atoi(argv[2]), cut = 0, opened = 0;
    double seconds = atof(argv[3]), first = 0, last = 0;
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(argv[4]))};
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (kind == HEAD)
        snprintf(beginning, sizeof beginning, "GET /v1/info HTTP/1.1\r\nHost: x\r\nX-Slow: ");
    else if (kind == BODY)
        snprintf(beginning, sizeof beginning,
                 "POST %s HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\nContent-Length: "
                 "100000\r\n\r\n{",
                 argv[5]);
    else
        snprintf(beginning, sizeof beginning, "GET %s HTTP/1.1\r\nHost: x\r\n\r\n", argv[5]);

    struct client *client = calloc((size_t)clients, sizeof *client);
    if (client == NULL)
        return 1;
    for (int i = 0; i < clients; i++) {
        client[i] = (struct client){open_client(&address, beginning, kind == READER), now()};
        opened += client[i].fd >= 0;
    }
    printf("%d opened\n", opened);
    fflush(stdout);
    double start = now();
    while (cut < opened && now() - start < seconds) {
        for (int i = 0; i < clients; i++) {
            if (client[i].fd < 0 || kind == READER || (!is_cut(client[i].fd) && drip(client[i].fd)))
                continue;
            double age = now() - client[i].opened;
            first = cut == 0 || age < first ? age : first;
            last = age > last ? age : last;
            close(client[i].fd);
            client[i].fd = -1;
            cut++;
        }
        nanosleep(&(struct timespec){1, 0}, NULL);
    }
    printf("%d opened, %d cut, first after %.1f s, last after %.1f s\n", opened, cut, first, last);
    free(client);
    return 0;
}

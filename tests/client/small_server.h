/* small_server.h - answers HTTP requests on a loopback port from a script, for tests of the client. */
#ifndef DRAPE_TEST_SMALL_SERVER_H
#define DRAPE_TEST_SMALL_SERVER_H

#include <arpa/inet.h>
#include <netinet/in.h>
#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

#include "test.h"

enum { SERVER_MAX_STEPS = 16, SERVER_REQUEST_BYTES = 8192 };

struct server_step {
    const char *expected; /* must occur in the request (head and body) */
    const char *answer;   /* sent as it is; then the connection closes */
};

struct small_server {
    int listener;
    char url[64];
    const struct server_step *step;
    size_t steps, done;
    char wrong[SERVER_REQUEST_BYTES]; /* the first request that lacked what its step expected */
    pthread_t thread;
};

/* Reads a head, and the body if a Content-Length announces one. */
static inline void server_read(int peer, char *request)
{
    size_t bytes = 0, wanted = SERVER_REQUEST_BYTES - 1;
    while (bytes < wanted) {
        ssize_t n = read(peer, request + bytes, SERVER_REQUEST_BYTES - 1 - bytes);
        if (n <= 0) {
            break;
        }
        bytes += (size_t)n;
        request[bytes] = '\0';
        const char *end = strstr(request, "\r\n\r\n"), *length = strstr(request, "Content-Length: ");
        if (end) {
            wanted = (size_t)(end + 4 - request) + (length ? strtoul(length + 16, NULL, 10) : 0);
        }
    }
    request[bytes] = '\0';
}

static inline void *server_main(void *data)
{
    struct small_server *server = data;
    for (size_t i = 0; i < server->steps; i++) {
        char request[SERVER_REQUEST_BYTES];
        int peer = accept(server->listener, NULL, NULL);
        if (peer < 0) {
            break;
        }
        server_read(peer, request);
        if (!strstr(request, server->step[i].expected) && !server->wrong[0]) {
            snprintf(server->wrong, sizeof server->wrong, "%s", request);
        }
        const char *answer = server->step[i].answer;
        if (write(peer, answer, strlen(answer)) == (ssize_t)strlen(answer)) {
            server->done = i + 1;
        }
        shutdown(peer, SHUT_WR);
        close(peer);
    }
    return NULL;
}

static inline void server_start(struct small_server *server, const struct server_step *step, size_t steps)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}};
    socklen_t size = sizeof address;
    *server = (struct small_server){.step = step, .steps = steps};
    server->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_true(server->listener >= 0);
    assert_int_equal(bind(server->listener, (struct sockaddr *)&address, size), 0);
    assert_int_equal(listen(server->listener, SERVER_MAX_STEPS), 0);
    assert_int_equal(getsockname(server->listener, (struct sockaddr *)&address, &size), 0);
    snprintf(server->url, sizeof server->url, "http://127.0.0.1:%d", ntohs(address.sin_port));
    assert_int_equal(pthread_create(&server->thread, NULL, server_main, server), 0);
}

/* Waits until the script is played to its end, and checks that each request was as expected. */
static inline void server_stop(struct small_server *server)
{
    pthread_join(server->thread, NULL);
    close(server->listener);
    if (server->wrong[0]) {
        print_error("unexpected request:\n%s\n", server->wrong);
    }
    assert_string_equal(server->wrong, "");
    assert_int_equal(server->done, server->steps);
}

#define HEAD(status, type) "HTTP/1.1 " status "\r\nContent-Type: " type "\r\nConnection: close\r\n"
#define JSON_OK            HEAD("200 OK", "application/json") "\r\n"
#define STREAM_OK          HEAD("200 OK", "text/event-stream") "\r\n"

#endif

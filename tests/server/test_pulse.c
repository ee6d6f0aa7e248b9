/* test_pulse.c - an HTTP loop that answers is told from one that is stuck, whatever its clients do. */
#include "test.h"

#include <arpa/inet.h>
#include <dlfcn.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "http.h"

#define CONNECTIONS 8

static struct http *http;
static unsigned port;
static pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
static atomic_int at_gate, parked, finished;
static struct http_request *parked_request[CONNECTIONS];

static void on_begin(struct http_request *request, void *data)
{
    (void)request, (void)data;
}

/* "/stuck" does what no handler may: it blocks the loop. Others wait for an answer that comes later. */
static void on_handle(struct http_request *request, void *data)
{
    (void)data;
    if (strcmp(http_path(request), "/stuck") == 0) {
        at_gate = 1;
        pthread_mutex_lock(&gate);
        pthread_mutex_unlock(&gate);
        http_send(request, http_answer_empty(204));
        return;
    }
    http_suspend(request);
    parked_request[parked] = request;
    parked++;
}

static void on_finished(struct http_request *request, int status, int64_t milliseconds, void *data)
{
    (void)request, (void)status, (void)milliseconds, (void)data;
    finished++;
}

static int start(void **state)
{
    (void)state;
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    struct http_setup setup = {
        .connections = CONNECTIONS, .begin = on_begin, .handle = on_handle, .finished = on_finished};
    at_gate = parked = finished = 0;
    return http_listen((struct sockaddr *)&address, sizeof address, &setup.listen_fd, &port) != 0 ||
           http_start(&setup, &http) != 0;
}

static int stop(void **state)
{
    (void)state;
    http_quiesce(http);
    http = http_stop(http);
    return 0;
}

static void pause_ms(long ms)
{
    struct timespec t = {ms / 1000, ms % 1000 * 1000000L};
    nanosleep(&t, NULL);
}

/* Ticks until the loop has answered after `since`, or for `ms`. */
static bool answers(int64_t since, int ms)
{
    for (int i = 0; i < ms / 5; i++) {
        http_tick(http);
        if (http_answered_ms(http) > since)
            return true;
        pause_ms(5);
    }
    return false;
}

static int ask(const char *path)
{
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK), .sin_port = htons((uint16_t)port)};
    char head[100];
    int fd = socket(AF_INET, SOCK_STREAM, 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&address, sizeof address), 0);
    int n = snprintf(head, sizeof head, "GET %s HTTP/1.1\r\nHost: h\r\n\r\n", path);
    assert_int_equal(write(fd, head, (size_t)n), n);
    return fd;
}

static void test_pulse__a_loop_answers_again_and_again_and_nobody_sees_it(void **state)
{
    (void)state;
    for (int i = 0; i < 20; i++) {
        assert_true(answers(http_answered_ms(http), 10000));
        pause_ms(2); /* the next answer has a later time */
    }
    assert_int_equal(http_connections(http), 0);
    assert_int_equal(http_active(http), 0);
    assert_int_equal(finished, 0);
}

static void test_pulse__it_needs_no_place_among_the_connections(void **state)
{
    (void)state;
    int fd[CONNECTIONS];
    for (int i = 0; i < CONNECTIONS; i++)
        fd[i] = ask("/park");
    while (parked < CONNECTIONS)
        pause_ms(1);
    assert_int_equal(http_connections(http), CONNECTIONS);
    /* Nor does it lose its own when it is to be made anew. */
    for (int64_t until = clock_monotonic_ms() + 2500; clock_monotonic_ms() < until;)
        assert_true(answers(clock_monotonic_ms(), 10000));
    assert_int_equal(http_connections(http), CONNECTIONS);
    for (int i = 0; i < CONNECTIONS; i++)
        http_send(parked_request[i], http_answer_empty(204));
    while (finished < CONNECTIONS)
        pause_ms(1);
    for (int i = 0; i < CONNECTIONS; i++)
        close(fd[i]);
}

static void test_pulse__a_stuck_loop_does_not_answer_until_it_is_free(void **state)
{
    (void)state;
    pthread_mutex_lock(&gate);
    int fd = ask("/stuck");
    while (!at_gate)
        pause_ms(1);
    assert_false(answers(clock_monotonic_ms(), 300));
    pthread_mutex_unlock(&gate);
    assert_true(answers(clock_monotonic_ms(), 10000));
    close(fd);
}

/* ---- a connection that the library does not take --------------------------------------------------- */

static bool refuses;    /* the next connection that is handed to the library, for want of memory */
static int client = -1; /* one that comes at that very moment */

/* In the place of the library's: closes a socket that it refuses, as it does, and a client gets its number.
 */
enum MHD_Result MHD_add_connection(struct MHD_Daemon *daemon, MHD_socket fd, const struct sockaddr *address,
                                   socklen_t bytes)
{
    enum MHD_Result (*next)(struct MHD_Daemon *, MHD_socket, const struct sockaddr *, socklen_t) =
        (enum MHD_Result(*)(struct MHD_Daemon *, MHD_socket, const struct sockaddr *, socklen_t))dlsym(
            RTLD_NEXT, "MHD_add_connection");
    if (!refuses)
        return next(daemon, fd, address, bytes);
    refuses = false;
    struct sockaddr_in to = {
        .sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK), .sin_port = htons((uint16_t)port)};
    static const char head[] = "GET /park HTTP/1.1\r\nHost: h\r\n\r\n";
    char byte;
    client = socket(AF_INET, SOCK_STREAM, 0);
    close(fd);
    assert_int_equal(connect(client, (struct sockaddr *)&to, sizeof to), 0);
    assert_int_equal(write(client, head, sizeof head - 1), sizeof head - 1);
    while (!parked && recv(client, &byte, 1, MSG_DONTWAIT | MSG_PEEK) < 0)
        pause_ms(1);
    return MHD_NO;
}

static void test_pulse__a_client_is_not_taken_for_one_that_was_refused(void **state)
{
    (void)state;
    refuses = true;
    http_tick(http);
    assert_false(refuses);
    assert_int_equal(parked, 1);
    assert_int_equal(http_connections(http), 1);
    http_send(parked_request[0], http_answer_empty(204));
    while (finished < 1)
        pause_ms(1);
    close(client);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_pulse__a_loop_answers_again_and_again_and_nobody_sees_it, start,
                                        stop),
        cmocka_unit_test_setup_teardown(test_pulse__it_needs_no_place_among_the_connections, start, stop),
        cmocka_unit_test_setup_teardown(test_pulse__a_stuck_loop_does_not_answer_until_it_is_free, start,
                                        stop),
        cmocka_unit_test_setup_teardown(test_pulse__a_client_is_not_taken_for_one_that_was_refused, start,
                                        stop),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}

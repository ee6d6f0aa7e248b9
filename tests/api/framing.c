/* framing.c - sends requests as they stand, byte by byte, and says what became of each.
 *
 * usage: framing HOST PORT CASES
 * A line of CASES is `WANT <tab> NAME <tab> REQUEST`. WANT is
 *   refuse     an error or nothing at all, then the connection is closed, and what follows is not answered;
 *   gap 422    known not to be noticed: the request is answered with that status all the same; but then,
 *              too, the connection is closed, and what follows is not answered;
 *   statuses   as "200 422": honest requests, answered so; then the connection is closed.
 * In REQUEST, \r \n \t \0 \\ and \xHH are bytes, \{N TEXT} is TEXT N times, and $NAME is the text of the
 * line `define <tab> NAME <tab> TEXT`. Behind every request that is to be refused a second one is sent, for
 * `hidden`, which nobody should ever answer.
 * Prints TAP, and last `# N refused, M known gaps`. Knows sockets and nothing of HTTP but its status lines.
 */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define PATIENCE_MS 4000 /* for an answer: a connection still open then was not closed */
#define MAX_DEFINES 32

struct text { /* grows; zero-initialise */
    char *data;
    size_t size, room;
};

struct define {
    char *name, *value;
};

struct answer {
    char statuses[64]; /* "400 200" */
    unsigned refusals, served;
    bool closed;
};

static struct define define_table[MAX_DEFINES];
static size_t defines;

static void die(const char *what, const char *where)
{
    printf("Bail out! %s: %s\n", what, where);
    exit(2);
}

static void put(struct text *text, const char *data, size_t bytes)
{
    if (text->size + bytes + 1 > text->room) {
        text->room = 2 * (text->size + bytes + 1);
        text->data = realloc(text->data, text->room);
        if (text->data == NULL)
            die("out of memory", "");
    }
    memcpy(text->data + text->size, data, bytes);
    text->size += bytes;
    text->data[text->size] = '\0';
}

/* ---- cases -------------------------------------------------------------------------------------------- */

static void expand(struct text *out, const char *p, const char *end);

/* What stands behind a backslash; returns where to go on. */
static const char *put_escape(struct text *out, const char *p, const char *end)
{
    static const char from[] = "rnt0\\$", to[] = "\r\n\t\0\\$";
    const char *known = *p == '\0' ? NULL : strchr(from, *p);
    if (*p == 'x') {
        char digits[3] = {p[1], p[2], '\0'};
        char byte = (char)strtoul(digits, NULL, 16);
        put(out, &byte, 1);
        return p + 3;
    }
    if (*p == '{') {
        char *text;
        unsigned long times = strtoul(p + 1, &text, 10);
        const char *close = memchr(p, '}', (size_t)(end - p));
        if (*text != ' ' || close == NULL)
            die("a repetition is \\{N TEXT}", p);
        while (times-- > 0)
            expand(out, text + 1, close);
        return close + 1;
    }
    if (known == NULL)
        die("an unknown escape", p);
    put(out, to + (known - from), 1);
    return p + 1;
}

static const char *put_define(struct text *out, const char *p)
{
    for (size_t i = 0; i < defines; i++) {
        size_t n = strlen(define_table[i].name);
        if (strncmp(p, define_table[i].name, n) != 0)
            continue;
        expand(out, define_table[i].value, define_table[i].value + strlen(define_table[i].value));
        return p + n;
    }
    die("nothing is defined so", p);
    return NULL;
}

static void expand(struct text *out, const char *p, const char *end)
{
    while (p < end) {
        if (*p == '\\') {
            p = put_escape(out, p + 1, end);
        } else if (*p == '$') {
            p = put_define(out, p + 1);
        } else {
            put(out, p++, 1);
        }
    }
}

/* ---- the wire ----------------------------------------------------------------------------------------- */

static int dial(const char *host, const char *port)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)atoi(port))};
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (inet_pton(AF_INET, host, &address.sin_addr) != 1 || fd < 0 ||
        connect(fd, (struct sockaddr *)&address, sizeof address) != 0)
        die("cannot connect to", host);
    return fd;
}

static long now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* Sends what the peer takes and reads what it says, until it hangs up or the patience ends. */
static bool exchange(int fd, const struct text *request, struct text *answer)
{
    long until = now_ms() + PATIENCE_MS;
    size_t sent = 0;
    char buffer[16384];
    for (long left; (left = until - now_ms()) > 0;) {
        struct pollfd poll_fd = {fd, (short)(POLLIN | (sent < request->size ? POLLOUT : 0)), 0};
        if (poll(&poll_fd, 1, (int)left) <= 0)
            continue;
        if (poll_fd.revents & POLLIN) {
            ssize_t n = recv(fd, buffer, sizeof buffer, 0);
            if (n <= 0)
                return true;
            put(answer, buffer, (size_t)n);
        } else if (poll_fd.revents & POLLOUT) {
            ssize_t n = send(fd, request->data + sent, request->size - sent, MSG_NOSIGNAL);
            if (n < 0)
                sent = request->size; /* it hung up: what it said may still be read */
            else
                sent += (size_t)n;
        } else {
            return true;
        }
    }
    return false;
}

static struct answer read_answer(const struct text *said)
{
    struct answer answer = {0};
    size_t n = 0;
    for (const char *p = said->data; p != NULL && (p = strstr(p, "HTTP/1.")) != NULL; p++) {
        int status;
        if (sscanf(p, "HTTP/1.%*1[01] %3d", &status) != 1 || n + 5 > sizeof answer.statuses)
            continue;
        n += (size_t)snprintf(answer.statuses + n, sizeof answer.statuses - n, "%s%d", n ? " " : "", status);
        answer.refusals += status >= 400;
        answer.served += status >= 200 && status < 400;
    }
    return answer;
}

static struct answer ask(const char *host, const char *port, const struct text *request)
{
    struct text said = {0};
    int fd = dial(host, port);
    bool closed = exchange(fd, request, &said);
    struct answer answer = read_answer(&said);
    answer.closed = closed;
    close(fd);
    free(said.data);
    return answer;
}

/* ---- verdicts ----------------------------------------------------------------------------------------- */

/* An answer that says its head twice, as the library's own do, still is one. */
static bool is_refused(const struct answer *answer)
{
    return answer->closed && answer->served == 0;
}

struct tally {
    unsigned tests, refused, gaps;
};

static void judge(struct tally *tally, const char *want, const char *name, const struct answer *answer)
{
    bool gap = strncmp(want, "gap ", 4) == 0, good;
    if (strcmp(want, "refuse") == 0) {
        good = is_refused(answer);
        tally->refused += good;
    } else {
        good = answer->closed && strcmp(answer->statuses, gap ? want + 4 : want) == 0;
        tally->gaps += gap && good;
    }
    printf("%s %u - %s%s\n", good ? "ok" : "not ok", ++tally->tests, name, gap ? " (known gap)" : "");
    if (!good)
        printf("# %s: wanted %s, got statuses '%s', %s\n", name, want, answer->statuses,
               answer->closed ? "closed" : "still open");
}

/* One line of the file. */
static void take(struct tally *tally, const char *host, const char *port, char *line)
{
    char *want = strtok(line, "\t"), *name = strtok(NULL, "\t"), *value = strtok(NULL, "\n");
    if (want == NULL || name == NULL || value == NULL)
        die("not WANT, NAME and REQUEST", line);
    if (strcmp(want, "define") == 0) {
        if (defines == MAX_DEFINES)
            die("too many defines", name);
        define_table[defines++] = (struct define){strdup(name), strdup(value)};
        return;
    }
    struct text request = {0};
    expand(&request, value, value + strlen(value));
    if (want[0] < '0' || want[0] > '9')
        expand(&request, "$HIDDEN", &"$HIDDEN"[7]);
    struct answer answer = ask(host, port, &request);
    judge(tally, want, name, &answer);
    free(request.data);
}

int main(int argc, char **argv)
{
    FILE *file = argc == 4 ? fopen(argv[3], "r") : NULL;
    struct tally tally = {0};
    char *line = NULL;
    size_t room = 0;
    if (file == NULL)
        die("usage", "framing HOST PORT CASES");
    setvbuf(stdout, NULL, _IOLBF, 0);
    while (getline(&line, &room, file) > 0)
        if (line[0] != '#' && line[0] != '\n')
            take(&tally, argv[1], argv[2], line);
    printf("1..%u\n# %u refused, %u known gaps\n", tally.tests, tally.refused, tally.gaps);
    free(line);
    fclose(file);
    for (size_t i = 0; i < defines; i++) {
        free(define_table[i].name);
        free(define_table[i].value);
    }
    return 0;
}

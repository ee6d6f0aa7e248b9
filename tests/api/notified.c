/* notified.c - a service manager's ear: prints what arrives at NOTIFY_SOCKET, one `seconds text` a line.
 * usage: notified PATH    ends at SIGTERM */
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>

int main(int argc, char **argv)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int fd = socket(AF_UNIX, SOCK_DGRAM, 0);
    if (argc != 2 || fd < 0 ||
        snprintf(address.sun_path, sizeof address.sun_path, "%s", argv[1]) >= (int)sizeof address.sun_path ||
        bind(fd, (struct sockaddr *)&address, sizeof address) != 0) {
        perror("notified");
        return 2;
    }
    for (;;) {
        char text[4096];
        struct timespec t;
        ssize_t n = recv(fd, text, sizeof text - 1, 0);
        clock_gettime(CLOCK_MONOTONIC, &t);
        text[n > 0 ? n : 0] = '\0';
        char *rest = text;
        for (char *line; (line = strsep(&rest, "\n")) != NULL;)
            printf("%ld.%03ld %s\n", (long)t.tv_sec, t.tv_nsec / 1000000, line);
        fflush(stdout);
    }
}

/* accept.c - LD_PRELOAD: a loop that is held up for ACCEPT_MS between being told that somebody connects and
 * accepting it. */
#include <dlfcn.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>

int accept4(int fd, struct sockaddr *address, socklen_t *size, int flags)
{
    const char *said = getenv("ACCEPT_MS");
    long ms = said == NULL ? 0 : atol(said);
    struct timespec moment = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&moment, NULL);
    return ((__typeof__(&accept4))(uintptr_t)dlsym(RTLD_NEXT, "accept4"))(fd, address, size, flags);
}

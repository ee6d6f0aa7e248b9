/* flush.c - LD_PRELOAD for a program that gcov counts in: SIGUSR1 has it write its counts, which else come at
 * its end, and then make the file that FLUSHED names; so it may be killed. To other programs it does nothing.
 */
#include <fcntl.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdlib.h>
#include <unistd.h>

/* The program's own, which the Makefile has it export. */
void __gcov_dump(void) __attribute__((weak));
void __gcov_reset(void) __attribute__((weak));

static sem_t asked;

static void ask(int number)
{
    (void)number;
    sem_post(&asked);
}

static void *flush(void *data)
{
    for (;;) {
        while (sem_wait(&asked) != 0)
            continue;
        __gcov_dump();
        __gcov_reset();
        close(open(data, O_WRONLY | O_CREAT, 0600));
    }
    return NULL;
}

__attribute__((constructor)) static void begin(void)
{
    char *flushed = getenv("FLUSHED");
    pthread_t thread;
    if (__gcov_dump == NULL || flushed == NULL)
        return;
    sem_init(&asked, 0, 0);
    sigaction(SIGUSR1, &(struct sigaction){.sa_handler = ask, .sa_flags = SA_RESTART}, NULL);
    pthread_create(&thread, NULL, flush, flushed);
}

/* failure.h - how a command failed: an exit code for scripts and a message for a person. */
#ifndef DRAPE_CLIENT_FAILURE_H
#define DRAPE_CLIENT_FAILURE_H

/* Documented in `drape --help`; part of the command's interface. */
enum exit_code {
    EXIT_AT_REST = 0,      /* done; where a drape was asked for, it is at rest */
    EXIT_USAGE = 1,        /* wrong arguments, or an input file that cannot be used */
    EXIT_REFUSED = 2,      /* the server refused the request */
    EXIT_UNREACHABLE = 3,  /* no server, or the connection broke */
    EXIT_JOB_FAILED = 4,   /* the job failed or was canceled */
    EXIT_NOT_AT_REST = 5,  /* the job ended, but its drape is not at rest */
    EXIT_LOCAL = 6,        /* out of memory, or an output that cannot be written */
    EXIT_INTERRUPTED = 130 /* Ctrl-C, as shells count it: 128 + SIGINT */
};

struct failure {
    enum exit_code code;
    char message[2048]; /* may have several lines; no final newline */
};

/* Fills *failure and returns -1, so that a function can end with it. */
__attribute__((format(printf, 3, 4))) int failure_set(struct failure *failure, enum exit_code code,
                                                      const char *format, ...);

/* The same for memory that ran out. Known limit: text made by open_memstream(3) may lack what glibc found no
 * memory for, and neither ferror nor fclose tell. */
int failure_no_memory(struct failure *failure);

/* Adds a line to the message; what does not fit is cut. */
__attribute__((format(printf, 2, 3))) void failure_add(struct failure *failure, const char *format, ...);

#endif

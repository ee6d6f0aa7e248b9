/* cli.h - the command line: global options, the table of commands, and what each command is given. */
#ifndef DRAPE_CLIENT_CLI_H
#define DRAPE_CLIENT_CLI_H

#include <argp.h>
#include <stdbool.h>
#include <stdio.h>

#include "failure.h"
#include "http.h"

#define CLI_DEFAULT_URL "http://127.0.0.1:8080"

struct cli { /* what the global options say */
    const char *url, *key,
        *key_file; /* borrowed from the arguments or the environment; the keys may be NULL */
    bool json, quiet;
};

/* One command: parses its own arguments and does its work. Returns an exit code, or -1 with *failure. */
typedef int cli_command_fn(struct cli *cli, int argc, char **argv, struct failure *failure);

struct cli_command {
    const char *name;
    const char *summary; /* for `drape --help` */
    cli_command_fn *run;
};

/* The whole program: `drape [OPTION...] COMMAND ...`. Returns the exit code; wrong arguments and
 * --help end the process, as argp has it. */
int cli_run(int argc, char **argv);

/* For commands: parses with the global options as a group of their own. `argp` must name
 * cli_children as its children, and its parser must pass ARGP_KEY_INIT to cli_init. */
extern const struct argp_child cli_children[];
void cli_init(struct argp_state *state, struct cli *cli);

/* A number argument in [low, high]; ends the process with a usage error when it is none. */
double cli_number(struct argp_state *state, const char *option, const char *text, double low, double high);
long cli_integer(struct argp_state *state, const char *option, const char *text, long low, long high);

/* Opens the connection that the global options ask for. */
int cli_connect(const struct cli *cli, struct http **ret, struct failure *failure);

/* The table's rows; each is in the command_*.c file of its group. */
cli_command_fn command_example, command_scene, command_picture;                 /* make and show files */
cli_command_fn command_run, command_submit, command_watch, command_compare;     /* drape */
cli_command_fn command_status, command_cancel, command_list, command_materials; /* ask */
cli_command_fn command_result, command_trace;                                   /* fetch */

#endif

/* main.c - the entry of `drape`; everything is in cli.c, where tests can reach it. */
#include "cli.h"

int main(int argc, char **argv)
{
    return cli_run(argc, argv);
}

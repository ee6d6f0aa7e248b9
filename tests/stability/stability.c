/* stability.c - the long form of the stability suite: every case under every method, as a table.
 * usage: stability [-j WORKERS] [-o FILE] [-g GROUP] [-c CASE-PART] [-m METHOD-PART] */
#include "rows.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define ITERATIONS          300
#define EXPLICIT_ITERATIONS 3000
#define LARGE_ITERATIONS    4
#define TIME_LIMIT          10.0 /* s */
#define LARGE_TIME_LIMIT    60.0 /* 200 000 triangles are expected to take 48 s, plain Newton's LDL' 240 s */
#define PATIENCE            60.0
#define LARGE_PATIENCE      240.0
#define TWICE_EVERY         3 /* rows, one of which is run twice */

static struct row_job make_job(const struct stability_case *which, const struct stability_method *method,
                               size_t number)
{
    bool is_explicit = method->integrator == DRAPE_RK4;
    return (struct row_job){
        .which = which,
        .method = method,
        .max_iterations = which->large  ? LARGE_ITERATIONS
                          : is_explicit ? EXPLICIT_ITERATIONS
                                        : ITERATIONS,
        .time_limit = which->large ? LARGE_TIME_LIMIT : TIME_LIMIT,
        .patience = which->large ? LARGE_PATIENCE : PATIENCE,
        .twice = !which->large && number % TWICE_EVERY == 0,
    };
}

/* What must be refused is refused whatever the method: one row. */
static size_t make_jobs(struct row_job *job, const char *group, const char *case_part,
                        const char *method_part)
{
    size_t jobs = 0;
    for (size_t c = 0; c < stability_cases; c++)
        for (size_t m = 0; m < stability_methods; m++) {
            const struct stability_case *which = stability_case + c;
            if (strstr(group_name[which->group], group) && strstr(which->name, case_part) &&
                strstr(stability_method[m].name, method_part) &&
                (which->expectation != MUST_REFUSE || m == 0)) {
                job[jobs] = make_job(which, stability_method + m, jobs);
                jobs++;
            }
        }
    return jobs;
}

int main(int argc, char **argv)
{
    const char *group = "", *case_part = "", *method_part = "", *path = NULL;
    size_t workers = 1;
    for (int option; (option = getopt(argc, argv, "j:o:g:c:m:")) != -1;)
        switch (option) {
        case 'j':
            workers = strtoul(optarg, NULL, 10);
            break;
        case 'o':
            path = optarg;
            break;
        case 'g':
            group = optarg;
            break;
        case 'c':
            case_part = optarg;
            break;
        case 'm':
            method_part = optarg;
            break;
        default:
            fprintf(stderr, "usage: %s [-j WORKERS] [-o FILE] [-g GROUP] [-c CASE-PART] [-m METHOD-PART]\n",
                    argv[0]);
            return 2;
        }
    FILE *file = path ? fopen(path, "w") : NULL;
    if (path && !file) {
        perror(path);
        return 2;
    }
    FILE *const out[] = {stdout, file, NULL};
    struct row_job *job = calloc(stability_cases * stability_methods, sizeof *job);
    if (!job)
        return 2;
    size_t jobs = make_jobs(job, group, case_part, method_part);
    rows_head(out);
    size_t violations = rows_run(job, jobs, workers, out);
    rows_summary(job, jobs, out);
    free(job);
    if (file)
        fclose(file);
    return violations || !jobs ? 1 : 0;
}

/* job.c - see job.h. Bodies are put together from texts that are JSON already, so that a status
 * request costs microseconds. */
#include "job.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "memout.h"

static const char *const status_name[JOB_STATUSES] = {
    [JOB_QUEUED] = "queued", [JOB_RUNNING] = "running",   [JOB_SUCCEEDED] = "succeeded",
    [JOB_FAILED] = "failed", [JOB_CANCELED] = "canceled",
};

const char *job_status_name(enum job_status status)
{
    return status_name[status];
}

int job_status_from_name(const char *name)
{
    for (int i = 0; i < JOB_STATUSES; i++)
        if (strcmp(name, status_name[i]) == 0)
            return i;
    return -1;
}

const char *job_priority_name(int priority)
{
    return priority < 0 ? "low" : priority > 0 ? "high" : "normal";
}

bool job_status_ended(enum job_status status)
{
    return status >= JOB_SUCCEEDED;
}

void revision_format(struct revision revision, char ret[REVISION_SIZE])
{
    snprintf(ret, REVISION_SIZE, "%" PRIu32 ".%" PRIu32, revision.attempt, revision.counter);
}

/* Digits only, no sign, no blank, at most ten of them. */
static int parse_u32(const char *text, const char **ret_end, uint32_t *ret)
{
    uint64_t value = 0;
    size_t n = 0;
    for (; n < 11 && text[n] >= '0' && text[n] <= '9'; n++)
        value = 10 * value + (uint64_t)(text[n] - '0');
    if (n == 0 || value > UINT32_MAX)
        return -1;
    *ret = (uint32_t)value;
    *ret_end = text + n;
    return 0;
}

int revision_parse(const char *text, struct revision *ret)
{
    struct revision revision;
    const char *end;
    if (parse_u32(text, &end, &revision.attempt) != 0 || *end != '.' ||
        parse_u32(end + 1, &end, &revision.counter) != 0 || *end != '\0')
        return -1;
    *ret = revision;
    return 0;
}

int revision_compare(struct revision a, struct revision b)
{
    if (a.attempt != b.attempt)
        return a.attempt < b.attempt ? -1 : 1;
    return a.counter < b.counter ? -1 : a.counter > b.counter;
}

void job_done(struct job *job)
{
    free(job->name);
    free(job->labels);
    free(job->warnings);
    free(job->progress);
    free(job->report);
    free(job->error);
    memset(job, 0, sizeof *job);
}

/* Copies a text that may be NULL; clears *ok when out of memory. */
static char *copy_text(const char *text, bool *ok)
{
    char *copy = text == NULL ? NULL : strdup(text);
    *ok = *ok && (copy != NULL || text == NULL);
    return copy;
}

int job_copy(const struct job *job, struct job *ret)
{
    struct job copy = *job;
    bool ok = true;
    copy.name = copy_text(job->name, &ok);
    copy.labels = copy_text(job->labels, &ok);
    copy.warnings = copy_text(job->warnings, &ok);
    copy.progress = copy_text(job->progress, &ok);
    copy.report = copy_text(job->report, &ok);
    copy.error = copy_text(job->error, &ok);
    if (!ok) {
        job_done(&copy);
        return -1;
    }
    *ret = copy;
    return 0;
}

/* RFC 8259 section 7: quotes, backslashes and control characters are escaped. */
static void write_string(FILE *out, const char *text)
{
    fputc('"', out);
    for (; *text != '\0'; text++) {
        unsigned char c = (unsigned char)*text;
        if (c == '"' || c == '\\')
            fprintf(out, "\\%c", c);
        else if (c < 0x20)
            fprintf(out, "\\u%04x", c);
        else
            fputc(c, out);
    }
    fputc('"', out);
}

static void write_time(FILE *out, const char *member, int64_t wall_ms)
{
    char text[CLOCK_TEXT_SIZE];
    if (wall_ms == 0) {
        fprintf(out, ",\"%s\":null", member);
        return;
    }
    clock_format(wall_ms, text);
    fprintf(out, ",\"%s\":\"%s\"", member, text);
}

static void write_json(FILE *out, const char *member, const char *json, const char *fallback)
{
    fprintf(out, ",\"%s\":%s", member, json != NULL ? json : fallback);
}

static void write_members(FILE *out, const struct job *job, size_t position)
{
    char revision[REVISION_SIZE];
    revision_format(job->revision, revision);
    fprintf(out, "{\"id\":\"%s\",\"name\":", job->id);
    if (job->name != NULL)
        write_string(out, job->name);
    else
        fputs("null", out);
    write_json(out, "labels", job->labels, "{}");
    write_json(out, "warnings", job->warnings, "[]");
    fprintf(out, ",\"priority\":\"%s\",\"status\":\"%s\"", job_priority_name(job->priority),
            status_name[job->status]);
    if (job->verdict[0] != '\0')
        fprintf(out, ",\"verdict\":\"%s\"", job->verdict);
    else
        fputs(",\"verdict\":null", out);
    fprintf(out, ",\"revision\":\"%s\",\"attempt\":%" PRIu32, revision, job->revision.attempt);
    if (job->trace_id[0] != '\0')
        fprintf(out, ",\"trace_id\":\"%s\"", job->trace_id);
    else
        fputs(",\"trace_id\":null", out);
    write_time(out, "created_at", job->created_ms);
    write_time(out, "started_at", job->started_ms);
    write_time(out, "finished_at", job->finished_ms);
    if (position > 0)
        fprintf(out, ",\"queue_position\":%zu", position);
    else
        fputs(",\"queue_position\":null", out);
    write_json(out, "progress", job->progress, "null");
    write_json(out, "report", job->report, "null");
    write_json(out, "error", job->error, "null");
    fprintf(out,
            ",\"links\":{\"self\":\"/v1/jobs/%s\",\"events\":\"/v1/jobs/%s/events\","
            "\"result\":\"/v1/jobs/%s/result\",\"trace\":\"/v1/jobs/%s/trace\",\"preview\":",
            job->id, job->id, job->id, job->id);
    if (job->preview)
        fprintf(out, "\"/v1/jobs/%s/preview\"}}", job->id);
    else
        fputs("null}}", out);
}

char *job_body(const struct job *job, size_t position)
{
    struct memout memout;
    FILE *out = memout_open(&memout);
    if (out == NULL)
        return NULL;
    write_members(out, job, position);
    fclose(out);
    return memout_take(&memout, NULL);
}

/* store_prune.c - what is kept for a while only: answers under a key, ended jobs, idle meshes, tombstones. */
#include "store_rooms.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Jobs, and meshes, in one transaction: some ten milliseconds. */
#define BATCH 64

/* ---- answers ------------------------------------------------------------------------------------ */

/* The only route that takes a key. */
#define ROUTE "POST /v1/jobs"

int store_answer_add(struct db *db, const struct job *job, const struct store_submission *submission)
{
    db_bind(db, SQL_ANSWER_ADD, "ttttttii", job->owner, ROUTE, submission->key, submission->digest, job->id,
            submission->answer, submission->at_ms, submission->at_ms - STORE_ANSWER_MS);
    if (db_run(db, SQL_ANSWER_ADD) != 0)
        return -1;
    return db_changes(db) > 0 ? 0 : STORE_TAKEN;
}

int store_answer_get(struct store *store, const char *owner, const char *key, int64_t now_ms,
                     struct store_answer *ret, struct problem *reterr)
{
    db_lock(store->db);
    sqlite3_stmt *s = db_bind(store->db, SQL_ANSWER_GET, "ttti", owner, ROUTE, key, now_ms - STORE_ANSWER_MS);
    int found = db_row(store->db, SQL_ANSWER_GET);
    if (found > 0) {
        snprintf(ret->digest, sizeof ret->digest, "%s", (const char *)sqlite3_column_text(s, 0));
        snprintf(ret->job, sizeof ret->job, "%s", (const char *)sqlite3_column_text(s, 1));
        ret->body = strdup((const char *)sqlite3_column_text(s, 2));
    }
    if (found < 0)
        db_fail(store->db, "look for the key", reterr);
    else if (found > 0 && ret->body == NULL)
        found = problem_set(reterr, PROBLEM_INTERNAL, "Out of memory.");
    db_reset(store->db, SQL_ANSWER_GET);
    db_unlock(store->db);
    return found > 0 ? 0 : found == 0 ? STORE_NONE : -1;
}

/* ---- ended jobs --------------------------------------------------------------------------------- */

struct victim {
    char id[ID_SIZE], owner[KEY_NAME_SIZE];
    uint32_t attempt;
    uint64_t bytes;
    bool removed;
};

struct job_prune {
    const struct store_policy *policy;
    int64_t now_ms;
    struct victim victim[BATCH];
    size_t count;
};

/* The oldest ended jobs, as long as there are too many, too large or too old ones. */
static int choose_jobs(struct db *db, struct job_prune *prune)
{
    const struct store_policy *policy = prune->policy;
    sqlite3_stmt *s = db_bind(db, SQL_JOB_TOTALS, "");
    if (db_row(db, SQL_JOB_TOTALS) < 0)
        return -1;
    uint64_t jobs = (uint64_t)sqlite3_column_int64(s, 0), bytes = (uint64_t)sqlite3_column_int64(s, 1);
    db_reset(db, SQL_JOB_TOTALS);
    s = db_bind(db, SQL_JOB_OLDEST, "i", (int64_t)BATCH);
    int more;
    while ((more = db_row(db, SQL_JOB_OLDEST)) > 0) {
        struct victim *victim = &prune->victim[prune->count];
        bool old = sqlite3_column_int64(s, 3) <= prune->now_ms - policy->age_ms;
        if (!old && jobs <= policy->jobs && bytes <= policy->bytes)
            break;
        snprintf(victim->id, sizeof victim->id, "%s", (const char *)sqlite3_column_text(s, 0));
        snprintf(victim->owner, sizeof victim->owner, "%s", (const char *)sqlite3_column_text(s, 1));
        victim->attempt = (uint32_t)sqlite3_column_int64(s, 2);
        victim->bytes = (uint64_t)sqlite3_column_int64(s, 4);
        jobs--;
        bytes -= victim->bytes;
        prune->count++;
    }
    db_reset(db, SQL_JOB_OLDEST);
    return more < 0 ? -1 : 0;
}

static int run_job_prune(struct db *db, void *data)
{
    struct job_prune *prune = data;
    prune->count = 0;
    if (choose_jobs(db, prune) != 0)
        return -1;
    for (size_t i = 0; i < prune->count; i++)
        if (store_row_remove(db, prune->victim[i].owner, prune->victim[i].id, prune->now_ms) != 0)
            return -1;
    return prune->count > 0 ? db_run(db, SQL_GONE_TRIM) : 0;
}

/* ---- idle meshes -------------------------------------------------------------------------------- */

struct mesh_prune {
    int64_t before_ms;
    char sha256[BATCH][SHA256_SIZE];
    size_t count;
};

static int run_mesh_prune(struct db *db, void *data)
{
    struct mesh_prune *prune = data;
    char owner[BATCH][KEY_NAME_SIZE];
    sqlite3_stmt *s = db_bind(db, SQL_MESH_STALE, "ii", prune->before_ms, (int64_t)BATCH);
    int more;
    for (prune->count = 0; (more = db_row(db, SQL_MESH_STALE)) > 0; prune->count++) {
        snprintf(owner[prune->count], KEY_NAME_SIZE, "%s", (const char *)sqlite3_column_text(s, 0));
        snprintf(prune->sha256[prune->count], SHA256_SIZE, "%s", (const char *)sqlite3_column_text(s, 1));
    }
    db_reset(db, SQL_MESH_STALE);
    for (size_t i = 0; i < prune->count && more == 0; i++) {
        db_bind(db, SQL_MESH_REMOVE, "tt", owner[i], prune->sha256[i]);
        more = db_run(db, SQL_MESH_REMOVE);
    }
    return more;
}

/* ---- a step ------------------------------------------------------------------------------------- */

static int run_forget(struct db *db, void *data)
{
    int64_t now_ms = *(const int64_t *)data;
    db_bind(db, SQL_ANSWER_FORGET, "i", now_ms - STORE_ANSWER_MS);
    db_bind(db, SQL_GONE_FORGET, "i", now_ms - STORE_GONE_MS);
    return db_run(db, SQL_ANSWER_FORGET) || db_run(db, SQL_GONE_FORGET) ? -1 : 0;
}

int store_prune(struct store *store, const struct store_policy *policy, int64_t now_ms,
                struct store_pruned *ret, struct problem *reterr)
{
    struct job_prune jobs = {.policy = policy, .now_ms = now_ms};
    struct mesh_prune meshes = {.before_ms = now_ms - policy->age_ms};
    memset(ret, 0, sizeof *ret);
    if (db_transact(store->db, DB_FREES, "prune jobs", run_job_prune, &jobs, reterr) != 0)
        return -1;
    for (size_t i = 0; i < jobs.count; i++) {
        store_files_remove(store, jobs.victim[i].id, jobs.victim[i].attempt);
        ret->bytes += jobs.victim[i].bytes;
    }
    ret->jobs = jobs.count;
    if (db_transact(store->db, DB_FREES, "prune meshes", run_mesh_prune, &meshes, reterr) != 0)
        return -1;
    for (size_t i = 0; i < meshes.count; i++)
        store_mesh_file_remove(store, meshes.sha256[i]);
    ret->meshes = meshes.count;
    db_restore_reserve(store->db);
    return db_transact(store->db, DB_FREES, "forget", run_forget, &now_ms, reterr);
}

/* fuzz_job.c - libFuzzer entry: any bytes as a job document. */
#include "fuzz.h"
#include "schema.h"

/* Every hash names the same triangle. */
static int load_triangle(const char *sha256, struct mesh *ret, struct problem *reterr, void *data)
{
    static const char OBJ[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    (void)sha256;
    (void)data;
    return meshfile_parse(MESH_OBJ, OBJ, sizeof OBJ - 1, &limits_default, ret, reterr);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct job_spec *spec = NULL;
    struct problem problem = {0};
    if (schema_job_parse((const char *)data, size, &limits_default, load_triangle, NULL, &spec, &problem) ==
        0) {
        fuzz_check_mesh(&spec->cloth);
        fuzz_require(spec->cloth.pattern != NULL && spec->scene.materials > 0);
        fuzz_require(spec->options.time_limit > 0 && spec->options.time_step > 0);
        for (size_t i = 0; i < 2 * spec->scene.seams; i++)
            fuzz_require(spec->scene.seam[i] < spec->scene.vertices);
        for (size_t i = 0; i < spec->scene.tacks; i++)
            fuzz_require(spec->scene.tack[i].vertex < spec->scene.vertices &&
                         spec->scene.tack[i].body < spec->scene.bodies);
    } else {
        json_t *body = problem_json(&problem, NULL, NULL);
        fuzz_require(problem.code != PROBLEM_NONE && problem.detail[0] != '\0');
        json_decref(body);
    }
    job_spec_free(spec);
    return 0;
}

/* fuzz_keys.c - libFuzzer entry: any bytes as a key file. */
#include "fuzz.h"
#include "keys.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct key *key = NULL;
    size_t count = 0;
    struct problem problem = {0};
    if (keys_parse((const char *)data, size, &limits_default.key, &key, &count, &problem) == 0) {
        fuzz_require(count <= KEYS_MAX);
        for (size_t i = 0; i < count; i++) {
            fuzz_require(key[i].name[0] != '\0' && strnlen(key[i].name, KEY_NAME_SIZE) < KEY_NAME_SIZE);
            fuzz_require(key[i].quota.running >= 1 && key[i].quota.mesh_bytes <= QUOTA_MAX_BYTES);
        }
        free(key);
    } else {
        json_t *body = problem_json(&problem, NULL, NULL);
        fuzz_require(problem.code != PROBLEM_NONE && problem.detail[0] != '\0');
        json_decref(body);
    }
    return 0;
}

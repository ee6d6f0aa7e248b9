/* fuzz_config.c - libFuzzer entry: any bytes as the file of settings. */
#include <string.h>

#include "config.h"
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct config config;
    char message[CONFIG_MESSAGE_SIZE] = "";
    FILE *in = size == 0 ? NULL : fmemopen((void *)(uintptr_t)data, size, "r");
    if (in == NULL)
        return 0;
    config_set_defaults(&config);
    if (config_read(in, "file", &config, message, sizeof message) == 0) {
        fuzz_require(config.workers >= 1 && config.workers <= CONFIG_MAX_WORKERS);
        fuzz_require(config.limits.time_limit_s >= 1 && config.limits.streams >= 1);
        fuzz_require(config.data[0] != '\0' && log_level_name(config.log_level) != NULL);
        fuzz_require(message[0] == '\0');
    } else {
        fuzz_require(strncmp(message, "file:", 5) == 0 && strpbrk(message, "\n") == NULL);
    }
    fclose(in);
    return 0;
}

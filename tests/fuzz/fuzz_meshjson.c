/* fuzz_meshjson.c - libFuzzer entry: any bytes as a JSON mesh file. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    return fuzz_mesh(MESH_JSON, data, size);
}

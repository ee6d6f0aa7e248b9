/* fuzz_ply.c - libFuzzer entry: any bytes as a PLY file. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    return fuzz_mesh(MESH_PLY, data, size);
}

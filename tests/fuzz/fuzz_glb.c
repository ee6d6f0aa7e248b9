/* fuzz_glb.c - libFuzzer entry: any bytes as a binary glTF file. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    return fuzz_mesh(MESH_GLB, data, size);
}

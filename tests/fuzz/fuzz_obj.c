/* fuzz_obj.c - libFuzzer entry: any bytes as a Wavefront OBJ file. */
#include "fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    return fuzz_mesh(MESH_OBJ, data, size);
}

/* assets.c - embeds server/openapi.json (the compiler runs in the root of the tree). */
#include "assets.h"

__asm__(".section .rodata\n"
        ".global asset_openapi\n"
        "asset_openapi:\n"
        ".incbin \"server/openapi.json\"\n"
        ".global asset_openapi_end\n"
        "asset_openapi_end:\n"
        ".byte 0\n"
        ".previous\n");

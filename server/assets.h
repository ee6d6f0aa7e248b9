/* assets.h - documents that travel inside the program. */
#ifndef DRAPED_ASSETS_H
#define DRAPED_ASSETS_H

#include <stddef.h>

extern const char asset_openapi[]; /* server/openapi.json */
extern const char asset_openapi_end[];

#endif

/* cors.c - see cors.h. */
#include "cors.h"

#include <stdlib.h>
#include <string.h>

#define MAX_ORIGIN 255

static const char host_bytes[] = "abcdefghijklmnopqrstuvwxyz0123456789.-";

/* NULL or what is wrong with what stands behind the host. */
static const char *port_fault(const char *port, bool https)
{
    size_t digits = strspn(port + 1, "0123456789");
    if (*port == '\0')
        return NULL;
    if (*port != ':' || digits == 0 || digits > 5 || port[1 + digits] != '\0' || port[1] == '0' ||
        atoi(port + 1) > 65535)
        return "behind the host there may be a port and nothing else";
    if (atoi(port + 1) == (https ? 443 : 80))
        return "browsers leave out the port that goes without saying";
    return NULL;
}

const char *cors_origin_fault(const char *text, size_t bytes)
{
    char origin[MAX_ORIGIN + 1];
    if (bytes > MAX_ORIGIN)
        return "it is too long";
    memcpy(origin, text, bytes);
    origin[bytes] = '\0';
    bool https = strncmp(origin, "https://", 8) == 0;
    if (!https && strncmp(origin, "http://", 7) != 0)
        return "it must begin with https:// or http://";
    const char *host = origin + (https ? 8 : 7);
    size_t n = *host == '[' ? 1 + strspn(host + 1, "0123456789abcdef:") : strspn(host, host_bytes);
    if (*host == '[' && host[n++] != ']')
        return "its address has no end";
    if (n == 0)
        return "its host must be a name or an address, in lower case";
    return port_fault(host + n, https);
}

bool cors_allows(const char *origins, const char *origin)
{
    size_t bytes = origin == NULL ? 0 : strlen(origin);
    for (const char *p = origins; *p != '\0';) {
        size_t n = strcspn(p, " ");
        if (bytes > 0 && n == bytes && memcmp(p, origin, n) == 0)
            return true;
        p += n + strspn(p + n, " ");
    }
    return false;
}

/* error.c - filling a caller's drape_error, and the names of statuses, verdicts, methods, integrators. */
#include "error.h"

#include <stdarg.h>
#include <stdio.h>

void dr_error_set(drape_error *reterr, drape_status status, drape_place place, int64_t element, int64_t body,
                  const char *member, const char *format, ...)
{
    if (!reterr)
        return;
    *reterr =
        (drape_error){.status = status, .place = place, .element = element, .body = body, .member = member};
    va_list args;
    va_start(args, format);
    vsnprintf(reterr->message, sizeof reterr->message, format, args);
    va_end(args);
}

const char *drape_status_name(drape_status status)
{
    switch (status) {
    case DRAPE_OK:
        return "ok";
    case DRAPE_NOT_AT_REST:
        return "not-at-rest";
    case DRAPE_CANCELLED:
        return "cancelled";
    case DRAPE_EINVAL:
        return "invalid";
    case DRAPE_ENOMEM:
        return "out-of-memory";
    case DRAPE_ENUMERIC:
        return "numeric";
    }
    return "unknown";
}

const char *drape_verdict_name(drape_verdict verdict)
{
    switch (verdict) {
    case DRAPE_VERDICT_NOT_AT_REST:
        return "not-at-rest";
    case DRAPE_VERDICT_AT_REST:
        return "at-rest";
    case DRAPE_VERDICT_SLID_OFF:
        return "slid-off";
    case DRAPE_VERDICT_INTERSECTING:
        return "intersecting";
    }
    return "unknown";
}

const char *drape_method_name(drape_method method)
{
    switch (method) {
    case DRAPE_METHOD_AUTO:
        return "auto";
    case DRAPE_METHOD_STOP_AND_GO:
        return "stop-and-go";
    case DRAPE_METHOD_DYNAMIC:
        return "dynamic";
    case DRAPE_METHOD_VELOCITY_CORRECTION:
        return "velocity-correction";
    case DRAPE_METHOD_QUASI_STATIC:
        return "quasi-static";
    case DRAPE_METHOD_NEWTON:
        return "newton";
    }
    return "unknown";
}

const char *drape_integrator_name(drape_integrator integrator)
{
    switch (integrator) {
    case DRAPE_BACKWARD_EULER:
        return "backward-euler";
    case DRAPE_BDF2:
        return "bdf2";
    case DRAPE_IMPLICIT_MIDPOINT:
        return "implicit-midpoint";
    case DRAPE_RK4:
        return "rk4";
    }
    return "unknown";
}

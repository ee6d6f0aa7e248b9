/* certify.h - proof that a drape at rest is a strict local minimum of the potential energy. */
#ifndef DR_CERTIFY_H
#define DR_CERTIFY_H

#include "state.h"

/* From a state at rest, by Newton on the true Hessian, to round-off; fills sim->report.certificate and
 * leaves the state there, with its energies, never higher than it was. *ret_escaped: the state was a saddle
 * and is now below it, at rest no more; the method has to drape on. Uses s->best, which holds nothing
 * afterwards. */
drape_status dr_certify(struct dr_state *s, bool *ret_escaped, drape_error *reterr);

#endif

/* fit.h - how a drape fits: strain, stress, pressure and gap of one state, for drape_sim_fit.
 *
 * Made before the run and filled once after it; made only when asked for. Belongs to one thread. */
#ifndef DR_FIT_H
#define DR_FIT_H

#include "cloth.h"

struct dr_fit;

/* `scene` must outlive it. */
drape_status dr_fit_new(const drape_scene *scene, struct dr_fit **ret, drape_error *reterr);
struct dr_fit *dr_fit_free(struct dr_fit *fit); /* NULL is fine; returns NULL */
size_t dr_fit_bytes(const struct dr_fit *fit);

/* Measures the welded cloth at x (3*nodes). Allocates nothing. */
void dr_fit_measure(struct dr_fit *fit, const struct dr_cloth *cloth, const double *x);

const drape_fit *dr_fit_result(const struct dr_fit *fit); /* lives as long as the fit */

#endif

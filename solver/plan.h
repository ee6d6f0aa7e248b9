/* plan.h - the account of a run's plan: which terms the scene needed, which were left out and why. */
#ifndef DR_PLAN_H
#define DR_PLAN_H

#include "sim.h"

/* Fills sim->report.term from the scene and the options. */
void dr_plan(struct drape_sim *sim);

#endif

/* Functions of the stages, generated: see ocp/stage_code.py and solvers/riccati/program.py. */
#ifndef IPTM_STAGES_H
#define IPTM_STAGES_H

#include "stage_sizes.h"

#define IPTM_BLOCK (IPTM_STATES + IPTM_INPUTS)

/* Evaluates a function of a stage for several steps; arguments and results begin at the first of them. */
typedef void (*iptm_stage_map)(const double *const *arg, double *const *res, int count);

/* One entry per stage kind. */
extern const iptm_stage_map iptm_linearise[], iptm_evaluate[], iptm_least_slacks[], iptm_hamiltonian[];
/* Parameters of a step. */
extern const int iptm_kind_parameters[];

/* One step of the recursions, see recursion.py. */
void riccati_backward(const double *const *arg, double *const *res);
void riccati_forward(const double *const *arg, double *const *res);

#endif

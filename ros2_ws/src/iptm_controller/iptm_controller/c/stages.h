/* Functions of the stages, generated: see ocp/stage_code.py and solvers/riccati/stage_program.py. */
#ifndef IPTM_STAGES_H
#define IPTM_STAGES_H

#include <math.h>

#include "real.h"
#include "stage_sizes.h"

#ifdef IPTM_FLOAT
#define cos(x) cosf(x)
#define exp(x) expf(x)
#define fabs(x) fabsf(x)
#define fmax(x, y) fmaxf(x, y)
#define fmin(x, y) fminf(x, y)
#define log(x) logf(x)
#define pow(x, y) powf(x, y)
#define sin(x) sinf(x)
#define sqrt(x) sqrtf(x)
#endif

#define IPTM_BLOCK (IPTM_STATES + IPTM_INPUTS)

/* Evaluates a function of a stage for several steps; arguments and results begin at the first of them. */
typedef void (*iptm_stage_map)(const iptm_real *const *arg, iptm_real *const *res, int count);

/* One entry per stage kind. */
extern const iptm_stage_map iptm_linearise[], iptm_evaluate[], iptm_least_slacks[], iptm_hamiltonian[],
    iptm_follow[];
/* Parameters of a step. */
extern const int iptm_kind_parameters[];
/* Numbers of the model, of which the functions have none. */
#ifdef IPTM_NUMBERS_GIVEN
extern const iptm_real *iptm_numbers __attribute__((visibility("hidden")));
#else
extern const iptm_real iptm_numbers[];
#endif

/* One step of the recursions, see recursion.py. */
void riccati_backward(const iptm_real *const *arg, iptm_real *const *res);
void riccati_forward(const iptm_real *const *arg, iptm_real *const *res);

#endif

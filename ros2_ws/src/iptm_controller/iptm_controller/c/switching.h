/* The second start of solvers/switching_check.py in C99. */
#ifndef IPTM_SWITCHING_H
#define IPTM_SWITCHING_H

#include "riccati.h"
#include "switching_size_constants.h"

/* The plan, cooling from a block on at each level and as it is, and each block switched over. */
#define IPTM_PROPOSALS (1 + (IPTM_BLOCKS - 1) * (IPTM_LEVELS + 1) + IPTM_BLOCKS)

/* What the check compares; powers in scaled units. */
typedef struct {
  iptm_real candidates[IPTM_CANDIDATES]; /* off, and the most efficient power */
  iptm_real rate_1_s;                    /* largest change of the power */
  iptm_real levels[IPTM_LEVELS];         /* powers of the plans that are simulated */
  int try_every;                      /* solves until a second one is tried that promises little */
  int simulates;                      /* whether other plans are simulated */
} iptm_switching;

/* Number of reals that iptm_solve_checked works on. */
size_t iptm_checked_work_size(const iptm_horizon *horizon);

/* Solve a problem as iptm_solve does, and once more where switching the compressor may improve the plan.
 *
 * since_second: solves since the last one with a second start; read and written.
 * Returns the iterations of both solves. */
int iptm_solve_checked(const iptm_horizon *horizon, const iptm_options *options,
                       const iptm_switching *switching, const iptm_real *parameters,
                       const iptm_real *guess, int *since_second, iptm_real *variables, iptm_real *costates,
                       iptm_real *work, iptm_outcome *outcome);

#endif

/* Memory of a solve with its check, for those who reserve it statically. */
#ifndef IPTM_SOLVER_SIZE_H
#define IPTM_SOLVER_SIZE_H

#include "stage_sizes.h"
#include "switching.h"

#define IPTM_VARIABLES(steps) ((steps) * (IPTM_STATES + IPTM_INPUTS) + IPTM_STATES)
#define IPTM_WORK_PER_STEP                                                                        \
  (4 * IPTM_STATES + 8 * IPTM_INEQUALITIES + IPTM_DYNAMICS_NONZEROS + IPTM_HESSIAN_NONZEROS +     \
   3 * (IPTM_STATES + IPTM_INPUTS) + IPTM_STATES + IPTM_INEQUALITY_NONZEROS + IPTM_INEQUALITIES + \
   8 + IPTM_STATES * (IPTM_STATES + 1) / 2 + 2 * IPTM_STATES + 1 + IPTM_INPUTS * IPTM_STATES +    \
   2 * IPTM_INPUTS + IPTM_INEQUALITIES + IPTM_STATES + 1 + IPTM_SLACKS)
#define IPTM_WORK_SIZE(steps, most_iterations)                                          \
  (5 * IPTM_VARIABLES(steps) + 4 * IPTM_STATES + (steps) * IPTM_WORK_PER_STEP +         \
   IPTM_STATES * (IPTM_STATES + 1) / 2 + 2 * IPTM_STATES + 1 + 4 * ((most_iterations) + 1))
/* With the check: powers and Hamiltonians of three options, ramps, powers, gains, a second solution, and other
 * plans with their states, powers and costs. */
#define IPTM_CHECKED_WORK_SIZE(steps, most_iterations)                                      \
  (IPTM_WORK_SIZE(steps, most_iterations) + 9 * (steps) + 2 * IPTM_VARIABLES(steps) +       \
   (steps) * IPTM_STATES + IPTM_PROPOSALS * ((steps) + 2 * IPTM_STATES + 3))

#endif

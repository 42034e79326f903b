/* The interior-point method of docs/explanation/optimal-control.md in C99.
 *
 * Nothing is allocated and nothing is kept between calls: memory comes from the caller, and so does the clock.
 * Sizes of a stage (IPTM_...) are in stage_sizes.h, which is generated with the functions of the stages.
 * Vectors are laid out as in ocp/grid.py: x_0, u_0, x_1, u_1, ..., x_N, in scaled units. */
#ifndef IPTM_RICCATI_H
#define IPTM_RICCATI_H

#include <stddef.h>

#include "real.h"

/* Horizon of a problem. */
typedef struct {
  int steps;
  int most_iterations;       /* largest bound on the iterations of a solve; sizes the memory */
  const int *kind_steps;     /* steps of every stage kind, in order */
  const double *soft_prices; /* price of every slack, penalty times step length, IPTM_SLACKS per step */
  const double *lengths_s;   /* of the steps */
  const iptm_real *numbers;  /* of the model, NULL where they are constants beside the code */
} iptm_horizon;

typedef struct {
  iptm_real tolerance;          /* optimality error to reach */
  iptm_real initial_barrier;    /* of a warm start */
  double until_s;            /* reading of the clock at which to stop */
  double (*clock_s)(void);   /* NULL for no deadline */
  int warm_start_iterations; /* 0 begins with the cold start */
  int max_iterations;        /* over both starts, up to most_iterations of the horizon */
} iptm_options;

/* An iterate as the filter sees it. */
typedef struct {
  iptm_real cost, log_sum, violation, largest_violation;
} iptm_point;

typedef enum {
  IPTM_CONVERGED,
  IPTM_ITERATIONS,
  IPTM_DEADLINE,
  IPTM_STALLED,
  IPTM_NOT_FINITE
} iptm_termination;

typedef struct {
  iptm_point point; /* of the answer */
  int termination;
  int iterations;
  int cold_starts;
} iptm_outcome;

/* Number of reals that a solve works on; IPTM_WORK_SIZE in solver_size.h is the same for static memory. */
size_t iptm_work_size(const iptm_horizon *horizon);

/* Solve one problem. The guess begins with the present state; variables and costates are the answer. */
void iptm_solve(const iptm_horizon *horizon, const iptm_options *options, const iptm_real *parameters,
                const iptm_real *guess, iptm_real *variables, iptm_real *costates, iptm_real *work,
                iptm_outcome *outcome);

/* Whether an answer keeps dynamics and limits. */
int iptm_is_usable(const iptm_outcome *outcome);

#endif

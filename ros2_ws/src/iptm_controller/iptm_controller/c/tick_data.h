/* From the last plan and the motion ahead to the numbers of the next problem, and from its solution to a plan:
 * plan.py and ocp/data.py in C99, the same operations in the same order.
 *
 * States and inputs of a plan are in physical units, node after node and step after step, in the order of
 * ocp/layout.py. */
#ifndef IPTM_TICK_DATA_H
#define IPTM_TICK_DATA_H

#include "layout.h"
#include "real.h"
#include "vehicle.h"

/* The grid of a horizon, see ocp/grid.py; arrays have one entry per step or sample unless stated. */
typedef struct {
  int steps, motion_steps, samples, motion_samples;
  const double *nodes_s; /* steps + 1 */
  const double *lengths_s;
  const double *acceleration_intervals_s, *compressor_intervals_s;
  const double *sample_times_s;
  const int *sample_steps; /* step that a sample is in */
  const int *step_places;  /* first parameter of a step */
  const int *sample_places;
  double max_speed_m_s;
} iptm_grid;

/* Motion of a lead vehicle at increasing times; bounds_m: how far it may be behind, NULL where that is known. */
typedef struct {
  int nodes;
  const double *times_s, *positions_m, *speeds_m_s, *bounds_m;
} iptm_motion;

/* Slope at increasing positions; the ends are held. */
typedef struct {
  int nodes;
  const double *positions_m, *slopes_rad;
} iptm_slope;

/* Weights of the cost, their common factor, and the temperatures that they refer to. */
typedef struct {
  double scale, weights[IPTM_WEIGHTS], reference_temperature_k, min_temperature_k, coldest_below_limit_k;
  double headway_price_1_m2_s;
} iptm_strategy;

/* Prices of the temperatures at the end of the horizon, see temperature_value.py; all zero for none. */
typedef struct {
  double cell_1_marginal_cost_1_k, cell_n_marginal_cost_1_k, temperature_weight_1_k2_s;
  double reference_temperature_k, thermal_energy_price_1_j;
} iptm_prices;

/* What a problem is posed with, beside the state and the expected plan. */
typedef struct {
  const iptm_motion *motion;   /* past and expected motion of the leader */
  const iptm_motion *limiting; /* motion that the gap limits hold for, may be the same */
  const iptm_slope *slope;
  const double *speed_limits_m_s; /* at the ends of the motion steps, NULL for none */
  const double *thermal_samples;  /* parameters of the thermal samples, NULL without any */
  double known_s;                 /* how far ahead the motion is known */
  double charge_w; /* largest charging power of the pack; it counts where the pack has limits */
  double follows;  /* 1: a lead vehicle is ahead, 0: only rules of the road */
  iptm_prices prices;
} iptm_ahead;

/* Interpolate between values `stride` apart at increasing places; the ends are held, as in numpy.interp. */
double iptm_interpolate(double x, const double *places, const double *values, int stride,
                        int size);

/* Position and speed of a motion, see LeaderPreview.at. */
double iptm_motion_at(const iptm_motion *motion, double time_s, double *speed_m_s);

/* Move a plan on to a later state, states and inputs as seen from there; states NULL: without a plan, speed and
 * power of the compressor are kept. */
void iptm_shift_plan(const iptm_grid *grid, double start_s, const double *states,
                     const double *inputs, const iptm_vehicle *vehicle, double *next_states,
                     double *next_inputs);

/* Pose the problem of a tick around the plan of next_states and next_inputs.
 *
 * variables: the plan in the units of the solver. parameters: of the problem. */
void iptm_pose_problem(const iptm_grid *grid, const iptm_strategy *strategy,
                       const iptm_vehicle *vehicle, const iptm_ahead *ahead, const double *states,
                       const double *inputs, iptm_real *variables, iptm_real *parameters);

/* Return a solution in physical units. */
void iptm_read_plan(const iptm_grid *grid, double position_m, const iptm_real *variables,
                    double *states, double *inputs);

#endif

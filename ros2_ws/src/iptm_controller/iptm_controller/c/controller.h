/* One tick of the controller: forecast, problem, solution, fallback, limiter. C99, nothing is allocated.
 *
 * In here: the forecast of the leader with the trust in its previews, the prices of the temperatures by the law of
 * the paper, the last plan moved on, the problem of the tick, the interior-point method with its second start, the rungs of the fallback ladder and the limiter. Not in
 * here, and to be done before: observers of pack and actuators, filters of noise, rules of the road as a lead
 * motion, the limits of pack and drive; after: the collision guard (guard.h has what it looks at).
 *
 * Whatever is given, a command is finite and within the bounds. What is not finite or out of range counts as not
 * measured, see sound.h: without a sound motion the vehicle is braked blindly, without a sound road, leader or
 * pack the last plan is driven on and then the vehicle is stopped. Arrays have to be as long as stated. */
#ifndef IPTM_CONTROLLER_H
#define IPTM_CONTROLLER_H

#include "controller_data.h"
#include "limiter.h"
#include "riccati.h"
#include "solver_size.h"
#include "sound.h"
#include "switching.h"
#include "tick_data.h"

/* Where a command comes from. */
typedef enum {
  IPTM_OPTIMAL = 0,
  IPTM_SHIFTED_PLAN = 1,
  IPTM_SAFE_LAW = 2,
  IPTM_STOP = 3
} iptm_rung;

/* Inputs of a tick. */
typedef struct {
  const iptm_vehicle *vehicle; /* NULL: nothing is measured */
  const iptm_leader *leader;   /* as measured; NULL: no leader is measured */
  const iptm_motion *preview;  /* of the leader, the newest one received; NULL: `ahead` has its motion */
  iptm_ahead ahead;            /* without preview and motion no problem is posed */
  /* Aging rate of both cells, from the start of the trip expected for it: prices are worked out; 0: `ahead` has
   * them. */
  double foreseen_1_s;
  const double *most_acceleration_m_s2; /* that pack and drive can supply; NULL for no bound */
  double (*clock_s)(void);      /* NULL for no deadline */
  double until_s;               /* reading of the clock at which the solver stops */
} iptm_inputs;

/* State carried from tick to tick. All zero begins a trip. */
typedef struct {
  int has_plan, failures, has_trusted, has_solved, since_second, has_begun;
  double begun_s, begun_loss;  /* time and losses of both cells where the trip began */
  double start_s; /* trip time of the plan's first node */
  double states[(IPTM_STEPS + 1) * IPTM_STATES];
  double inputs[IPTM_STEPS * IPTM_INPUTS];
  iptm_forecast_memory forecast;
  iptm_leader leaders[IPTM_PAST_ROOM];
  double predictions[IPTM_PREDICTIONS * (2 + IPTM_LEADS)], previews[4 * IPTM_PREVIEW_ROOM];
  iptm_vehicle trusted; /* that commands are limited against where nothing is measured */
} iptm_memory;

/* What a tick works on; its content means nothing between ticks. */
typedef struct {
  double states[(IPTM_STEPS + 1) * IPTM_STATES], inputs[IPTM_STEPS * IPTM_INPUTS];
  double motion[5 * (IPTM_PAST_ROOM + IPTM_PREVIEW_ROOM + IPTM_EXTRAPOLATED_NODES)];
  double previews[5 * IPTM_PREVIEW_ROOM];
  iptm_real guess[IPTM_VARIABLES(IPTM_STEPS)], variables[IPTM_VARIABLES(IPTM_STEPS)];
  iptm_real costates[IPTM_STEPS * IPTM_STATES], parameters[IPTM_PARAMETERS];
  iptm_real solver[IPTM_CHECKED_WORK_SIZE(IPTM_STEPS, IPTM_MAX_ITERATIONS)];
} iptm_scratch;

typedef struct {
  iptm_command command;
  iptm_rung rung;
  unsigned unsound; /* inputs that could not be used, see sound.h */
  unsigned limits; /* bounds of the limiter that changed the command, see limiter.h */
  int iterations;
  iptm_forecast forecast; /* in the scratch; means nothing without leader and preview */
  iptm_outcome outcome; /* of the solver; means nothing without a problem */
} iptm_decision;

/* Decide one tick. */
iptm_decision iptm_decide(iptm_memory *memory, iptm_scratch *scratch, const iptm_inputs *inputs);

#endif

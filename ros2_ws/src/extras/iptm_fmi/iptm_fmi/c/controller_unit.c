/* The controller as a unit: it decides at its ticks, from what its inputs are at the beginning of a step. */
#include <math.h>
#include <string.h>

#include "descent.h"
#include "road.h"
#include "unit.h"
#include "unit_constants.h"

iptm_result iptm_unit_begin(iptm_instance *instance) {
  instance->now.values[V_RUNG] = IPTM_STOP;
  return IPTM_DONE;
}

/* The first input that no decision can be made of, as a message. */
static iptm_result checked(iptm_instance *instance) {
  const double *const values = instance->now.values;
  const int nodes = (int)values[V_PREVIEW_NODES];
  const int road = iptm_road_fault((int)values[V_ROAD_NODES], values + V_ROAD_POSITION);
  const int preview = iptm_road_fault(nodes, values + V_PREVIEW_TIME);
  if (road > 0)
    return iptm_fail(instance, IPTM_DISCARDED, "road_position[%d] is %g m; allowed: above %g m", road + 1,
                     values[V_ROAD_POSITION + road], values[V_ROAD_POSITION + road - 1]);
  if (preview > 0)
    return iptm_fail(instance, IPTM_DISCARDED, "preview_time[%d] is %g s; allowed: above %g s", preview + 1,
                     values[V_PREVIEW_TIME + preview], values[V_PREVIEW_TIME + preview - 1]);
  return IPTM_DONE;
}

static void decide(iptm_state *now) {
  double *const values = now->values;
  iptm_vehicle vehicle;
  iptm_leader leader;
  iptm_motion preview;
  iptm_slope slope;
  iptm_inputs inputs;
  iptm_decision decision;
  int i;
  memset(&preview, 0, sizeof(preview));
  memset(&inputs, 0, sizeof(inputs));
  vehicle.time_s = leader.time_s = now->time_s;
  vehicle.position_m = values[V_POSITION];
  vehicle.speed_m_s = values[V_SPEED];
  vehicle.acceleration_m_s2 = values[V_ACCELERATION];
  vehicle.compressor_power_w = values[V_COMPRESSOR_POWER];
  vehicle.cell_1_temperature_k = values[V_CELL_1_TEMPERATURE];
  vehicle.cell_n_temperature_k = values[V_CELL_N_TEMPERATURE];
  vehicle.cell_1_capacity_loss = values[V_CELL_1_LOSS];
  vehicle.cell_n_capacity_loss = values[V_CELL_N_LOSS];
  leader.position_m = values[V_LEADER_POSITION];
  leader.speed_m_s = values[V_LEADER_SPEED];
  preview.nodes = (int)values[V_PREVIEW_NODES];
  preview.times_s = values + V_PREVIEW_TIME;
  preview.positions_m = values + V_PREVIEW_POSITION;
  preview.speeds_m_s = values + V_PREVIEW_SPEED;
  slope.nodes = (int)values[V_ROAD_NODES];
  slope.positions_m = values + V_ROAD_POSITION;
  slope.slopes_rad = values + V_ROAD_SLOPE;
  if (slope.nodes == 0) { /* a level road */
    static const double nowhere = 0.0;
    slope.nodes = 1;
    slope.positions_m = slope.slopes_rad = &nowhere;
  }
  leader.position_m -= iptm_steep_m(
      &iptm_limits_of_model, leader.speed_m_s, vehicle.speed_m_s,
      iptm_slope_at(slope.nodes, slope.positions_m, slope.slopes_rad, vehicle.position_m));
  inputs.vehicle = &vehicle;
  inputs.leader = &leader;
  inputs.preview = &preview;
  inputs.ahead.slope = &slope;
  inputs.ahead.charge_w = values[V_CHARGE_LIMIT];
  inputs.foreseen_1_s = values[V_FORESEEN_AGING_RATE];
  decision = iptm_decide(&now->memory.memory, &now->memory.scratch, &inputs);
  values[V_ACCELERATION_COMMAND] = decision.command.acceleration_m_s2;
  values[V_COMPRESSOR_POWER_COMMAND] = decision.command.compressor_power_w;
  values[V_RUNG] = decision.rung;
  values[V_LIMITS] = decision.limits;
  values[V_ITERATIONS] = decision.iterations;
  for (i = 0; i < IPTM_PLAN_NODES; ++i) {
    const double *const state = now->memory.memory.states + i * IPTM_STATES;
    values[V_PLAN_POSITION + i] = state[IPTM_STATE_POSITION];
    values[V_PLAN_SPEED + i] = state[IPTM_STATE_SPEED];
    values[V_PLAN_CELL_1_TEMPERATURE + i] = state[IPTM_STATE_CELL_1_TEMPERATURE];
  }
}

iptm_result iptm_unit_step(iptm_instance *instance, double length_s) {
  iptm_state *const now = &instance->now;
  const double end_s = now->time_s + length_s;
  const iptm_result result = checked(instance);
  if (result != IPTM_DONE) return result;
  if (!now->memory.has_ticked) now->memory.next_tick_s = now->time_s;
  now->values[V_HELD] = 1.0;
  if (now->time_s >= now->memory.next_tick_s - TOLERANCE_S) {
    decide(now);
    now->values[V_HELD] = 0.0;
    now->memory.has_ticked = 1;
    now->memory.next_tick_s += IPTM_TICK_S;
  }
  /* Ticks inside a step that is longer than one are not decided: the command is held over them. */
  while (now->memory.next_tick_s < end_s - TOLERANCE_S) {
    now->memory.next_tick_s += IPTM_TICK_S;
    now->values[V_MISSED_TICKS] += 1.0;
  }
  return IPTM_DONE;
}

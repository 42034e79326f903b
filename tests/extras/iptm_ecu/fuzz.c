/* Decides random ticks of which some numbers are not finite, absurd or missing.
 *
 * usage: fuzz TICKS SEED
 * Ends with 1 where a command is not finite or not within the bounds; a sanitizer ends it before. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "controller.h"

enum { TRIP = 500, NODES = IPTM_PREVIEW_ROOM + 2 };

static iptm_memory memory;
static iptm_scratch scratch;
static unsigned long long drawn;

static double uniform(double low, double high) {
  drawn = drawn * 6364136223846793005ULL + 1442695040888963407ULL;
  return low + (high - low) * (double)(drawn >> 11) / 9007199254740992.0;
}

static int one_in(int count) { return uniform(0.0, count) < 1.0; }

/* Return a value, or now and then something else. */
static double spoilt(double value) {
  static const double absurd[] = {0.0, -0.0, 1e300, -1e300, -1e6, 1e-300, INFINITY, -INFINITY, NAN};
  if (!one_in(60)) return value;
  return absurd[(int)uniform(0.0, sizeof(absurd) / sizeof(*absurd))];
}

static int is_bounded(const iptm_command *command) {
  const iptm_limits *limits = &iptm_limits_of_model;
  return command->acceleration_m_s2 >= limits->min_acceleration_m_s2 &&
         command->acceleration_m_s2 <= limits->max_acceleration_m_s2 &&
         command->compressor_power_w >= limits->lowest_thermal_power_w &&
         command->compressor_power_w <= limits->max_compressor_power_w;
}

int main(int count, char **arguments) {
  static double times[NODES], positions[NODES], speeds[NODES], bounds[NODES], places[4], slopes[4];
  static double limits[IPTM_STEPS];
  const int ticks = count > 1 ? atoi(arguments[1]) : 0;
  int tick, i, unbounded = 0, rungs[IPTM_STOP + 1] = {0};
  drawn = count > 2 ? strtoull(arguments[2], NULL, 10) : 0ULL;
  for (tick = 0; tick < ticks; ++tick) {
    const double time_s = tick % TRIP, position_m = 20.0 * time_s, temperature_k = uniform(250.0, 320.0);
    const double most_m_s2 = spoilt(uniform(-0.5, 3.0));
    iptm_motion preview = {0, times, positions, speeds, NULL};
    iptm_slope slope = {4, places, slopes};
    iptm_inputs inputs;
    iptm_vehicle vehicle;
    iptm_leader leader;
    iptm_decision decision;
    memset(&inputs, 0, sizeof(inputs));
    if (tick % TRIP == 0) memset(&memory, 0, sizeof(memory));
    vehicle.time_s = spoilt(time_s);
    vehicle.position_m = spoilt(position_m);
    vehicle.speed_m_s = spoilt(uniform(0.0, 40.0));
    vehicle.cell_1_temperature_k = spoilt(temperature_k);
    vehicle.cell_n_temperature_k = spoilt(temperature_k + 1.0);
    vehicle.acceleration_m_s2 = spoilt(uniform(-3.0, 3.0));
    vehicle.compressor_power_w = spoilt(uniform(0.0, 5000.0));
    vehicle.cell_1_capacity_loss = spoilt(1e-3);
    vehicle.cell_n_capacity_loss = spoilt(1e-3);
    leader.time_s = spoilt(time_s - (one_in(9) ? uniform(0.0, 70.0) : 0.0));
    leader.position_m = spoilt(position_m + uniform(-5.0, 100.0));
    leader.speed_m_s = spoilt(uniform(0.0, 40.0));
    preview.nodes = one_in(9) ? (int)uniform(-2.0, NODES) : 40;
    for (i = 0; i < NODES; ++i) {
      times[i] = one_in(9) ? spoilt(time_s + i) : time_s + i;
      positions[i] = one_in(9) ? spoilt(leader.position_m + 20.0 * i) : leader.position_m + 20.0 * i;
      speeds[i] = one_in(9) ? spoilt(20.0) : 20.0;
      bounds[i] = one_in(9) ? spoilt(0.01 * i * i) : 0.01 * i * i;
    }
    for (i = 0; i < 4; ++i) {
      places[i] = spoilt(1000.0 * i);
      slopes[i] = spoilt(uniform(-0.05, 0.05));
    }
    for (i = 0; i < IPTM_STEPS; ++i) limits[i] = spoilt(uniform(10.0, 50.0));
    if (one_in(4)) preview.bounds_m = bounds;
    if (one_in(40)) slope.nodes = (int)uniform(-1.0, 2.0);
    if (!one_in(40)) inputs.vehicle = &vehicle;
    if (!one_in(20)) inputs.leader = &leader;
    if (!one_in(10)) inputs.preview = &preview;
    if (one_in(10)) inputs.ahead.motion = inputs.ahead.limiting = &preview;
    if (one_in(4)) inputs.ahead.speed_limits_m_s = limits;
    if (one_in(4)) inputs.most_acceleration_m_s2 = &most_m_s2;
    if (!one_in(40)) inputs.ahead.slope = &slope;
    inputs.ahead.known_s = spoilt(20.0);
    inputs.ahead.charge_w = spoilt(5e4);
    inputs.ahead.prices.cell_1_marginal_cost_1_k = spoilt(1e-9);
    inputs.foreseen_1_s = spoilt(uniform(0.0, 1e-10));
    decision = iptm_decide(&memory, &scratch, &inputs);
    ++rungs[decision.rung];
    unbounded += !is_bounded(&decision.command);
  }
  printf("%d ticks, %d commands out of bounds; rungs", ticks, unbounded);
  for (i = 0; i <= IPTM_STOP; ++i) printf(" %d", rungs[i]);
  printf("\n");
  return unbounded != 0;
}

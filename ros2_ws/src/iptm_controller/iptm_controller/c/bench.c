/* Drives the controller through recorded ticks and compares its commands with the recorded ones.
 *
 * usage: bench TICKS [DECISIONS]
 * TICKS holds doubles of this computer. DECISIONS is written, a line for each tick: differences of both commands,
 * rung, iterations, cost, instructions.
 * Ends with 0 where every command is within the tolerance, else with 1. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "controller.h"

#define MOST_NODES 8192

#ifdef IPTM_FLOAT /* other choices between plans of nearly the same cost */
static const double ACCELERATION_TOLERANCE = 0.5;
static const double POWER_TOLERANCE = 500.0;
#else
static const double ACCELERATION_TOLERANCE = 1e-12; /* m/s^2 */
static const double POWER_TOLERANCE = 1e-9;         /* W */
#endif

static iptm_memory memory;
static iptm_scratch scratch;
static double tables[6][MOST_NODES];

static double number(FILE *file) {
  double value = 0.0;
  if (fread(&value, sizeof(value), 1, file) != 1) {
    fprintf(stderr, "bench: the file of the ticks is cut\n");
    exit(2);
  }
  return value;
}

static int numbers(FILE *file, int columns, double (*into)[MOST_NODES]) {
  const int size = (int)number(file);
  int column, i;
  if (size < 0 || size > MOST_NODES) {
    fprintf(stderr, "bench: %d nodes; allowed: 0 to %d\n", size, MOST_NODES);
    exit(2);
  }
  for (column = 0; column < columns; ++column) {
    for (i = 0; i < size; ++i) into[column][i] = number(file);
  }
  return size;
}

#ifdef BENCH_COUNTER
unsigned long BENCH_COUNTER(void); /* instructions so far, on a target that counts them */
#else
#define BENCH_COUNTER() 0UL
#endif

int main(int count, char **arguments) {
  FILE *file = count > 1 ? fopen(arguments[1], "rb") : NULL;
  FILE *decisions = count > 2 ? fopen(arguments[2], "w") : NULL;
  double worst_acceleration = 0.0, worst_power = 0.0;
  int ticks, tick, other_rungs = 0, iterations = 0;
  if (file == NULL || (count > 2 && decisions == NULL)) {
    fprintf(stderr, "usage: bench TICKS [DECISIONS]\n");
    return 2;
  }
  ticks = (int)number(file);
  for (tick = 0; tick < ticks; ++tick) {
    iptm_vehicle vehicle;
    iptm_leader leader;
    iptm_motion preview = {0};
    iptm_slope slope;
    iptm_inputs inputs = {0};
    iptm_decision decision;
    double acceleration, power, most_acceleration;
    unsigned long started;
    int rung;
    vehicle.time_s = number(file);
    vehicle.position_m = number(file);
    vehicle.speed_m_s = number(file);
    vehicle.cell_1_temperature_k = number(file);
    vehicle.cell_n_temperature_k = number(file);
    vehicle.acceleration_m_s2 = number(file);
    vehicle.compressor_power_w = number(file);
    inputs.vehicle = &vehicle;
    vehicle.cell_1_capacity_loss = number(file);
    vehicle.cell_n_capacity_loss = number(file);
    leader.time_s = vehicle.time_s;
    leader.position_m = number(file);
    leader.speed_m_s = number(file);
    inputs.leader = &leader;
    inputs.ahead.charge_w = number(file);
    inputs.ahead.prices.cell_1_marginal_cost_1_k = number(file);
    inputs.ahead.prices.cell_n_marginal_cost_1_k = number(file);
    inputs.ahead.prices.temperature_weight_1_k2_s = number(file);
    inputs.ahead.prices.reference_temperature_k = number(file);
    inputs.ahead.prices.thermal_energy_price_1_j = number(file);
    inputs.foreseen_1_s = number(file);
    most_acceleration = number(file);
    inputs.most_acceleration_m_s2 = &most_acceleration;
    preview.nodes = numbers(file, 3, tables);
    preview.times_s = tables[0];
    preview.positions_m = tables[1];
    preview.speeds_m_s = tables[2];
    slope.nodes = numbers(file, 2, tables + 3);
    slope.positions_m = tables[3];
    slope.slopes_rad = tables[4];
    if (numbers(file, 1, tables + 5) > 0) inputs.ahead.speed_limits_m_s = tables[5];
    inputs.preview = &preview;
    inputs.ahead.slope = &slope;
    acceleration = number(file);
    power = number(file);
    rung = (int)number(file);
    started = BENCH_COUNTER();
    decision = iptm_decide(&memory, &scratch, &inputs);
    if (decisions != NULL) {
      (void)fprintf(decisions, "%.17g %.17g %d %d %.17g %lu\n", decision.command.acceleration_m_s2 - acceleration,
                    decision.command.compressor_power_w - power, (int)decision.rung, decision.iterations,
                    (double)decision.outcome.point.cost, BENCH_COUNTER() - started);
    }
    worst_acceleration =
        fmax(worst_acceleration, fabs(decision.command.acceleration_m_s2 - acceleration));
    worst_power = fmax(worst_power, fabs(decision.command.compressor_power_w - power));
    other_rungs += (int)decision.rung != rung;
    iterations += decision.iterations;
  }
  (void)fclose(file);
  if (decisions != NULL) (void)fclose(decisions);
  printf("%d ticks, %d iterations; largest difference %.3g m/s^2 and %.3g W; %d other rungs\n", ticks,
         iterations, worst_acceleration, worst_power, other_rungs);
  printf("memory %lu bytes, scratch %lu bytes\n", (unsigned long)sizeof(memory),
         (unsigned long)sizeof(scratch));
  return worst_acceleration <= ACCELERATION_TOLERANCE && worst_power <= POWER_TOLERANCE &&
                 other_rungs == 0
             ? 0
             : 1;
}

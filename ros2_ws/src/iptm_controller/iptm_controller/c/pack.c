#include "pack.h"
#include "pack_constants.h"

#include <math.h>

enum { NUMBERS = sizeof(iptm_vehicle) / sizeof(double) };

static double least(double x, double y) { return y < x ? y : x; }
static double most(double x, double y) { return y > x ? y : x; }

static int is_temperature(const iptm_pack *pack, double value_k) {
  return pack->low[3] <= value_k && value_k <= pack->high[3];
}

/* SensorMemory.judged of a sensor that is used; returns whether it stays so. */
static int judge(const iptm_pack *pack, iptm_sensor *sensor, double value_k, double by_k,
                 double elapsed_s) {
  const double model_k = sensor->model_k + by_k, apart_k = value_k - model_k;
  const double noise_k = pack->noise_factor * sqrt(sensor->noise_k2);
  const double tolerance_k = least(most(pack->tolerance_k, noise_k), 2.0 * pack->tolerance_k);
  double moved_k = sensor->moved_k + fabs(by_k);
  if (value_k != sensor->value_k) {
    moved_k = 0.0;
    if (isfinite(sensor->value_k)) {
      sensor->step_k = least(sensor->step_k, fabs(value_k - sensor->value_k));
    }
  }
  if (moved_k > most(pack->stuck_k, pack->stuck_steps * sensor->step_k)) return 0;
  if (!(fabs(apart_k) <= tolerance_k)) return 0;
  sensor->model_k = model_k;
  sensor->value_k = value_k;
  sensor->moved_k = moved_k;
  sensor->noise_k2 +=
      least(elapsed_s / NOISE_TIME_S, 1.0) * (apart_k * apart_k - sensor->noise_k2);
  sensor->sound_s += elapsed_s;
  return 1;
}

/* How much warmer the cells are than their models by the coolant, 0 where it does not show. */
static double offset_k(const iptm_pack *pack, const iptm_sensor *sensors,
                       const iptm_pack_reading *reading) {
  const double weight = pack->cell_1 + pack->cell_n;
  double expected_k;
  if (weight == 0.0 || !is_temperature(pack, reading->inlet_k) ||
      !is_temperature(pack, reading->outlet_k)) {
    return 0.0;
  }
  expected_k = pack->inlet * reading->inlet_k + pack->cell_1 * sensors[0].model_k +
               pack->cell_n * sensors[1].model_k;
  return (reading->outlet_k - expected_k) / weight;
}

/* CoolingMemory.after; returns whether the cooling follows and has an effect. */
static int cools(const iptm_pack *pack, iptm_pack_memory *memory, const iptm_pack_reading *reading,
                 double drawn_w, double elapsed_s) {
  const double lost_k = reading->outlet_k - reading->inlet_k, asked_w = reading->asked_w;
  /* A car without sensors of the coolant shows no effect, and lacks none. */
  if (isfinite(lost_k) && fabs(reading->cooling_w) > pack->effect_w) {
    const int works = pack->flow_w_k * lost_k / reading->cooling_w >= pack->effect_share;
    memory->without_effect_s = works ? 0.0 : memory->without_effect_s + elapsed_s;
  }
  if (fabs(asked_w) > pack->follow_w) {
    const int ignored = drawn_w / asked_w < pack->follow_share;
    memory->unfollowed_s = ignored ? memory->unfollowed_s + elapsed_s : 0.0;
  } else if (fabs(drawn_w) > pack->follow_w) {
    memory->unfollowed_s = 0.0; /* it follows late */
  }
  return memory->without_effect_s <= pack->effect_s && memory->unfollowed_s <= pack->follow_s;
}

int iptm_watch_pack(const iptm_pack *pack, iptm_pack_memory *memory, const iptm_vehicle *vehicle,
                    const iptm_pack_reading *reading) {
  const double *const numbers = &vehicle->time_s;
  const double elapsed_s = vehicle->time_s - memory->time_s;
  const double values_k[] = {vehicle->cell_1_temperature_k, vehicle->cell_n_temperature_k};
  const double gain = least(pack->correction_1_s * elapsed_s, 1.0);
  iptm_pack_memory next = *memory;
  int i;
  for (i = 0; i < NUMBERS; ++i) {
    if (!(pack->low[i] <= numbers[i] && numbers[i] <= pack->high[i])) return 0;
  }
  if (!(0.0 < elapsed_s && elapsed_s <= pack->most_tick_s)) return 0;
  for (i = 0; i < 2; ++i) {
    iptm_sensor *const sensor = next.sensors + i;
    if (sensor->bad_s != 0.0) return 0;
    if (!judge(pack, sensor, values_k[i], reading->rates_k_s[i] * elapsed_s, elapsed_s)) return 0;
  }
  if (!(fabs(offset_k(pack, next.sensors, reading)) <= pack->contradiction_k)) return 0;
  for (i = 0; i < 2; ++i) {
    iptm_sensor *const sensor = next.sensors + i;
    sensor->model_k += gain * (values_k[i] - sensor->model_k);
  }
  next.time_s = vehicle->time_s;
  next.age_s += elapsed_s;
  next.contradicted_s = 0.0;
  if (!cools(pack, &next, reading, vehicle->compressor_power_w, elapsed_s)) return 0;
  *memory = next;
  return 1;
}

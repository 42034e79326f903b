#include "sound.h"

#include <float.h>
#include <math.h>
#include <stddef.h>

#include "sound_constants.h"

static int is_within(double value, double low, double high) { return low <= value && value <= high; }

static int are_within(const double *values, int count, double low, double high) {
  int i;
  for (i = 0; i < count; ++i) {
    if (!is_within(values[i], low, high)) return 0;
  }
  return 1;
}

static int are_increasing(const double *values, int count) {
  int i;
  for (i = 1; i < count; ++i) {
    if (!(values[i] > values[i - 1])) return 0;
  }
  return count > 0 && isfinite(values[0]) && isfinite(values[count - 1]);
}

static int is_motion(const iptm_vehicle *low, const iptm_vehicle *high, const iptm_vehicle *v) {
  return is_within(v->time_s, low->time_s, high->time_s) &&
         is_within(v->position_m, low->position_m, high->position_m) &&
         is_within(v->speed_m_s, low->speed_m_s, high->speed_m_s) &&
         is_within(v->acceleration_m_s2, low->acceleration_m_s2, high->acceleration_m_s2);
}

static int is_pack(const iptm_vehicle *low, const iptm_vehicle *high, const iptm_vehicle *v) {
  return is_within(v->cell_1_temperature_k, low->cell_1_temperature_k, high->cell_1_temperature_k) &&
         is_within(v->cell_n_temperature_k, low->cell_n_temperature_k, high->cell_n_temperature_k) &&
         is_within(v->compressor_power_w, low->compressor_power_w, high->compressor_power_w) &&
         is_within(v->cell_1_capacity_loss, low->cell_1_capacity_loss, high->cell_1_capacity_loss) &&
         is_within(v->cell_n_capacity_loss, low->cell_n_capacity_loss, high->cell_n_capacity_loss);
}

static int is_ahead(const iptm_leader *leader, const iptm_vehicle *vehicle) {
  return is_within(leader->speed_m_s, SPEED_AT_REST_M_S, MAX_SPEED_M_S) &&
         fabs(leader->time_s - vehicle->time_s) <= MAX_TIME_APART_S &&
         fabs(leader->position_m - vehicle->position_m) <= LARGEST_GAP_M;
}

static int is_known(const iptm_motion *motion) {
  return motion == NULL || (are_increasing(motion->times_s, motion->nodes) &&
                            are_within(motion->positions_m, motion->nodes, -DBL_MAX, DBL_MAX) &&
                            are_within(motion->speeds_m_s, motion->nodes, SPEED_AT_REST_M_S, MAX_SPEED_M_S));
}

static int is_road(const iptm_grid *grid, const iptm_ahead *ahead) {
  const iptm_prices *prices = &ahead->prices;
  const double numbers[] = {prices->cell_1_marginal_cost_1_k,
                            prices->cell_n_marginal_cost_1_k,
                            prices->temperature_weight_1_k2_s,
                            prices->reference_temperature_k,
                            prices->thermal_energy_price_1_j,
                            ahead->known_s,
                            ahead->follows};
  return ahead->slope != NULL && are_increasing(ahead->slope->positions_m, ahead->slope->nodes) &&
         are_within(ahead->slope->slopes_rad, ahead->slope->nodes, -STEEPEST_RAD, STEEPEST_RAD) &&
         are_within(numbers, (int)(sizeof(numbers) / sizeof(*numbers)), -DBL_MAX, DBL_MAX) &&
         is_within(ahead->charge_w, 0.0, DBL_MAX) &&
         (ahead->speed_limits_m_s == NULL ||
          are_within(ahead->speed_limits_m_s, grid->motion_steps, 0.0, DBL_MAX)) &&
         is_known(ahead->motion) && is_known(ahead->limiting);
}

unsigned iptm_unsound(const iptm_grid *grid, const iptm_vehicle *lowest, const iptm_vehicle *highest,
                      const iptm_vehicle *vehicle, const iptm_leader *leader, const iptm_ahead *ahead) {
  unsigned found = 0U;
  if (!is_motion(lowest, highest, vehicle)) found |= IPTM_UNSOUND_MOTION;
  if (!is_pack(lowest, highest, vehicle)) found |= IPTM_UNSOUND_PACK;
  if (leader != NULL && !is_ahead(leader, vehicle)) found |= IPTM_UNSOUND_LEADER;
  if (!is_road(grid, ahead)) found |= IPTM_UNSOUND_AHEAD;
  return found;
}

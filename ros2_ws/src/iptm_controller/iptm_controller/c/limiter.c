#include "limiter.h"
#include "limiter_constants.h"

#include <math.h>

/* NaN becomes the lower bound. */
static double clamp(double value, double low, double high) {
  const double raised = low > value || isnan(value) ? low : value;
  return high < raised ? high : raised;
}

/* Clamp a value; returns the bit where that changed it by more than round-off. */
static unsigned bound(double *value, double low, double high, double tolerance, unsigned bit) {
  const double clamped = clamp(*value, low, high);
  const unsigned changed = fabs(clamped - *value) > tolerance ? bit : 0U;
  *value = clamped;
  return changed;
}

unsigned iptm_limit_command(const iptm_limits *limits, const iptm_vehicle *vehicle,
                            iptm_command *command) {
  const double jerk_step = limits->max_jerk_m_s3 * limits->tick_s;
  const double rate_step = limits->max_compressor_rate_w_s * limits->tick_s;
  const double last_acceleration = clamp(vehicle->acceleration_m_s2, limits->min_acceleration_m_s2,
                                         limits->max_acceleration_m_s2);
  const double last_power = clamp(vehicle->compressor_power_w, limits->lowest_thermal_power_w,
                                  limits->max_compressor_power_w);
  const double to_top_speed = (limits->max_speed_m_s - vehicle->speed_m_s) / limits->tick_s;
  const double lowest = limits->min_acceleration_m_s2;
  double acceleration = command->acceleration_m_s2, power = command->compressor_power_w;
  unsigned changed = 0U;
  if (!isfinite(acceleration)) {
    acceleration = last_acceleration < 0.0 ? last_acceleration : 0.0;
    changed |= IPTM_LIMIT_ACCELERATION_NOT_FINITE;
  }
  if (!isfinite(power)) {
    power = last_power;
    changed |= IPTM_LIMIT_POWER_NOT_FINITE;
  }
  /* Bounds first, rates last: the rate limits are what the actuators cannot exceed. */
  changed |= bound(&acceleration, lowest, limits->max_acceleration_m_s2, TOLERANCE,
                   IPTM_LIMIT_ACCELERATION);
  changed |= bound(&acceleration, -INFINITY, lowest > to_top_speed ? lowest : to_top_speed,
                   TOLERANCE, IPTM_LIMIT_TOP_SPEED);
  changed |= bound(&acceleration, last_acceleration - jerk_step, last_acceleration + jerk_step,
                   TOLERANCE, IPTM_LIMIT_JERK);
  changed |= bound(&power, limits->lowest_thermal_power_w, limits->max_compressor_power_w,
                   POWER_TOLERANCE_W, IPTM_LIMIT_POWER);
  changed |= bound(&power, last_power - rate_step, last_power + rate_step, POWER_TOLERANCE_W,
                   IPTM_LIMIT_POWER_RATE);
  command->acceleration_m_s2 = acceleration;
  command->compressor_power_w = power;
  return changed;
}

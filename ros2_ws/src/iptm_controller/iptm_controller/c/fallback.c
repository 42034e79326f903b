#include "fallback.h"
#include "fallback_constants.h"

#include <math.h>
#include <stddef.h>

static double larger(double first, double second) { return second > first ? second : first; }
static double smaller(double first, double second) { return second < first ? second : first; }

static double thermostat_power_w(const iptm_limits *limits, const iptm_vehicle *vehicle) {
  const double warmest = larger(vehicle->cell_1_temperature_k, vehicle->cell_n_temperature_k);
  const double demand = (warmest - THERMOSTAT_ON_K) / THERMOSTAT_SPAN_K;
  return smaller(THERMOSTAT_POWER_W * smaller(larger(demand, 0.0), 1.0),
                 limits->max_compressor_power_w);
}

static double halting_distance_m(const iptm_limits *limits, double speed_m_s) {
  return speed_m_s * speed_m_s / (-2.0 * limits->min_acceleration_m_s2);
}

/* Distance to standstill, build-up of the brakes included. */
static double stopping_distance_m(const iptm_limits *limits, double speed_m_s,
                                  double acceleration_m_s2) {
  const double jerk = limits->max_jerk_m_s3;
  const double duration = (acceleration_m_s2 - limits->min_acceleration_m_s2) / jerk;
  const double end_speed = speed_m_s + duration * (acceleration_m_s2 - 0.5 * jerk * duration);
  const double distance =
      duration * (speed_m_s + duration * (0.5 * acceleration_m_s2 - jerk * duration / 6.0));
  return distance + halting_distance_m(limits, end_speed);
}

/* Distance to standstill where an acceleration is held for a tick and the brakes build up then. */
static double distance_to_stop_m(const iptm_limits *limits, double speed_m_s,
                                 double acceleration_m_s2) {
  const double after_m_s = speed_m_s + acceleration_m_s2 * limits->tick_s;
  if (after_m_s <= 0.0) {
    return 0.5 * speed_m_s * speed_m_s / larger(-acceleration_m_s2, LEAST_BRAKING_M_S2);
  }
  return 0.5 * (speed_m_s + after_m_s) * limits->tick_s +
         stopping_distance_m(limits, after_m_s, acceleration_m_s2);
}

/* Largest acceleration for a tick after which the vehicle can still stop within a distance. */
static double stoppable_acceleration(const iptm_limits *limits, const iptm_vehicle *vehicle,
                                     double room_m) {
  const double jerk_step = limits->max_jerk_m_s3 * limits->tick_s, speed = vehicle->speed_m_s;
  double low =
      larger(vehicle->acceleration_m_s2 - jerk_step, limits->min_acceleration_m_s2);
  double high =
      smaller(vehicle->acceleration_m_s2 + jerk_step, limits->max_acceleration_m_s2);
  int i;
  if (distance_to_stop_m(limits, speed, high) <= room_m) return limits->max_acceleration_m_s2;
  if (distance_to_stop_m(limits, speed, low) > room_m) return limits->min_acceleration_m_s2;
  for (i = 0; i < BISECTIONS; ++i) {
    const double middle = 0.5 * (low + high);
    if (distance_to_stop_m(limits, speed, middle) <= room_m) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return low;
}

iptm_command iptm_safe_following(const iptm_limits *limits, const iptm_vehicle *vehicle,
                                 const iptm_leader *leader) {
  const double speed = vehicle->speed_m_s;
  const double gap_m = larger(leader->position_m - vehicle->position_m, LEAST_GAP_M);
  const double braking =
      2.0 * sqrt(-limits->min_acceleration_m_s2 * limits->max_acceleration_m_s2);
  const double approach = speed * (speed - leader->speed_m_s) / braking;
  const double desired =
      larger(limits->standstill_gap_m + speed * limits->time_headway_s + approach,
             limits->standstill_gap_m);
  const double free_flow = pow(speed / limits->max_speed_m_s, FREE_FLOW_EXPONENT);
  const double interaction = pow(desired / gap_m, 2.0);
  const double room_m =
      gap_m - limits->standstill_gap_m + halting_distance_m(limits, leader->speed_m_s);
  iptm_command command;
  command.acceleration_m_s2 = larger(
      limits->max_acceleration_m_s2 * (1.0 - free_flow - interaction), limits->min_acceleration_m_s2);
  command.acceleration_m_s2 =
      smaller(command.acceleration_m_s2, stoppable_acceleration(limits, vehicle, room_m));
  command.compressor_power_w = thermostat_power_w(limits, vehicle);
  return command;
}

iptm_command iptm_controlled_stop(const iptm_limits *limits, const iptm_vehicle *vehicle) {
  const double jerk_step = limits->max_jerk_m_s3 * limits->tick_s;
  /* Reduced by one jerk step per tick from here on, the deceleration ends together with the speed. */
  const double fading = sqrt(0.25 * (jerk_step * jerk_step) +
                             2.0 * limits->max_jerk_m_s3 * vehicle->speed_m_s) -
                        0.5 * jerk_step;
  const double wanted =
      larger(larger(-COMFORTABLE_DECELERATION_M_S2, -fading), limits->min_acceleration_m_s2);
  const double last = larger(vehicle->acceleration_m_s2, limits->min_acceleration_m_s2);
  iptm_command command;
  command.acceleration_m_s2 = smaller(larger(wanted, last - jerk_step), last + jerk_step);
  command.compressor_power_w = thermostat_power_w(limits, vehicle);
  return command;
}

iptm_command iptm_blind_braking(const iptm_limits *limits, const iptm_vehicle *last) {
  iptm_command command;
  command.acceleration_m_s2 = BLIND_BRAKING_M_S2;
  command.compressor_power_w = 0.0;
  if (last != NULL) {
    command.acceleration_m_s2 = smaller(BLIND_BRAKING_M_S2, last->acceleration_m_s2);
    command.compressor_power_w = thermostat_power_w(limits, last);
  }
  return command;
}

#include "safety_monitor.h"
#include "safety_monitor_constants.h"

#include <math.h>

static double larger(double first, double second) { return second > first ? second : first; }
static double smaller(double first, double second) { return second < first ? second : first; }

/* Distance to standstill of a vehicle that keeps its acceleration for a while and brakes then. */
static double stopping_distance_m(double speed_m_s, double acceleration_m_s2, double wait_s,
                                  double deceleration_m_s2, double build_up_m_s3) {
  const double a = acceleration_m_s2;
  double speed = speed_m_s, distance;
  if (speed + a * wait_s <= 0.0) {
    return a < 0.0 ? speed * speed / (-2.0 * a) : 0.0;
  }
  distance = wait_s * (speed + 0.5 * a * wait_s);
  speed += a * wait_s;
  if (a > -deceleration_m_s2) {
    double rise_s = (a + deceleration_m_s2) / build_up_m_s3;
    const double after = speed + rise_s * (a - 0.5 * build_up_m_s3 * rise_s);
    if (after <= 0.0) {
      rise_s = (a + sqrt(a * a + 2.0 * build_up_m_s3 * speed)) / build_up_m_s3;
    }
    distance += rise_s * (speed + rise_s * (0.5 * a - build_up_m_s3 * rise_s / 6.0));
    speed = larger(after, 0.0);
  }
  return distance + speed * speed / (2.0 * deceleration_m_s2);
}

double iptm_safe_distance_m(const iptm_monitor_settings *settings, double speed_m_s,
                            double acceleration_m_s2, double lead_speed_m_s, double brake_share,
                            double further_reaction_s, const iptm_braking_capability *both) {
  const double wait_s =
      larger(settings->reaction_s + further_reaction_s, 0.0) + settings->brake_delay_s;
  const double own_m =
      stopping_distance_m(speed_m_s, acceleration_m_s2, wait_s, both->own_m_s2 * brake_share,
                          settings->brake_build_up_m_s3 * brake_share);
  double slower_m_s, lead_m;
  if (own_m <= 0.0) return 0.0;
  slower_m_s = larger(lead_speed_m_s - settings->lead_speed_accuracy_m_s, 0.0);
  lead_m = slower_m_s * slower_m_s / (2.0 * both->lead_m_s2);
  return larger(own_m - lead_m, 0.0) + (settings->margin_m + settings->gap_accuracy_m);
}

void iptm_monitor_judge(const iptm_monitor_settings *settings, iptm_monitor_memory *memory,
                        const iptm_monitored *ego, bool has_lead, double lead_position_m,
                        double lead_speed_m_s, const iptm_road_braking *road, double unseen_s) {
  const bool held = ego->time_s - memory->since_s >= settings->hold_s - ROUNDING_S;
  const bool was_braking = memory->braking, was_full = was_braking && !memory->gently;
  const double gap_m = lead_position_m - ego->position_m;
  const double onset_m_s2 = ego->acceleration_m_s2, onset_s = -smaller(unseen_s, WAITED_S);
  const double release_m_s2 = larger(ego->acceleration_m_s2, 0.0);
  double safe_m;
  bool fully, braking;
  if (!has_lead) {
    memory->braking = was_braking && !held;
    return;
  }
  safe_m = iptm_safe_distance_m(settings, ego->speed_m_s, was_full ? release_m_s2 : onset_m_s2,
                                lead_speed_m_s, memory->brake_share,
                                was_full ? settings->release_reaction_s : onset_s, &road->full);
  fully = gap_m < safe_m || (was_full && !held);
  braking = fully || (was_braking && !held);
  if (!fully && road->may_be_slippery) {
    const double asked_m_s2 = was_braking ? release_m_s2 : onset_m_s2;
    const double further_s = was_braking ? settings->release_reaction_s : onset_s;
    safe_m = iptm_safe_distance_m(settings, ego->speed_m_s, asked_m_s2, lead_speed_m_s,
                                  memory->brake_share, further_s, &road->slippery);
    if (road->descends) {
      safe_m = larger(safe_m, iptm_safe_distance_m(settings, ego->speed_m_s, asked_m_s2,
                                                   lead_speed_m_s, memory->brake_share,
                                                   further_s - settings->reaction_s,
                                                   &road->descent));
    }
    braking = braking || gap_m < safe_m;
  }
  if (was_braking && !(fully && memory->gently)) {
    memory->braking = braking;
    memory->gently = braking && !fully;
    return;
  }
  if (!braking) return;
  memory->braking = true;
  memory->gently = !fully;
  if (!was_braking) {
    memory->since_s = ego->time_s;
  }
}

void iptm_monitor_learn(iptm_monitor_memory *memory, double requested_m_s2, double delivered_m_s2,
                        double speed_m_s, double duration_s) {
  double share, gain;
  if (requested_m_s2 > -JUDGED_FROM_M_S2 || speed_m_s < JUDGED_FROM_M_S) return;
  share = delivered_m_s2 / requested_m_s2;
  if (share >= DELIVERED_SHARE) {
    memory->followed_m_s2 = larger(memory->followed_m_s2, -requested_m_s2);
    if (memory->road_m_s2 != 0.0) {
      memory->road_m_s2 = larger(memory->road_m_s2, -requested_m_s2);
    }
  } else if (memory->brake_share > DELIVERED_SHARE &&
             -delivered_m_s2 <= SATURATED_SHARE * memory->followed_m_s2) {
    memory->road_m_s2 = -delivered_m_s2;
    return;
  } else {
    memory->road_m_s2 = 0.0;
    memory->followed_m_s2 = 0.0;
  }
  gain = -expm1(-duration_s / SHARE_TIME_CONSTANT_S);
  memory->brake_share += gain * (smaller(larger(share, LEAST_SHARE), 1.0) - memory->brake_share);
}

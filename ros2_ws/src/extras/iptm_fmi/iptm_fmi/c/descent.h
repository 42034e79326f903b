/* How much nearer the controller takes the lead vehicle to be on a descent: LeadCheck._steep_m in C99, the same
 * operations in the same order. */
#ifndef IPTM_DESCENT_H
#define IPTM_DESCENT_H

#include <math.h>

#include "descent_constants.h"
#include "unit_memory.h"

/* The distance at which the safety monitor brakes on a slippery road of a slope, at its accuracy of measurement 0. */
static double iptm_slippery_m(double lead_m_s, double own_m_s, double slope_rad) {
  const double within_rad = fmin(fmax(slope_rad, -IPTM_STEEPEST_RAD), IPTM_STEEPEST_RAD);
  const double along_m_s2 = IPTM_GRAVITY_M_S2 * sin(within_rad);
  const double own_m_s2 = fmax(IPTM_SLIPPERY_M_S2 + along_m_s2, IPTM_LEAST_DECELERATION_M_S2);
  const double lead_m_s2 =
      fmax(IPTM_SLIPPERY_LEAD_SHARE * IPTM_SLIPPERY_M_S2 + along_m_s2, IPTM_LEAST_DECELERATION_M_S2);
  const double wait_s =
      IPTM_REACTION_S + IPTM_BRAKE_DELAY_S + 0.5 * own_m_s2 / IPTM_BRAKE_BUILD_UP_M_S3;
  const double later_m_s = own_m_s + IPTM_GAINS_M_S2 * wait_s;
  const double own_m =
      0.5 * (own_m_s + later_m_s) * wait_s + 0.5 * later_m_s * later_m_s / own_m_s2;
  return fmax(own_m - 0.5 * lead_m_s * lead_m_s / lead_m_s2, 0.0);
}

/* The distance beyond the smallest gap, 0 uphill. */
static double iptm_steep_m(const iptm_limits *limits, double lead_m_s, double own_m_s, double slope_rad) {
  double steep_m, level_m, closing_m, smallest_m;
  if (!(slope_rad < 0.0)) return 0.0;
  steep_m = IPTM_STEEP_SHARE * iptm_slippery_m(lead_m_s, own_m_s, slope_rad) + IPTM_STEEP_M;
  level_m = IPTM_STEEP_SHARE * iptm_slippery_m(lead_m_s, own_m_s, 0.0) + IPTM_STEEP_M;
  closing_m = own_m_s * (own_m_s - lead_m_s) /
              (2.0 * sqrt(-limits->min_acceleration_m_s2 * limits->max_acceleration_m_s2));
  smallest_m = limits->standstill_gap_m + limits->time_headway_s * own_m_s + closing_m;
  return fmax(steep_m - fmax(smallest_m, level_m), 0.0);
}

#endif

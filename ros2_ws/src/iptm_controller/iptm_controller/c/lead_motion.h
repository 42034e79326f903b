/* The motion of the lead vehicle and what it leaves room for: forecast.py, preview_trust.py and safeguards.py in
 * C99, the same operations in the same order. */
#ifndef IPTM_LEAD_MOTION_H
#define IPTM_LEAD_MOTION_H

#include "tick_data.h"

/* Whether a preview is well formed and nowhere moves backwards. */
int iptm_is_sound(const iptm_motion *preview);

/* Return the mean squared rate at which two previews differ along their common nodes, NaN with less than two. */
double iptm_roughness_m2_s4(const iptm_motion *before, const iptm_motion *now);

/* Let a preview begin where the leader is measured.
 *
 * known_until_s: time up to which it is asserted.
 * lead_times_s: for which its speeds are kept; NaN where it asserts none.
 * times_s, positions_m, speeds_m_s: room for one node more than the preview has.
 * Returns the number of nodes written. */
int iptm_follow_preview(const iptm_motion *preview, double time_s, double position_m,
                        double known_until_s, int leads, const double *lead_times_s,
                        double *times_s, double *positions_m, double *speeds_m_s,
                        double *asserted_m_s);

/* What the guard looks at, see CollisionGuard. */
typedef struct {
  double tick_s, jerk_step_m_s2, hardest_m_s2, brake_share;
  double leader_time_s, leader_position_m, leader_speed_m_s, leader_deceleration_m_s2, known_s;
} iptm_guarded;

/* Whether a command makes the gap fall below the margin; motion: NULL without a forecast. */
int iptm_collision_threatens(const iptm_guarded *guarded, const iptm_motion *motion,
                             double acceleration_m_s2, double time_s, double position_m,
                             double speed_m_s);

#endif

/* Whether a command leaves room to brake behind the leader: CollisionGuard of safeguards.py in C99, the same
 * operations in the same order. */
#ifndef IPTM_GUARD_H
#define IPTM_GUARD_H

#include "tick_data.h"

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

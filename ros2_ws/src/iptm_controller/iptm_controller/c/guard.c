#include "guard.h"
#include "guard_constants.h"

#include <math.h>
#include <stddef.h>


static double least(double x, double y) { return y < x ? y : x; }
static double most(double x, double y) { return y > x ? y : x; }

/* Position of a vehicle that keeps its deceleration until it stands. */
static double braking_on_m(double elapsed_s, double position_m, double speed_m_s,
                           double deceleration_m_s2) {
  if (deceleration_m_s2 > 0.0) elapsed_s = least(elapsed_s, speed_m_s / deceleration_m_s2);
  return position_m + elapsed_s * (speed_m_s - 0.5 * deceleration_m_s2 * elapsed_s);
}

/* What a forecast says about the leader; until_s is minus infinity without one. */
typedef struct {
  const iptm_motion *motion;
  double until_s, end_m, end_m_s, end_deceleration_m_s2;
  int is_doubted;
} prediction;

static prediction predict(const iptm_guarded *guarded, const iptm_motion *motion) {
  prediction found = {motion, -INFINITY, 0.0, 0.0, 0.0, 1};
  double now_m_s, last_s, last_m_s;
  if (motion == NULL || guarded->known_s <= ROUNDING_S) return found;
  found.until_s = guarded->leader_time_s + guarded->known_s;
  last_s = most(found.until_s - guarded->tick_s, guarded->leader_time_s);
  found.end_m = iptm_motion_at(motion, found.until_s, &found.end_m_s);
  iptm_motion_at(motion, guarded->leader_time_s, &now_m_s);
  iptm_motion_at(motion, last_s, &last_m_s);
  found.end_deceleration_m_s2 = most((last_m_s - found.end_m_s) / (found.until_s - last_s), 0.0);
  found.is_doubted = now_m_s - guarded->leader_speed_m_s > CONFIRMED_SPEED_ERROR_M_S ||
                     guarded->known_s < NEAR_S;
  return found;
}

static double leader_position_m(const iptm_guarded *guarded, const prediction *predicted,
                                double time_s) {
  double measured_m = 0.0, predicted_m, unused;
  if (predicted->is_doubted) {
    measured_m = braking_on_m(time_s - guarded->leader_time_s, guarded->leader_position_m,
                              guarded->leader_speed_m_s, guarded->leader_deceleration_m_s2);
  }
  if (isinf(predicted->until_s) && predicted->until_s < 0.0) return measured_m;
  if (time_s > predicted->until_s) {
    predicted_m = braking_on_m(time_s - predicted->until_s, predicted->end_m, predicted->end_m_s,
                               predicted->end_deceleration_m_s2);
  } else {
    predicted_m = iptm_motion_at(predicted->motion, time_s, &unused);
  }
  return predicted->is_doubted ? least(measured_m, predicted_m) : predicted_m;
}

int iptm_collision_threatens(const iptm_guarded *guarded, const iptm_motion *motion,
                             double acceleration_m_s2, double time_s, double position_m,
                             double speed_m_s) {
  const double tick_s = guarded->tick_s, step = guarded->jerk_step_m_s2;
  const double hardest = guarded->hardest_m_s2 * guarded->brake_share;
  const double build_up = most(ceil((acceleration_m_s2 - hardest) / step), 0.0);
  const double after_m_s = speed_m_s + acceleration_m_s2 * tick_s * (1.0 + build_up);
  const double ticks =
      1.0 + build_up + most(ceil(most(after_m_s, 0.0) / (-hardest * tick_s)), 0.0) + 1.0;
  const double interval_s = tick_s / CHECKS_PER_TICK;
  prediction predicted = {NULL, 0.0, 0.0, 0.0, 0.0, 0};
  double limit_m = MARGIN_M;
  int pass;
  /* A leader never moves backwards: most commands are safe before anything is predicted. */
  for (pass = 0; pass < 2; ++pass) {
    double gained = 0.0, start = speed_m_s, driven_m = 0.0, elapsed_s = 0.0;
    int stands = 0, i, check;
    if (pass > 0) {
      /* Below the margin already, the gap must not become smaller still. */
      predicted = predict(guarded, motion);
      limit_m = least(MARGIN_M, leader_position_m(guarded, &predicted, time_s) - position_m - ROUNDING_M);
    }
    for (i = 0; i < ticks; ++i) {
      const double acceleration = most(acceleration_m_s2 - step * i, hardest);
      for (check = 0; check < CHECKS_PER_TICK; ++check) {
        double end;
        gained += acceleration;
        end = speed_m_s + gained * interval_s;
        stands = stands || end <= 0.0;
        if (stands) end = 0.0;
        driven_m += 0.5 * (start + end) * interval_s;
        elapsed_s += interval_s;
        start = end;
        if (pass > 0 &&
            leader_position_m(guarded, &predicted, time_s + elapsed_s) - position_m - driven_m <
                limit_m) {
          return 1;
        }
      }
    }
    if (pass == 0 && guarded->leader_position_m - position_m - driven_m >= MARGIN_M) return 0;
  }
  return 0;
}

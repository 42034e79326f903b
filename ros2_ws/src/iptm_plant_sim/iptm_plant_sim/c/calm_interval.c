/* An interval in which the safety monitor need not look closer: `LeadMeasurements` and `_may_be_unsafe` of
 * service_braking.py for measurements that follow each other plainly and are safe all together. */
#include <math.h>
#include <string.h>

#include "safety_monitor.h"
#include "calm_interval_constants.h"

enum { ROOM = KEPT + MOST_MEASURED };

/* A measurement, and the own vehicle at the same instant. */
typedef struct {
  double time_s, position_m, speed_m_s, own_position_m, own_speed_m_s;
} sample;

/* The own vehicle in the interval, what is asked of it, and what can be counted on. */
typedef struct {
  double start_s, position_m, speed_m_s, stands, duration_s, monitor_period_s;
  double requested_m_s2, delivered_m_s2, brake_share;
  iptm_braking_capability full, slippery;
  double may_be_slippery, better_grip_m_s2;
  double unexplained_m, unexplained_noise_m, unexplained_last_m;
} interval;

typedef struct {
  double acceleration_m_s2, period_s, smallest_gap_m;
  double unexplained_m, unexplained_noise_m, unexplained_last_m;
} outcome;

static double larger(double first, double second) { return second > first ? second : first; }
static double smaller(double first, double second) { return second < first ? second : first; }

static void own_motion(const interval *over, double after_s, double *position_m, double *speed_m_s) {
  const double a = over->delivered_m_s2, speed = over->speed_m_s;
  if (over->stands != 0.0) {
    *position_m = over->position_m;
    *speed_m_s = 0.0;
    return;
  }
  if (a < 0.0) after_s = smaller(after_s, speed / -a);
  *position_m = over->position_m + after_s * (speed + 0.5 * a * after_s);
  *speed_m_s = larger(speed + a * after_s, 0.0);
}

/* Whether any two values differ by more than a distance; sorts them. */
static bool are_apart(double *values, int count, double by) {
  int i, j;
  for (i = 1; i < count; ++i) {
    const double value = values[i];
    for (j = i; j > 0 && values[j - 1] > value; --j) values[j] = values[j - 1];
    values[j] = value;
  }
  for (i = 1; i < count; ++i) {
    if (!(values[i] - values[i - 1] > by)) return false;
  }
  return true;
}

static bool may_repeat(const sample *rows, int count) {
  double values[ROOM], fastest_m_s = -INFINITY, own_fastest_m_s = -INFINITY;
  int i;
  for (i = 0; i < count; ++i) {
    values[i] = rows[i].speed_m_s;
    fastest_m_s = larger(fastest_m_s, rows[i].speed_m_s);
    own_fastest_m_s = larger(own_fastest_m_s, rows[i].own_speed_m_s);
  }
  if (!(fastest_m_s > MOVING_M_S || own_fastest_m_s > MOVING_M_S)) return false;
  if (are_apart(values, count, IDENTICAL_M_S)) return false;
  for (i = 0; i < count; ++i) values[i] = rows[i].position_m - rows[i].own_position_m;
  if (!are_apart(values, count, 2.0 * IDENTICAL_M)) return true;
  if (!(fastest_m_s > MOVING_M_S)) return false;
  for (i = 0; i < count; ++i) values[i] = rows[i].position_m;
  return !are_apart(values, count, 2.0 * IDENTICAL_M);
}

/* Follow the residual of the position over one step; return whether it stays within its limit. */
static bool is_explained(double farther_m, double change_m_s, double interval_s, outcome *found) {
  const double excess_m = fabs(farther_m) - 0.5 * fabs(change_m_s) * interval_s;
  const double unexplained_m = excess_m > 0.0 ? copysign(excess_m, farther_m) : 0.0;
  const double share = smaller(interval_s / RANGE_TIME_S, 1.0);
  found->unexplained_m = (found->unexplained_m + unexplained_m) * (1.0 - share);
  found->unexplained_noise_m +=
      share * (fabs(unexplained_m - found->unexplained_last_m) - found->unexplained_noise_m);
  found->unexplained_last_m = unexplained_m;
  return !(fabs(found->unexplained_m) - RANGE_LIMIT_M - NOISE_LIMIT * found->unexplained_noise_m >
           0.0);
}

/* Whether every measurement continues the motion that the one before shows. */
static bool are_plain(const sample *last, int measured, outcome *found) {
  int i;
  for (i = 0; i < measured; ++i, ++last) {
    const sample *now = last + 1;
    const double interval_s = now->time_s - last->time_s;
    const double change_m_s = now->speed_m_s - last->speed_m_s;
    const double farther_m = now->position_m - last->position_m -
                             0.5 * (last->speed_m_s + now->speed_m_s) * interval_s;
    if (!(RESOLUTION_S < interval_s && interval_s <= LARGEST_MEASURING_INTERVAL_S &&
          fabs(farther_m) <= ANOTHER_LEAD_M && fabs(change_m_s) <= ANOTHER_LEAD_M_S &&
          now->position_m < FREE_POSITION_M) ||
        !is_explained(farther_m, change_m_s, interval_s, found)) {
      return false;
    }
    found->acceleration_m_s2 = change_m_s / interval_s;
    found->period_s = smaller(interval_s, LONGEST_PERIOD_S);
  }
  return true;
}

static bool brakes_harder(const sample *rows, int count, double deceleration_m_s2) {
  bool was_harder = false;
  int i;
  for (i = 1; i < count; ++i) {
    const bool is_harder = rows[i - 1].speed_m_s - rows[i].speed_m_s >
                           deceleration_m_s2 * (rows[i].time_s - rows[i - 1].time_s);
    if (is_harder && was_harder) return true;
    was_harder = is_harder;
  }
  return false;
}

static bool is_safe(const iptm_monitor_settings *settings, const interval *over, double gap_m,
                    double speed_m_s, double lead_speed_m_s) {
  const double a = over->requested_m_s2, share = over->brake_share;
  return !(gap_m < iptm_safe_distance_m(settings, speed_m_s, a, lead_speed_m_s, share, 0.0,
                                        &over->full)) &&
         !(over->may_be_slippery != 0.0 &&
           gap_m < iptm_safe_distance_m(settings, speed_m_s, a, lead_speed_m_s, share, 0.0,
                                        &over->slippery));
}

/* Whether every instant at which the monitor looks is measured and safe. */
static bool is_always_safe(const iptm_monitor_settings *settings, const interval *over,
                           const sample *rows, int measured) {
  const int instants = (int)ceil((over->duration_s - RESOLUTION_S) / over->monitor_period_s);
  int i, next = 0;
  for (i = 0; i < (instants > 1 ? instants : 1); ++i) {
    const double after_s = i * over->monitor_period_s, time_s = over->start_s + after_s;
    double position_m, speed_m_s;
    while (next < measured && rows[next].time_s <= time_s + RESOLUTION_S) ++next;
    if (next == 0 || !(fabs(time_s - rows[next - 1].time_s) <= RESOLUTION_S)) return false;
    own_motion(over, after_s, &position_m, &speed_m_s);
    if (!is_safe(settings, over, rows[next - 1].position_m - position_m, speed_m_s,
                 rows[next - 1].speed_m_s)) {
      return false;
    }
  }
  return true;
}

/* Return the rows that are remembered if the interval is calm, and 0 where a closer look is needed.
 *
 * rows: room for ROOM; the remembered ones, at least one, are at its beginning, before and after.
 * measured: 2 to MOST_MEASURED measurements in the interval. */
int iptm_calm_interval(const iptm_monitor_settings *settings, const interval *over, sample *rows,
                       int remembered, int measured, const double *times_s,
                       const double *positions_m, const double *speeds_m_s, outcome *found) {
  sample *const first = rows + remembered;
  const int count = remembered + measured, kept = count < KEPT ? count : KEPT;
  const int before = remembered < 2 ? remembered : 2;
  int i;
  found->smallest_gap_m = INFINITY;
  found->unexplained_m = over->unexplained_m;
  found->unexplained_noise_m = over->unexplained_noise_m;
  found->unexplained_last_m = over->unexplained_last_m;
  for (i = 0; i < measured; ++i) {
    sample *const now = first + i;
    now->time_s = times_s[i];
    now->position_m = positions_m[i];
    now->speed_m_s = speeds_m_s[i];
    own_motion(over, times_s[i] - over->start_s, &now->own_position_m, &now->own_speed_m_s);
    if (!isfinite(now->time_s + now->position_m + now->speed_m_s + now->own_position_m)) return 0;
    if (now->time_s > over->start_s + RESOLUTION_S) {
      const double gap_m = now->position_m - now->own_position_m;
      found->smallest_gap_m = smaller(found->smallest_gap_m, gap_m);
    }
  }
  if (isinf(found->smallest_gap_m) || !are_plain(first - 1, measured, found) ||
      brakes_harder(first - before, before + measured, over->better_grip_m_s2) ||
      may_repeat(rows, count) || !is_always_safe(settings, over, first, measured)) {
    return 0;
  }
  memmove(rows, rows + count - kept, sizeof(sample) * (size_t)kept);
  return kept;
}

#include "forecast.h"
#include "forecast_constants.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

static double least(double x, double y) { return y < x ? y : x; }
static double most(double x, double y) { return y > x ? y : x; }

/* The past. */

static void remember(const iptm_forecaster *forecaster, iptm_forecast_memory *memory,
                     const iptm_leader *leader) {
  iptm_leader *const leaders = memory->leaders;
  int gone = 0;
  if (memory->past > 0 && leader->time_s < leaders[memory->past - 1].time_s) memory->past = 0;
  if (memory->past > 0 && leader->time_s == leaders[memory->past - 1].time_s) --memory->past;
  while (gone < memory->past && leaders[gone].time_s < leader->time_s - HISTORY_S) ++gone;
  if (memory->past - gone >= forecaster->past_room) ++gone; /* measured more often than ticks are */
  memory->past -= gone;
  memmove(leaders, leaders + gone, sizeof(*leaders) * (size_t)memory->past);
  leaders[memory->past++] = *leader;
}

static double measured_acceleration_m_s2(const iptm_forecast_memory *memory) {
  const iptm_leader *last, *before;
  double passed_s, changed_m_s, unexplained_m, since_s, mean_s = 0.0, moment = 0.0, spread = 0.0;
  int first = memory->past, count, i;
  if (memory->past < 2) return 0.0;
  last = &memory->leaders[memory->past - 1];
  before = last - 1;
  passed_s = last->time_s - before->time_s;
  changed_m_s = last->speed_m_s - before->speed_m_s;
  unexplained_m = fabs(last->position_m - before->position_m -
                       0.5 * passed_s * (last->speed_m_s + before->speed_m_s));
  if (unexplained_m > 0.5 * passed_s * fabs(changed_m_s) + RANGE_ERROR_M) return 0.0;
  since_s = least(last->time_s - ACCELERATION_WINDOW_S - TOLERANCE_S, before->time_s);
  while (first > 0 && memory->leaders[first - 1].time_s >= since_s) --first;
  count = memory->past - first;
  for (i = first; i < memory->past; ++i) mean_s += memory->leaders[i].time_s;
  mean_s /= count;
  for (i = first; i < memory->past; ++i) {
    const double time_s = memory->leaders[i].time_s - mean_s;
    moment += time_s * memory->leaders[i].speed_m_s;
    spread += time_s * time_s;
  }
  moment /= spread;
  return fabs(moment) <= LARGEST_ACCELERATION_M_S2 ? moment : 0.0;
}

/* Write how a leader goes on of which only the present is known, see extrapolated_motion; returns the nodes. */
static int extrapolate(const iptm_forecaster *forecaster, const iptm_forecast_memory *memory,
                       const iptm_leader *leader, double *times_s, double *positions_m,
                       double *speeds_m_s) {
  const double acceleration_m_s2 = measured_acceleration_m_s2(memory);
  const double decay_s =
      acceleration_m_s2 < 0.0 ? forecaster->braking_decay_s : forecaster->decay_s;
  const double change_m_s = decay_s * acceleration_m_s2;
  double until_s = EXTRAPOLATED_DECAYS * decay_s;
  int nodes = IPTM_EXTRAPOLATED_NODES, i;
  if (leader->speed_m_s + change_m_s < 0.0) {
    const double stop_s = -decay_s * log1p(leader->speed_m_s / change_m_s);
    until_s = least(until_s, stop_s);
    if (stop_s < SHORTEST_STOP_S) nodes = 1;
  }
  for (i = 0; i < nodes; ++i) {
    const double elapsed_s = until_s * (i / (double)(IPTM_EXTRAPOLATED_NODES - 1));
    const double gone = -expm1(-elapsed_s / decay_s);
    times_s[i] = leader->time_s + elapsed_s;
    positions_m[i] = leader->position_m + (leader->speed_m_s * elapsed_s +
                                           change_m_s * (elapsed_s - decay_s * gone));
    speeds_m_s[i] = most(leader->speed_m_s + change_m_s * gone, 0.0);
  }
  return nodes;
}

iptm_leader iptm_leader_at(const iptm_forecaster *forecaster, const iptm_forecast_memory *memory,
                           const iptm_leader *leader, double time_s) {
  double columns[3][IPTM_EXTRAPOLATED_NODES];
  iptm_motion motion;
  iptm_leader later = *leader;
  if (time_s <= leader->time_s) return later;
  motion.nodes = extrapolate(forecaster, memory, leader, columns[0], columns[1], columns[2]);
  motion.times_s = columns[0];
  motion.positions_m = columns[1];
  motion.speeds_m_s = columns[2];
  later.time_s = time_s;
  later.position_m = iptm_motion_at(&motion, time_s, &later.speed_m_s);
  return later;
}

/* Trust: PreviewTrust. */

static double *prediction_of(const iptm_forecaster *forecaster, const iptm_forecast_memory *memory,
                             double tick) {
  const int rows = forecaster->lead_ticks[forecaster->leads - 1] + 1;
  const int row = (int)fmod(tick, rows);
  return memory->predictions + (ptrdiff_t)(2 + forecaster->leads) * (row < 0 ? row + rows : row);
}

/* Return the prediction of an earlier tick, NULL for none. */
static const double *predicted_at(const iptm_forecaster *forecaster,
                                  const iptm_forecast_memory *memory, double tick) {
  const double *const row = tick < 0.0 ? NULL : prediction_of(forecaster, memory, tick);
  return row != NULL && row[0] == tick + 1.0 ? row : NULL;
}

static void forget_predictions(const iptm_forecaster *forecaster, iptm_forecast_memory *memory) {
  const int rows = forecaster->lead_ticks[forecaster->leads - 1] + 1;
  memset(memory->predictions, 0, sizeof(double) * (size_t)((2 + forecaster->leads) * rows));
  memory->errors = memory->has_predicted = memory->is_doubted = memory->is_unproved = 0;
  memory->last_error_tick = 0.0;
}

/* Return the place of the shortest lead time with an error beyond a tolerance, -1 without one. */
static int first_failed(const iptm_forecaster *forecaster, const iptm_forecast_memory *memory,
                        const double *errors) {
  int place, tick;
  for (place = 0; place < forecaster->leads; ++place) {
    const double lead_s = forecaster->lead_ticks[place] * forecaster->tick_s;
    double mean = 0.0;
    for (tick = 0; tick < memory->errors; ++tick) {
      mean += most(memory->errors_m_s[tick * IPTM_MOST_LEADS + place], -1.0);
    }
    mean /= IPTM_SMOOTHED_TICKS;
    if (errors[place] > SINGLE_TOLERANCE_M_S + SINGLE_GROWTH_M_S2 * lead_s ||
        mean > MEAN_TOLERANCE_M_S + MEAN_GROWTH_M_S2 * lead_s) {
      return place;
    }
  }
  return -1;
}

/* Whether a slow-down up to now was predicted in time. */
static int proves(const iptm_forecaster *forecaster, const iptm_forecast_memory *memory,
                  double tick, double speed_m_s, const double *errors) {
  int place;
  for (place = 0; place < forecaster->leads; ++place) {
    const int lead = forecaster->lead_ticks[place];
    const double lead_s = lead * forecaster->tick_s;
    const double *const entry = predicted_at(forecaster, memory, tick - lead);
    const double tolerance = MEAN_TOLERANCE_M_S + MEAN_GROWTH_M_S2 * lead_s;
    if (entry == NULL || lead_s < CREDITED_LEAD_S) continue;
    if (fabs(errors[place]) < tolerance && tolerance < entry[1] - speed_m_s &&
        entry[1] - entry[2 + place] > CREDITED_SLOWDOWN_M_S) {
      return 1;
    }
  }
  return 0;
}

/* Compare a measured leader with the predictions for this instant. */
static void observe(const iptm_forecaster *forecaster, iptm_forecast_memory *memory, double tick,
                    double speed_m_s) {
  double *errors;
  double largest = 0.0;
  int place, failed = -1;
  if (memory->has_predicted && tick < memory->newest_tick) forget_predictions(forecaster, memory);
  if (memory->errors == IPTM_SMOOTHED_TICKS) {
    memmove(memory->errors_m_s, memory->errors_m_s + IPTM_MOST_LEADS,
            sizeof(double) * (IPTM_SMOOTHED_TICKS - 1) * IPTM_MOST_LEADS);
    --memory->errors;
  }
  errors = memory->errors_m_s + (ptrdiff_t)IPTM_MOST_LEADS * memory->errors++;
  for (place = 0; place < forecaster->leads; ++place) {
    const double *const entry =
        predicted_at(forecaster, memory, tick - forecaster->lead_ticks[place]);
    const double error = entry == NULL ? 0.0 : entry[2 + place] - speed_m_s;
    errors[place] = isnan(error) ? 0.0 : error;
    largest = place == 0 ? errors[0] : most(largest, errors[place]);
  }
  if (largest > MEAN_TOLERANCE_M_S + MEAN_GROWTH_M_S2 * forecaster->lead_ticks[0] * forecaster->tick_s) {
    failed = first_failed(forecaster, memory, errors);
  }
  if (failed >= 0) {
    const double trusted_s =
        failed > 0 ? forecaster->lead_ticks[failed - 1] * forecaster->tick_s : 0.0;
    memory->trusted_s = memory->is_doubted ? least(memory->trusted_s, trusted_s) : trusted_s;
    memory->is_doubted = memory->is_unproved = 1;
    memory->last_error_tick = tick;
  } else if (memory->is_doubted) {
    if (memory->is_unproved && proves(forecaster, memory, tick, speed_m_s, errors)) {
      memory->is_unproved = 0;
    }
    if (!memory->is_unproved &&
        (tick - memory->last_error_tick) * forecaster->tick_s >= PROBATION_S) {
      memory->is_doubted = 0;
    }
  }
}

/* Quality: faults of a preview. */

static int known_nodes(const iptm_motion *preview) {
  int known = 0;
  if (preview->bounds_m == NULL) return preview->nodes;
  while (known < preview->nodes && !(preview->bounds_m[known] > KNOWN_BOUND_M)) ++known;
  return known;
}

static int is_faulty(const iptm_motion *preview) {
  const double *times = preview->times_s, *positions = preview->positions_m;
  int i;
  for (i = 0; i < preview->nodes; ++i) {
    const double speed = preview->speeds_m_s[i];
    if (!(isfinite(times[i]) && isfinite(positions[i]))) return 1;
    if (!(speed >= SPEED_AT_REST_M_S && speed <= MAX_LEADER_SPEED_M_S)) return 1;
    if (preview->bounds_m != NULL && !(preview->bounds_m[i] >= 0.0 && isfinite(preview->bounds_m[i]))) {
      return 1;
    }
    if (i > 0) {
      const double passed_s = times[i] - times[i - 1], moved_m = positions[i] - positions[i - 1];
      if (passed_s <= 0.0 || moved_m < SPEED_AT_REST_M_S * most(passed_s, 1.0) ||
          moved_m > 1.0 + MAX_LEADER_SPEED_M_S * passed_s) {
        return 1;
      }
    }
  }
  return 0;
}

static iptm_preview_quality assess(const iptm_forecaster *forecaster, const iptm_leader *leader,
                                   const iptm_motion *preview, double known_until_s) {
  double age_s, last_s, predicted_m_s;
  if (preview->nodes == 0) return IPTM_PREVIEW_MISSING;
  if (preview->nodes < 0 || preview->nodes > forecaster->preview_room || is_faulty(preview)) {
    return IPTM_PREVIEW_INVALID;
  }
  age_s = leader->time_s - preview->times_s[0];
  if (age_s > forecaster->max_age_s) return IPTM_PREVIEW_STALE;
  if (age_s < -TOLERANCE_S) return IPTM_PREVIEW_INVALID;
  last_s = preview->times_s[preview->nodes - 1];
  if (last_s <= leader->time_s) return IPTM_PREVIEW_STALE;
  predicted_m_s =
      iptm_interpolate(leader->time_s, preview->times_s, preview->speeds_m_s, 1, preview->nodes);
  if (fabs(predicted_m_s - leader->speed_m_s) > LARGEST_SPEED_ERROR_M_S) return IPTM_PREVIEW_INVALID;
  return least(last_s, known_until_s) < leader->time_s + forecaster->horizon_s - TOLERANCE_S
             ? IPTM_PREVIEW_SHORT
             : IPTM_PREVIEW_FULL;
}

/* Let a preview go on without the small negative speeds and steps of estimators at standstill. */
static void without_steps_back(iptm_motion *preview, double *positions_m, double *speeds_m_s) {
  int i, is_backwards = 0;
  for (i = 0; i < preview->nodes; ++i) {
    is_backwards |= preview->speeds_m_s[i] < 0.0;
    is_backwards |= i > 0 && preview->positions_m[i] < preview->positions_m[i - 1];
  }
  if (!is_backwards) return;
  for (i = 0; i < preview->nodes; ++i) {
    positions_m[i] = i > 0 ? most(positions_m[i - 1], preview->positions_m[i]) : preview->positions_m[0];
    speeds_m_s[i] = most(preview->speeds_m_s[i], 0.0);
  }
  preview->positions_m = positions_m;
  preview->speeds_m_s = speeds_m_s;
}

/* Noise: PreviewFusion. */

static double weight_at(const double *times_s, int node) {
  const double lead_s = most(times_s[node] - times_s[0], 0.0);
  return 1.0 / most(-expm1(-2.0 * lead_s / ERROR_GROWTH_S), LEAST_VARIANCE);
}

/* Return the mean squared rate at which a preview differs from the one before, NaN with less than two common nodes.
 *
 * first, last: of its nodes that lie within the one before. */
static double roughness_m2_s4(const iptm_forecast_memory *memory, const iptm_motion *now,
                              int *first, int *last) {
  const double *times = now->times_s, *before = memory->fused_times_s;
  const double first_s = before[0] - ROUNDING_S, last_s = before[memory->fused - 1] + ROUNDING_S;
  double sum = 0.0, last_difference = 0.0;
  int i;
  *first = *last = 0;
  while (*first < now->nodes && times[*first] < first_s) ++*first;
  for (*last = *first; *last < now->nodes && times[*last] < last_s; ++*last) {}
  for (i = *first; i < *last; ++i) {
    const double difference =
        now->speeds_m_s[i] -
        iptm_interpolate(times[i], before, memory->fused_speeds_m_s, 1, memory->fused);
    if (i > *first) {
      const double rate = (difference - last_difference) / (times[i] - times[i - 1]);
      sum += rate * rate;
    }
    last_difference = difference;
  }
  return *last - *first < 2 ? NAN : sum / (*last - *first - 1);
}

/* Average a preview with the ones before; work: room for two columns. */
static void average(iptm_forecast_memory *memory, const iptm_motion *now, double kept, int first,
                    int last, double *work) {
  const double *const before = memory->fused_times_s;
  const double *const earlier = memory->is_averaged ? memory->averaged_m_s : memory->fused_speeds_m_s;
  double *const averaged = work, *const weights = work + now->nodes;
  double squares = 0.0;
  int i;
  if (!memory->is_averaged) {
    for (i = 0; i < memory->fused; ++i) memory->weights[i] = weight_at(before, i);
  }
  for (i = 0; i < now->nodes; ++i) {
    const double expected = iptm_interpolate(now->times_s[i], before, earlier, 1, memory->fused);
    const int is_common = i >= first && i < last;
    const double old = is_common ? kept * iptm_interpolate(now->times_s[i], before, memory->weights, 1,
                                                           memory->fused)
                                 : 0.0;
    const double fresh = weight_at(now->times_s, i), innovation = now->speeds_m_s[i] - expected;
    if (is_common) squares += innovation * innovation;
    averaged[i] = (old * expected + fresh * now->speeds_m_s[i]) / (old + fresh);
    weights[i] = old + fresh;
  }
  memory->is_averaged = !(squares / (last - first) > ANOTHER_PLAN_M_S * ANOTHER_PLAN_M_S);
  if (memory->is_averaged) {
    memcpy(memory->averaged_m_s, averaged, sizeof(double) * (size_t)now->nodes);
    memcpy(memory->weights, weights, sizeof(double) * (size_t)now->nodes);
  }
}

static void note_preview(iptm_forecast_memory *memory, const iptm_motion *now) {
  memcpy(memory->fused_times_s, now->times_s, sizeof(double) * (size_t)now->nodes);
  memcpy(memory->fused_speeds_m_s, now->speeds_m_s, sizeof(double) * (size_t)now->nodes);
  memory->fused = now->nodes;
}

static int is_repeated(const iptm_forecast_memory *memory, const iptm_motion *now) {
  int i;
  if (memory->fused != now->nodes) return 0;
  for (i = 0; i < now->nodes; ++i) {
    if (memory->fused_times_s[i] != now->times_s[i] ||
        memory->fused_speeds_m_s[i] != now->speeds_m_s[i]) {
      return 0;
    }
  }
  return 1;
}

/* Average a preview with those before it if they are noisy.
 *
 * positions_m: for the averaged one; may be the ones of the preview. */
static void fuse(iptm_forecast_memory *memory, iptm_motion *preview, double *positions_m,
                 double *work) {
  const double *const times = preview->times_s;
  int i;
  if (memory->fused == 0 || times[0] < memory->fused_times_s[0]) {
    memory->roughness_m2_s4 = 0.0;
    memory->is_averaged = 0;
    note_preview(memory, preview);
  } else if (times[0] > memory->fused_times_s[0]) {
    int first, last;
    const double differing = roughness_m2_s4(memory, preview, &first, &last);
    if (isnan(differing)) {
      memory->is_averaged = 0;
    } else {
      const double kept = pow((1.0 - FORGETTING_PER_S), times[0] - memory->fused_times_s[0]);
      memory->roughness_m2_s4 += (1.0 - kept) * (differing - memory->roughness_m2_s4);
      if (memory->roughness_m2_s4 >= ROUGH_M_S2 * ROUGH_M_S2) {
        average(memory, preview, kept, first, last, work);
      } else {
        memory->is_averaged = 0;
      }
    }
    note_preview(memory, preview);
  } else if (!is_repeated(memory, preview)) {
    memory->is_averaged = 0;
    note_preview(memory, preview);
  }
  if (!memory->is_averaged) return;
  {
    const double start_m = preview->positions_m[0], *const speeds = memory->averaged_m_s;
    double moved_m = 0.0;
    positions_m[0] = start_m + moved_m;
    for (i = 1; i < preview->nodes; ++i) {
      moved_m += 0.5 * (times[i] - times[i - 1]) * (speeds[i] + speeds[i - 1]);
      positions_m[i] = start_m + moved_m;
    }
    preview->positions_m = positions_m;
    preview->speeds_m_s = speeds;
  }
}

/* The motion. */

/* Let a preview begin where the leader is measured; returns the number of nodes. */
static int follow(const iptm_motion *preview, const iptm_leader *leader, double *times_s,
                  double *positions_m, double *speeds_m_s) {
  const double shift_m =
      leader->position_m - iptm_motion_at(preview, leader->time_s, &speeds_m_s[0]);
  int nodes = 1, i;
  times_s[0] = leader->time_s;
  positions_m[0] = leader->position_m;
  for (i = 0; i < preview->nodes; ++i) {
    if (!(preview->times_s[i] > leader->time_s + ROUNDING_S)) continue;
    times_s[nodes] = preview->times_s[i];
    positions_m[nodes] = preview->positions_m[i] + shift_m;
    speeds_m_s[nodes] = preview->speeds_m_s[i];
    ++nodes;
  }
  return nodes;
}

/* Keep what a preview asserts for the lead times. */
static void keep(const iptm_forecaster *forecaster, iptm_forecast_memory *memory, double tick,
                 const iptm_leader *leader, double known_until_s, const double *times_s,
                 const double *speeds_m_s, int nodes) {
  double *const row = prediction_of(forecaster, memory, tick);
  int place;
  row[0] = tick + 1.0;
  row[1] = leader->speed_m_s;
  for (place = 0; place < forecaster->leads; ++place) {
    const double at_s = leader->time_s + forecaster->lead_ticks[place] * forecaster->tick_s;
    row[2 + place] = at_s > times_s[nodes - 1] || at_s > known_until_s + ROUNDING_S
                         ? NAN
                         : iptm_interpolate(at_s, times_s, speeds_m_s, 1, nodes);
  }
  memory->has_predicted = 1;
  memory->newest_tick = tick;
}

/* Write the motion that limits hold for, as far as it is known: see LeaderPreview.cautious, but behind both
 * expected and measured motion only by what exceeds UNKNOWN_ACCELERATION_M_S2. */
static void limit(const iptm_motion *preview, const iptm_motion *measured,
                  const iptm_leader *leader, double known_s,
                  const double *times_s, const double *positions_m, const double *speeds_m_s,
                  double *limiting_m, double *limiting_m_s, double *work) {
  double *const cautious_m = work, *const cautious_m_s = work + preview->nodes;
  double *const unused_s = work + (ptrdiff_t)2 * preview->nodes;
  const double first_s = preview->times_s[0];
  iptm_motion cautious = *preview;
  int nodes, i;
  for (i = 0; i < preview->nodes; ++i) {
    const double since_s = most(preview->times_s[i] - preview->times_s[0], ROUNDING_S);
    const double rate = 2.0 * (preview->bounds_m[i] - preview->bounds_m[0]) / since_s;
    const double position_m = preview->positions_m[i] - preview->bounds_m[i];
    cautious_m[i] = i > 0 ? most(cautious_m[i - 1], position_m) : position_m;
    cautious_m_s[i] = most(preview->speeds_m_s[i] - rate, 0.0);
  }
  cautious.positions_m = cautious_m;
  cautious.speeds_m_s = cautious_m_s;
  nodes = follow(&cautious, leader, unused_s, limiting_m, limiting_m_s);
  for (i = 0; i < nodes; ++i) {
    if (i < 2 || times_s[i] <= leader->time_s + known_s + ROUNDING_S) {
      const double since_s = most(times_s[i] - first_s, ROUNDING_S);
      const double bound_m =
          iptm_interpolate(times_s[i], preview->times_s, preview->bounds_m, 1, preview->nodes) -
          preview->bounds_m[0];
      const double more_m =
          most(bound_m - 0.5 * UNKNOWN_ACCELERATION_M_S2 * since_s * since_s, 0.0);
      double speed_m_s, position_m = iptm_motion_at(measured, times_s[i], &speed_m_s);
      limiting_m[i] = most(limiting_m[i], least(positions_m[i], position_m) - more_m);
      limiting_m_s[i] =
          most(limiting_m_s[i], least(speeds_m_s[i], speed_m_s) - 2.0 * more_m / since_s);
    } else {
      limiting_m[i] = positions_m[i];
      limiting_m_s[i] = speeds_m_s[i];
    }
  }
}

/* Let a predicted motion be nowhere ahead of the measured one for the next seconds. */
static void stay_behind(const iptm_motion *measured, const iptm_leader *leader,
                        const double *times_s, double *positions_m, double *speeds_m_s,
                        int nodes) {
  double lost_m = 0.0;
  int i;
  for (i = 0; i < nodes; ++i) {
    if (times_s[i] <= leader->time_s + NEAR_S + ROUNDING_S) {
      double speed_m_s;
      lost_m = most(positions_m[i] - iptm_motion_at(measured, times_s[i], &speed_m_s), 0.0);
      speeds_m_s[i] = least(speeds_m_s[i], speed_m_s);
    }
    positions_m[i] = positions_m[i] - lost_m;
  }
}

void iptm_forecast_leader(const iptm_forecaster *forecaster, iptm_forecast_memory *memory,
                          const iptm_leader *leader, const iptm_motion *received,
                          iptm_forecast *forecast) {
  const double tick = rint(leader->time_s / forecaster->tick_s);
  double *times, *positions, *speeds, *const work = memory->work;
  const int known = received->nodes > 0 ? known_nodes(received) : 0;
  const double known_until_s = known > 0 ? received->times_s[known - 1] : -INFINITY;
  double columns[3][IPTM_EXTRAPOLATED_NODES];
  iptm_motion preview = *received, measured;
  int past, i, nodes;
  remember(forecaster, memory, leader);
  observe(forecaster, memory, tick, leader->speed_m_s);
  past = memory->past - 1;
  for (i = 0; i < past; ++i) {
    forecast->times_s[i] = memory->leaders[i].time_s;
    forecast->positions_m[i] = memory->leaders[i].position_m;
    forecast->speeds_m_s[i] = memory->leaders[i].speed_m_s;
  }
  times = forecast->times_s + past;
  positions = forecast->positions_m + past;
  speeds = forecast->speeds_m_s + past;
  forecast->has_limiting = 0;
  forecast->known_s = forecast->trusted_s = 0.0;
  forecast->quality = assess(forecaster, leader, &preview, known_until_s);
  if (forecast->quality != IPTM_PREVIEW_FULL && forecast->quality != IPTM_PREVIEW_SHORT) {
    forecast->nodes = past + extrapolate(forecaster, memory, leader, times, positions, speeds);
    return;
  }
  without_steps_back(&preview, work, work + preview.nodes);
  /* An expectation is revised from tick to tick, which is not noise. */
  if (known == preview.nodes) {
    fuse(memory, &preview, work, work + (ptrdiff_t)2 * preview.nodes);
  }
  nodes = follow(&preview, leader, times, positions, speeds);
  forecast->nodes = past + nodes;
  keep(forecaster, memory, tick, leader, known_until_s, times, speeds, nodes);
  forecast->known_s = most(known_until_s - leader->time_s, 0.0);
  forecast->trusted_s = memory->is_doubted ? memory->trusted_s : INFINITY;
  if (!(fabs(speeds[0] - leader->speed_m_s) <= PRESENT_ERROR_M_S)) forecast->trusted_s = 0.0;
  if (forecast->trusted_s < forecast->known_s) {
    forecast->known_s = forecast->trusted_s;
    forecast->quality = IPTM_PREVIEW_DOUBTED;
  }
  if (preview.bounds_m == NULL && !(forecast->trusted_s < NEAR_S)) return;
  measured.nodes = extrapolate(forecaster, memory, leader, columns[0], columns[1], columns[2]);
  measured.times_s = columns[0];
  measured.positions_m = columns[1];
  measured.speeds_m_s = columns[2];
  if (preview.bounds_m != NULL) {
    forecast->has_limiting = 1;
    for (i = 0; i < past; ++i) {
      forecast->limiting_positions_m[i] = forecast->positions_m[i];
      forecast->limiting_speeds_m_s[i] = forecast->speeds_m_s[i];
    }
    limit(&preview, &measured, leader, forecast->known_s, times, positions, speeds,
          forecast->limiting_positions_m + past, forecast->limiting_speeds_m_s + past,
          work + (ptrdiff_t)2 * preview.nodes);
  }
  if (forecast->trusted_s < NEAR_S) {
    stay_behind(&measured, leader, times, positions, speeds, nodes);
    if (forecast->has_limiting) {
      stay_behind(&measured, leader, times, forecast->limiting_positions_m + past,
                  forecast->limiting_speeds_m_s + past, nodes);
    }
  }
}

/* Forecast of the leader's motion: forecast.py and preview_trust.py in C99, the same operations in the same order. */
#ifndef IPTM_FORECAST_H
#define IPTM_FORECAST_H

#include "tick_data.h"
#include "forecast_size_constants.h"

enum { IPTM_MOST_LEADS = IPTM_LONGEST_LEAD_S };

/* Quality of a preview, see PreviewQuality. */
typedef enum {
  IPTM_PREVIEW_FULL = 0,
  IPTM_PREVIEW_SHORT = 1,
  IPTM_PREVIEW_STALE = 2,
  IPTM_PREVIEW_MISSING = 3,
  IPTM_PREVIEW_INVALID = 4,
  IPTM_PREVIEW_DOUBTED = 5
} iptm_preview_quality;

/* What does not change, and the room of a memory. */
typedef struct {
  double tick_s, horizon_s, max_age_s;
  double decay_s;        /* of the measured acceleration where the leader is extrapolated */
  double braking_decay_s; /* the same where it brakes */
  int leads;             /* lead times at which predictions are compared, in ticks, increasing */
  int lead_ticks[IPTM_MOST_LEADS];
  int past_room, preview_room; /* nodes */
} iptm_forecaster;

/* State carried from tick to tick. All zero, but for the arrays, begins a trip. */
typedef struct {
  int past;                 /* leaders measured in the last seconds */
  int errors;               /* ticks in errors_m_s */
  int has_predicted, is_doubted, is_unproved;
  int fused;                /* nodes of the newest preview, 0 before the first one */
  int is_averaged;
  double newest_tick, last_error_tick, trusted_s;
  double roughness_m2_s4;
  double errors_m_s[IPTM_SMOOTHED_TICKS * IPTM_MOST_LEADS]; /* oldest first */
  iptm_leader *leaders;     /* past_room, oldest first */
  double *predictions;      /* rows of tick + 1, measured speed, predicted speeds; row: tick modulo their number */
  double *fused_times_s, *fused_speeds_m_s, *averaged_m_s, *weights; /* preview_room each */
  double *work;             /* 5 preview_room; its content means nothing between ticks */
} iptm_forecast_memory;

/* The past and expected motion, see LeaderForecast; room: past_room and the larger of preview_room + 1 and
 * IPTM_EXTRAPOLATED_NODES. */
typedef struct {
  double *times_s, *positions_m, *speeds_m_s;
  double *limiting_positions_m, *limiting_speeds_m_s; /* at the same times, where has_limiting */
  int nodes, has_limiting;
  iptm_preview_quality quality;
  double known_s, trusted_s;
} iptm_forecast;

/* Combine a measured leader with a preview; negative nodes: its columns differ in length. */
void iptm_forecast_leader(const iptm_forecaster *forecaster, iptm_forecast_memory *memory,
                          const iptm_leader *leader, const iptm_motion *preview,
                          iptm_forecast *forecast);

/* Return a measured leader as extrapolated to a later instant; as measured for the same one. */
iptm_leader iptm_leader_at(const iptm_forecaster *forecaster, const iptm_forecast_memory *memory,
                           const iptm_leader *leader, double time_s);

#endif

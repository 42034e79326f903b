/* Whether what a tick is decided from is finite and in range, see trusted_measurements of measurements.py. */
#ifndef IPTM_SOUND_H
#define IPTM_SOUND_H

#include "tick_data.h"

/* What cannot be used. */
enum { IPTM_UNSOUND_MOTION = 1, IPTM_UNSOUND_PACK = 2, IPTM_UNSOUND_LEADER = 4, IPTM_UNSOUND_AHEAD = 8 };

/* Return bits; 0 where all is sound. Times and positions of both vehicles, and a road, are needed for a plan.
 *
 * lowest, highest: plausible bounds of a vehicle. leader: may be NULL. A preview is judged by
 * iptm_forecast_leader. */
unsigned iptm_unsound(const iptm_grid *grid, const iptm_vehicle *lowest, const iptm_vehicle *highest,
                      const iptm_vehicle *vehicle, const iptm_leader *leader, const iptm_ahead *ahead);

#endif

/* Sensors and cooling of a pack of which all is plausible: PackObserver in C99, the same operations in the same
 * order. */
#ifndef IPTM_PACK_H
#define IPTM_PACK_H

#include "vehicle.h"

/* Constants of measurements.py and pack_observer.py, and of the coolant of a pack. */
typedef struct {
  double low[9], high[9]; /* of the numbers of a vehicle */
  double most_tick_s, tolerance_k, noise_factor, stuck_k, stuck_steps, correction_1_s;
  double contradiction_k, effect_w, effect_share, effect_s, follow_w, follow_share, follow_s;
  double inlet, cell_1, cell_n; /* weights of the coolant at the outlet; no cells: it shows nothing */
  double flow_w_k;
} iptm_pack;

/* As in SensorMemory; model_k is not a number before the first tick. */
typedef struct {
  double model_k, value_k, moved_k, step_k, noise_k2, bad_s, sound_s;
} iptm_sensor;

/* As in PackMemory. */
typedef struct {
  double time_s, age_s, contradicted_s, without_effect_s, unfollowed_s;
  iptm_sensor sensors[2];
} iptm_pack_memory;

/* Measured and expected values of coolant and compressor at a tick. */
typedef struct {
  double inlet_k, outlet_k, rates_k_s[2], cooling_w, asked_w;
} iptm_pack_reading;

/* Move a memory on by a tick; returns 0, and leaves the memory, where anything asks for a closer look. */
int iptm_watch_pack(const iptm_pack *pack, iptm_pack_memory *memory, const iptm_vehicle *vehicle,
                    const iptm_pack_reading *reading);

#endif

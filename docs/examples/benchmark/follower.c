/* The same law in C, by the header of `iptm codegen`: it takes the place of controller.c. */
#include "controller.h"

#include <math.h>

iptm_decision iptm_decide(iptm_memory *memory, iptm_scratch *scratch, const iptm_inputs *inputs) {
  const iptm_vehicle *const ego = inputs->vehicle;
  const iptm_leader *const leader = inputs->leader;
  iptm_decision decision = {{-1.0, 0.0}, IPTM_OPTIMAL};
  (void)memory;
  (void)scratch;
  if (ego != NULL && leader != NULL) {
    const double gap_error_m = leader->position_m - ego->position_m - 6.0 - 2.0 * ego->speed_m_s;
    const double wanted = 0.1 * gap_error_m + 0.8 * (leader->speed_m_s - ego->speed_m_s);
    decision.command.acceleration_m_s2 = fmin(fmax(wanted, -3.0), 2.0);
    decision.command.compressor_power_w = ego->cell_n_temperature_k - 273.15 > 34.0 ? 1500.0 : 0.0;
  }
  return decision;
}

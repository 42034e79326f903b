/* Door of an entrant in C: a tick as plain numbers. A place of iptm_door_size zeros begins a trip. */
#include <string.h>

#include "controller.h"

typedef struct {
  iptm_memory memory;
  iptm_scratch scratch;
} place;

size_t iptm_door_size(void) { return sizeof(place); }

/* vehicle and leader in the order of their structures, NULL where not measured; command: acceleration and power. */
void iptm_door_decide(void *at, const double *vehicle, const double *leader, int nodes, const double *times_s,
                      const double *positions_m, const double *speeds_m_s, int road_nodes,
                      const double *road_m, const double *slopes_rad, double charge_w, double *command) {
  place *const here = at;
  iptm_vehicle ego;
  iptm_leader ahead;
  iptm_motion preview;
  iptm_slope road;
  iptm_inputs inputs;
  iptm_decision decision;
  memset(&inputs, 0, sizeof(inputs));
  memset(&preview, 0, sizeof(preview));
  preview.nodes = nodes;
  preview.times_s = times_s;
  preview.positions_m = positions_m;
  preview.speeds_m_s = speeds_m_s;
  road.nodes = road_nodes;
  road.positions_m = road_m;
  road.slopes_rad = slopes_rad;
  if (vehicle != NULL) inputs.vehicle = memcpy(&ego, vehicle, sizeof(ego));
  if (leader != NULL) inputs.leader = memcpy(&ahead, leader, sizeof(ahead));
  inputs.preview = &preview;
  inputs.ahead.slope = &road;
  inputs.ahead.charge_w = charge_w;
  decision = iptm_decide(&here->memory, &here->scratch, &inputs);
  command[0] = decision.command.acceleration_m_s2;
  command[1] = decision.command.compressor_power_w;
}

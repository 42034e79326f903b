/* Commands without a usable plan: the safe law, the thermostat and the controlled stop of ladder.py in C99. */
#ifndef IPTM_FALLBACK_H
#define IPTM_FALLBACK_H

#include "vehicle.h"

/* Follow the leader by the intelligent driver model, able to stop at any time, with the thermostat. */
iptm_command iptm_safe_following(const iptm_limits *limits, const iptm_vehicle *vehicle,
                                 const iptm_leader *leader);

/* Brake comfortably to standstill without a jolt, the thermostat still cooling. */
iptm_command iptm_controlled_stop(const iptm_limits *limits, const iptm_vehicle *vehicle);

/* Brake a vehicle of which nothing is measured; it is cooled as it last needed it. */
iptm_command iptm_blind_braking(const iptm_limits *limits, const iptm_vehicle *last);

#endif

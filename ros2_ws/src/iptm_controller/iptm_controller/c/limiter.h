/* The last limiter of a command: safeguards.py in C99, independent of the solver. */
#ifndef IPTM_LIMITER_H
#define IPTM_LIMITER_H

#include "vehicle.h"

/* Bounds that changed a command, as bits. */
enum {
  IPTM_LIMIT_ACCELERATION_NOT_FINITE = 1,
  IPTM_LIMIT_POWER_NOT_FINITE = 2,
  IPTM_LIMIT_ACCELERATION = 4,
  IPTM_LIMIT_TOP_SPEED = 8,
  IPTM_LIMIT_JERK = 16,
  IPTM_LIMIT_POWER = 32,
  IPTM_LIMIT_POWER_RATE = 64
};

/* Limit a command relative to the actuated one; returns the bounds that changed it. */
unsigned iptm_limit_command(const iptm_limits *limits, const iptm_vehicle *vehicle,
                            iptm_command *command);

#endif

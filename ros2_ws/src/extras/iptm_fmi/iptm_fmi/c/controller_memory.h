/* What the controller carries from tick to tick, and what a tick works on. */
#ifndef IPTM_UNIT_MEMORY_H
#define IPTM_UNIT_MEMORY_H
#include "controller.h"

typedef struct {
  iptm_memory memory;
  iptm_scratch scratch;
  int has_ticked;
  double next_tick_s;
} iptm_unit_memory;
#endif

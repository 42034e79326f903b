#define _POSIX_C_SOURCE 199309L
#include "clock.h"

#include <time.h>

double iptm_monotonic_s(void) {
  struct timespec now;
  (void)clock_gettime(CLOCK_MONOTONIC, &now);
  return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* The clock of a POSIX system, for the deadline of a solve. */
#ifndef IPTM_CLOCK_H
#define IPTM_CLOCK_H

double iptm_monotonic_s(void);

#endif

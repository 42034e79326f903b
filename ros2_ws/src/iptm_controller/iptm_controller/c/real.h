/* The type that solver and stages compute in; data of a tick, limiter and fallback are in double precision. */
#ifndef IPTM_REAL_H
#define IPTM_REAL_H

#ifdef IPTM_FLOAT
typedef float iptm_real;
/* What sums over a horizon lose: relative, and of a violation. */
#define IPTM_ROUND_OFF 1e-6
#define IPTM_VIOLATION_ROUND_OFF 1e-5
#else
typedef double iptm_real;
#define IPTM_ROUND_OFF 1e-10
#define IPTM_VIOLATION_ROUND_OFF 0.0
#endif

/* The solver stops at this error of optimality at the latest; in single precision, less is round-off. */
#ifndef IPTM_LEAST_TOLERANCE
#ifdef IPTM_FLOAT
#define IPTM_LEAST_TOLERANCE 1e-4
#else
#define IPTM_LEAST_TOLERANCE 0.0
#endif
#endif

#endif

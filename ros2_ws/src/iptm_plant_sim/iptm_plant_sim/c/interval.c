/* The interval of integrator.py: sub-steps in order, each by the generated code of the model.
 *
 * Generated functions take a vector per argument, the last one of the numbers of the model, and have no state. */

#include "interval_constants.h"

typedef int iptm_generated(const double **arguments, double **results, long long *, double *, int);
iptm_generated sub_step, interval_end;

/* Integrate an interval of n sub-steps.
 *
 * numbers: of the model. held: compressor power, charge and bounds, constant in the interval.
 * lengths_s, accelerations_m_s2: n; slopes_rad: 2 n + 1; speeds_m_s: 3 n.
 * found: VALUES, at the start before and at the end after; then electrics at the end. */
void iptm_integrate(int n, const double *numbers, const double *held, const double *lengths_s,
                    const double *accelerations_m_s2, const double *slopes_rad,
                    const double *speeds_m_s, double *found) {
  double other[VALUES];
  double *from = found, *to = other;
  const double *last[] = {found, 0, held, 0, 0, numbers};
  double *end = found + VALUES;
  int i;
  for (i = 0; i < n; ++i) {
    const double *arguments[] = {from,          accelerations_m_s2 + i, held,
                                 lengths_s + i, slopes_rad + 2 * i,     speeds_m_s + 3 * i, numbers};
    double *const done = from;
    sub_step(arguments, &to, 0, 0, 0);
    from = to;
    to = done;
  }
  if (from != found) {
    for (i = 0; i < VALUES; ++i) found[i] = from[i];
  }
  last[1] = accelerations_m_s2 + n - 1;
  last[3] = slopes_rad + 2 * n;
  last[4] = speeds_m_s + 3 * n - 1;
  interval_end(last, &end, 0, 0, 0);
}

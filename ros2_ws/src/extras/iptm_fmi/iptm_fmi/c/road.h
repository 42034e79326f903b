/* Slope of the road between the nodes of a table, the ends held, as numpy.interp has it. */
#ifndef IPTM_ROAD_H
#define IPTM_ROAD_H

static double iptm_slope_at(int nodes, const double *positions_m, const double *slopes_rad, double position_m) {
  int i = 0;
  if (nodes <= 0) return 0.0;
  if (position_m >= positions_m[nodes - 1]) return slopes_rad[nodes - 1];
  if (position_m <= positions_m[0]) return slopes_rad[0];
  while (positions_m[i + 1] <= position_m) ++i;
  return (slopes_rad[i + 1] - slopes_rad[i]) / (positions_m[i + 1] - positions_m[i]) *
             (position_m - positions_m[i]) +
         slopes_rad[i];
}

/* The first place at which positions do not increase, 0 for none. */
static int iptm_road_fault(int nodes, const double *positions_m) {
  int i;
  for (i = 1; i < nodes; ++i) {
    if (!(positions_m[i] > positions_m[i - 1])) return i;
  }
  return 0;
}

#endif

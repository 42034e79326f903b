/* The ego vehicle: measurements, commands, abilities. */
#ifndef IPTM_VEHICLE_H
#define IPTM_VEHICLE_H

/* The ego vehicle now; its inputs are the values last actuated. */
typedef struct {
  double time_s, position_m, speed_m_s, cell_1_temperature_k, cell_n_temperature_k;
  double acceleration_m_s2, compressor_power_w, cell_1_capacity_loss, cell_n_capacity_loss;
} iptm_vehicle;

/* The lead vehicle as measured. */
typedef struct {
  double time_s, position_m, speed_m_s;
} iptm_leader;

typedef struct {
  double acceleration_m_s2, compressor_power_w;
} iptm_command;

/* Limits of the model, see LimitParameters and GapParameters; the sampling time. */
typedef struct {
  double min_acceleration_m_s2, max_acceleration_m_s2, max_jerk_m_s3, max_speed_m_s;
  double min_compressor_power_w, max_compressor_power_w, lowest_thermal_power_w;
  double max_compressor_rate_w_s, min_temperature_k, standstill_gap_m, time_headway_s, tick_s;
} iptm_limits;

#endif

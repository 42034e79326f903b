/* The rule of the safety monitor: safety_monitor.py in C99, independent of the controller.
 *
 * In here: safe distance, decision to brake and to release, and what brakes and road made of a request. Not in here:
 * tracking of the vehicle ahead where its sensor fails, and friction and slope of the road; what both vehicles can
 * do there comes as numbers. */
#ifndef IPTM_SAFETY_MONITOR_H
#define IPTM_SAFETY_MONITOR_H

#include <stdbool.h>

/* Settings of the monitor and the stated brakes. */
typedef struct {
  double reaction_s, release_reaction_s, hold_s, margin_m, gap_accuracy_m, lead_speed_accuracy_m_s;
  double brake_delay_s, brake_build_up_m_s3;
} iptm_monitor_settings;

/* Decelerations that can be counted on at a place, positive. */
typedef struct {
  double own_m_s2, lead_m_s2;
} iptm_braking_capability;

typedef struct {
  iptm_braking_capability full, slippery, descent; /* slippery: if it does not descend */
  bool may_be_slippery;                            /* false where the friction is known */
  bool descends;
} iptm_road_braking;

/* State carried from one instant to the next. All zero but a brake share of 1 begins a trip. */
typedef struct {
  bool braking; /* the monitor brakes */
  bool gently;  /* with what a slippery road gives, not fully */
  double since_s;
  double brake_share;   /* share of a request that the brakes deliver, as estimated */
  double followed_m_s2; /* hardest deceleration delivered in full */
  double road_m_s2;     /* deceleration at which the road met its limit, 0 where it has not */
} iptm_monitor_memory;

typedef struct {
  double time_s, position_m, speed_m_s;
  double acceleration_m_s2; /* that the vehicle has if the monitor does not brake */
} iptm_monitored;

/* Smallest gap from which a collision can be avoided whatever the vehicle ahead does; 0 at standstill. */
double iptm_safe_distance_m(const iptm_monitor_settings *settings, double speed_m_s,
                            double acceleration_m_s2, double lead_speed_m_s, double brake_share,
                            double further_reaction_s, const iptm_braking_capability *both);

/* Decide at one instant whether to brake.
 *
 * has_lead: false for a free road, on which brakes are released.
 * unseen_s: time for which measurements of the vehicle ahead have been missing. */
void iptm_monitor_judge(const iptm_monitor_settings *settings, iptm_monitor_memory *memory,
                        const iptm_monitored *ego, bool has_lead, double lead_position_m,
                        double lead_speed_m_s, const iptm_road_braking *road, double unseen_s);

/* Learn from what brakes and road made of a request over an interval; the speed is that at its end. */
void iptm_monitor_learn(iptm_monitor_memory *memory, double requested_m_s2, double delivered_m_s2,
                        double speed_m_s, double duration_s);

#endif

/* A unit, which is the content of an FMU, and one instance of it; what both versions of FMI share.
 *
 * Values are doubles in the order of unit_variables.h, which is generated. Memory is taken for states that a master keeps
 * and by the functions that make an instance, nowhere else. */
#ifndef IPTM_UNIT_H
#define IPTM_UNIT_H

#include <stddef.h>

#include "unit_variables.h"
#include "unit_memory.h"

typedef enum { IPTM_OUTPUT, IPTM_INPUT, IPTM_START, IPTM_PARAMETER } iptm_kind;

/* A variable: its first value, how many it has, and what values are taken. */
typedef struct {
  unsigned first, size;
  iptm_kind kind;
  double least, most;
  const char *name;
} iptm_variable;

extern const iptm_variable iptm_variables[IPTM_UNIT_VARIABLES];
extern const double iptm_starts[IPTM_UNIT_VALUES];

typedef enum { IPTM_DONE, IPTM_DISCARDED, IPTM_REFUSED } iptm_result;

typedef enum { IPTM_MADE, IPTM_STARTING, IPTM_STEPPING, IPTM_ENDED } iptm_phase;

/* What a step changes; a copy of it is a state. */
typedef struct {
  iptm_phase phase;
  double time_s, values[IPTM_UNIT_VALUES];
  iptm_unit_memory memory;
} iptm_state;

typedef struct {
  iptm_state now, before;
  char message[256];
} iptm_instance;

/* Of the unit: outputs before the first step; one step. A step that returns another result than IPTM_DONE counts as
 * not done, whatever it has changed. */
iptm_result iptm_unit_begin(iptm_instance *instance);
iptm_result iptm_unit_step(iptm_instance *instance, double length_s);

/* Of every instance. A result other than IPTM_DONE has a message. */
void iptm_reset(iptm_instance *instance);
iptm_result iptm_enter(iptm_instance *instance, double start_s);
iptm_result iptm_start_at(iptm_instance *instance, double start_s);
iptm_result iptm_begin(iptm_instance *instance);
iptm_result iptm_step(iptm_instance *instance, double time_s, double length_s);
iptm_result iptm_fail(iptm_instance *instance, iptm_result result, const char *format, ...);

/* Read or write a value; the place counts over all values, behind which the time can be read. */
iptm_result iptm_read(iptm_instance *instance, unsigned place, double *value);
iptm_result iptm_write(iptm_instance *instance, unsigned place, double value);

/* Around the writing of several values: all of them or, after a refusal, none. */
void iptm_write_begins(iptm_instance *instance);
iptm_result iptm_write_ends(iptm_instance *instance, iptm_result result);

/* States that a master keeps: `kept` is NULL for a new one. As bytes they are IPTM_STATE_BYTES long. */
#define IPTM_STATE_BYTES sizeof(iptm_state)
iptm_result iptm_keep(iptm_instance *instance, void **kept);
iptm_result iptm_restore(iptm_instance *instance, const void *kept);
iptm_result iptm_to_bytes(iptm_instance *instance, const void *kept, void *bytes, size_t size);
iptm_result iptm_from_bytes(iptm_instance *instance, const void *bytes, size_t size, void **kept);
void iptm_drop(void **kept);

#endif

/* A plant has no memory beside its values. */
#ifndef IPTM_UNIT_MEMORY_H
#define IPTM_UNIT_MEMORY_H
typedef struct {
  char nothing;
} iptm_unit_memory;
#endif

/* Start of a Cortex-M7 under QEMU, its count of instructions, and the depth of its stack. */
#include <stdint.h>
#include <stdio.h>

#define REGISTER(address) (*(volatile uint32_t *)(address))
#define SYSTICK_CONTROL REGISTER(0xE000E010)
#define SYSTICK_RELOAD REGISTER(0xE000E014)
#define SYSTICK_VALUE REGISTER(0xE000E018)
#define COPROCESSOR_ACCESS REGISTER(0xE000ED88)

enum { TICK_INSTRUCTIONS = 40, RANGE = 0x1000000, PAINTED_WORDS = 8192, OWN_WORDS = 64 };
static const uint32_t PAINT = 0xA5A5A5A5;

static unsigned long deepest;

void _start(void);

static void reset(void) {
  COPROCESSOR_ACCESS |= 0xFU << 20; /* the FPU */
  SYSTICK_RELOAD = RANGE - 1;
  SYSTICK_VALUE = 0;
  SYSTICK_CONTROL = 5; /* by the clock of the processor */
  _start();
}

static void fault(void) {
  for (;;) continue;
}

__attribute__((section(".vectors"))) const struct {
  uint32_t stack;
  void (*handlers[15])(void);
} vectors = {0x20400000, {reset, fault, fault, fault, fault, fault}};

/* Called before and after a tick. With -icount shift=0 an instruction is a nanosecond of a clock of 25 MHz. */
unsigned long instructions(void) {
  static uint32_t last = RANGE - 1;
  static unsigned long count;
  static int is_after;
  const uint32_t now = SYSTICK_VALUE;
  volatile uint32_t here = 0, *const top = &here - OWN_WORDS, *word = top - PAINTED_WORDS;
  count += (unsigned long)((last - now) & (RANGE - 1)) * TICK_INSTRUCTIONS;
  if (is_after) {
    while (word < top && *word == PAINT) ++word;
    if (4UL * (unsigned long)(top - word + OWN_WORDS) > deepest) {
      deepest = 4UL * (unsigned long)(top - word + OWN_WORDS);
    }
  } else {
    while (word < top) *word++ = PAINT;
  }
  is_after = !is_after;
  last = SYSTICK_VALUE;
  return count;
}

__attribute__((destructor)) static void report(void) { printf("stack %lu bytes\n", deepest); }

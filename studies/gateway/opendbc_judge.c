/* The safety code of opendbc as a library; built by opendbc_judge.py against the headers of its package. */
#include <stdbool.h>
#include "opendbc/safety/tests/libsafety/fake_stm.h"
#include "opendbc/safety/can.h"
#include "opendbc/safety/safety.h"

void judge_time(uint32_t us) { timer_cnt = us; }
bool judge_allows(void) { return get_longitudinal_allowed(); }

static CANPacket_t packet(int bus, int address, const uint8_t *data, int length) {
  CANPacket_t message = {0};
  int code = 0;
  while (dlc_to_len[code] < length) code++;
  message.bus = bus;
  message.addr = address;
  message.data_len_code = code;
  for (int i = 0; i < length; i++) message.data[i] = data[i];
  return message;
}

bool judge_receives(int bus, int address, const uint8_t *data, int length) {
  CANPacket_t message = packet(bus, address, data, length);
  return safety_rx_hook(&message);
}

bool judge_lets_pass(int bus, int address, const uint8_t *data, int length) {
  CANPacket_t message = packet(bus, address, data, length);
  return safety_tx_hook(&message);
}

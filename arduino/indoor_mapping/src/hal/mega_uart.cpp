// Serial line: a ring of bytes for each way, and the stop byte acted upon in the receive interrupt itself.
#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

#include "../config.h"
#include "../core/protocol.h"
#include "mega.h"

namespace mega {
namespace {

// Indices of eight bits wrap by themselves
char g_rx[256];
volatile uint8_t g_rx_head, g_rx_tail;

// All reports of one period, and what answers the bridge meanwhile
const uint16_t kTxBytes = 512;
char g_tx[kTxBytes];
volatile uint16_t g_tx_head, g_tx_tail;

uint16_t after(uint16_t index) { return (index + 1u) % kTxBytes; }

}  // namespace

void begin_uart() {
  UCSR0A = _BV(U2X0);
  UBRR0 = (F_CPU + 4 * config::kBaud) / (8 * config::kBaud) - 1;
  UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
  UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

int16_t uart_read() {
  int16_t byte = -1;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    if (g_rx_tail != g_rx_head) {
      byte = static_cast<uint8_t>(g_rx[g_rx_tail]);
      g_rx_tail = static_cast<uint8_t>(g_rx_tail + 1);
    }
  }
  // Whoever reads it stops and latches: from here on the core holds the motors off
  if (byte == core::kStopByte) lift_inhibit(kStopByteSeen);
  return byte;
}

bool uart_write(const char* data, uint8_t length) {
  uint16_t head = g_tx_head, used;
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) { used = (head - g_tx_tail) % kTxBytes; }
  if (length >= kTxBytes - used) return false;
  for (uint8_t i = 0; i < length; ++i) {
    g_tx[head] = data[i];
    head = after(head);
  }
  ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
    g_tx_head = head;
    UCSR0B |= _BV(UDRIE0);
  }
  return true;
}

}  // namespace mega

ISR(USART0_RX_vect) {
  const char byte = static_cast<char>(UDR0);
  if (byte == core::kStopByte) {
    mega::inhibit(mega::kStopByteSeen);
    // What waits before it is outdated, and must not keep it out of a full ring
    mega::g_rx_tail = mega::g_rx_head;
  }
  const uint8_t next = static_cast<uint8_t>(mega::g_rx_head + 1);
  if (next == mega::g_rx_tail) return;
  mega::g_rx[mega::g_rx_head] = byte;
  mega::g_rx_head = next;
}

ISR(USART0_UDRE_vect) {
  if (mega::g_tx_tail == mega::g_tx_head) {
    UCSR0B &= static_cast<uint8_t>(~_BV(UDRIE0));
    return;
  }
  UDR0 = static_cast<uint8_t>(mega::g_tx[mega::g_tx_tail]);
  mega::g_tx_tail = mega::after(mega::g_tx_tail);
}

// SENDER_RECEIVER_TIME_MESSAGE*CRC\n, both ways. A newline always resynchronises: garbage costs one line.
#pragma once
#include <stdint.h>

namespace core {

// CRC-16/CCITT-FALSE, byte by byte without a table
inline uint16_t crc16(uint16_t crc, char byte) {
  uint8_t x = static_cast<uint8_t>((crc >> 8) ^ static_cast<uint8_t>(byte));
  x = static_cast<uint8_t>(x ^ (x >> 4));
  return static_cast<uint16_t>((crc << 8) ^ (static_cast<uint16_t>(x) << 12) ^ (static_cast<uint16_t>(x) << 5) ^ x);
}

static const uint8_t kMaxLine = 120;  // with the newline

// Views into the decoder's buffer, valid until the next byte goes in
struct Line {
  const char* sender;
  const char* receiver;
  uint32_t time_ms;
  const char* type;
  const char* fields;  // ",a,b,..." or ""
};

class LineDecoder {
 public:
  LineDecoder() : length_(0), overflow_(false), bad_(0) {}
  // True when this byte completed a valid line
  bool feed(char byte, Line* line);
  // Damaged lines so far
  uint16_t bad() const { return bad_; }

 private:
  bool parse(Line* line);
  char buffer_[kMaxLine];
  uint8_t length_;
  bool overflow_;
  uint16_t bad_;
};

class LineEncoder {
 public:
  LineEncoder() : length_(0), crc_(0xFFFF), full_(false) {}
  void begin(const char* sender, const char* receiver, uint32_t time_ms, const char* type);
  void put_field(int32_t value);
  // Closes the line; its length, or 0 when it did not fit
  uint8_t finish();
  const char* data() const { return buffer_; }

 private:
  void put(char byte);
  void put(const char* text);
  void put_number(uint32_t value);
  char buffer_[kMaxLine];
  uint8_t length_;
  uint16_t crc_;
  bool full_;
};

// Takes ",number" off the front of `*fields`; false unless it is a plain decimal within the bounds
bool read_field(const char** fields, int32_t minimum, int32_t maximum, int32_t* value);

bool same(const char* a, const char* b);

}  // namespace core

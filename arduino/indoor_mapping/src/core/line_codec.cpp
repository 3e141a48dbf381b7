#include "line_codec.h"

namespace core {
namespace {

const uint8_t kTail = 5;  // "*CRC"

int8_t hex_digit(char c) {
  if (c >= '0' && c <= '9') return static_cast<int8_t>(c - '0');
  if (c >= 'A' && c <= 'F') return static_cast<int8_t>(c - 'A' + 10);
  return -1;
}

bool is_digit(char c) { return c >= '0' && c <= '9'; }

// Digits without sign or padding, up to `limit`
bool read_digits(const char** text, uint32_t limit, uint32_t* value) {
  const char* p = *text;
  if (!is_digit(*p) || (*p == '0' && is_digit(p[1]))) return false;
  uint32_t v = 0;
  for (; is_digit(*p); ++p) {
    const uint32_t digit = static_cast<uint32_t>(*p - '0');
    if (v > (limit - digit) / 10u) return false;
    v = v * 10u + digit;
  }
  *text = p;
  *value = v;
  return true;
}

}  // namespace

bool same(const char* a, const char* b) {
  while (*a && *a == *b) {
    ++a;
    ++b;
  }
  return *a == *b;
}

bool read_field(const char** fields, int32_t minimum, int32_t maximum, int32_t* value) {
  const char* p = *fields;
  if (*p != ',') return false;
  ++p;
  const bool negative = *p == '-';
  if (negative) ++p;
  uint32_t magnitude = 0;
  if (!read_digits(&p, negative ? 0x80000000u : 0x7FFFFFFFu, &magnitude)) return false;
  if (negative && magnitude == 0) return false;
  const int32_t v = static_cast<int32_t>(negative ? 0u - magnitude : magnitude);
  if (v < minimum || v > maximum) return false;
  *fields = p;
  *value = v;
  return true;
}

bool LineDecoder::feed(char byte, Line* line) {
  if (byte != '\n') {
    if (length_ < kMaxLine - 1) {
      buffer_[length_++] = byte;
    } else {
      overflow_ = true;
    }
    return false;
  }
  const bool empty = length_ == 0;
  const bool good = !empty && !overflow_ && parse(line);
  if (!good && !empty && bad_ < 0xFFFF) ++bad_;
  length_ = 0;
  overflow_ = false;
  return good;
}

bool LineDecoder::parse(Line* line) {
  if (length_ <= kTail || buffer_[length_ - kTail] != '*') return false;
  const uint8_t end = static_cast<uint8_t>(length_ - kTail);
  uint16_t wanted = 0, crc = 0xFFFF;
  for (uint8_t i = static_cast<uint8_t>(end + 1); i < length_; ++i) {
    const int8_t digit = hex_digit(buffer_[i]);
    if (digit < 0) return false;
    wanted = static_cast<uint16_t>((wanted << 4) | static_cast<uint8_t>(digit));
  }
  for (uint8_t i = 0; i < end; ++i) {
    if (buffer_[i] == 0) return false;
    crc = crc16(crc, buffer_[i]);
  }
  if (crc != wanted) return false;
  buffer_[end] = 0;

  char* part[4] = {buffer_, buffer_, buffer_, buffer_};
  uint8_t parts = 1;
  for (char* p = buffer_; *p && parts < 4; ++p) {
    if (*p != '_') continue;
    *p = 0;
    part[parts++] = p + 1;
  }
  if (parts < 4) return false;
  const char* time = part[2];
  if (!read_digits(&time, 0xFFFFFFFFu, &line->time_ms) || *time != 0) return false;
  // The fields begin with the comma that ends the type: the type moves one to the left, over its `_`
  char* type = part[3] - 1;
  char* p = part[3];
  for (; *p && *p != ','; ++p) p[-1] = *p;
  p[-1] = 0;
  line->sender = part[0];
  line->receiver = part[1];
  line->type = type;
  line->fields = p;
  return true;
}

void LineEncoder::put(char byte) {
  if (length_ >= kMaxLine - kTail - 1) {
    full_ = true;
    return;
  }
  buffer_[length_++] = byte;
  crc_ = crc16(crc_, byte);
}

void LineEncoder::put(const char* text) {
  while (*text) put(*text++);
}

void LineEncoder::put_number(uint32_t value) {
  char digits[10];
  uint8_t count = 0;
  // A 32-bit division is slow on the AVR: 16 bits as soon as they do
  while (value > 0xFFFFu) {
    const uint32_t quotient = value / 10u;
    digits[count++] = static_cast<char>('0' + (value - quotient * 10u));
    value = quotient;
  }
  uint16_t small = static_cast<uint16_t>(value);
  do {
    const uint16_t quotient = static_cast<uint16_t>(small / 10u);
    digits[count++] = static_cast<char>('0' + (small - quotient * 10u));
    small = quotient;
  } while (small);
  while (count) put(digits[--count]);
}

void LineEncoder::begin(const char* sender, const char* receiver, uint32_t time_ms, const char* type) {
  length_ = 0;
  crc_ = 0xFFFF;
  full_ = false;
  put(sender);
  put('_');
  put(receiver);
  put('_');
  put_number(time_ms);
  put('_');
  put(type);
}

void LineEncoder::put_field(int32_t value) {
  put(',');
  if (value < 0) put('-');
  put_number(value < 0 ? 0u - static_cast<uint32_t>(value) : static_cast<uint32_t>(value));
}

uint8_t LineEncoder::finish() {
  if (full_) return 0;
  static const char kHex[] = "0123456789ABCDEF";
  const uint16_t crc = crc_;
  buffer_[length_++] = '*';
  for (int8_t shift = 12; shift >= 0; shift = static_cast<int8_t>(shift - 4)) buffer_[length_++] = kHex[(crc >> shift) & 15];
  buffer_[length_++] = '\n';
  return length_;
}

}  // namespace core

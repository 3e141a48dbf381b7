#include "src/hal/hal.h"
void setup() { hal::begin(); }
void loop() { hal::spin(); }

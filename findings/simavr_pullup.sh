#!/usr/bin/env bash
# simavr 1.6 (Debian 12, the newest there): a pulled-down input reads 1 again when another pin of its port is written.
#
# Expected: an input with its pull-up on, which a switch connects to ground (`avr_raise_irq` of the pin with 0), reads 0
# until the switch opens, whatever the firmware does with the other pins of the port.
# Seen: it reads 0 before and 1 after the firmware sets an output pin of the same port: every write to PORTx puts each
# input with a pull-up back to 1. With AVR_IOCTL_IOPORT_SET_EXTERNAL set to the switch's level as well, it reads 0.
# Means: buttons, bumpers and encoders that share a port with an LED or a motor release themselves in the simulation,
# and pin-change interrupts come that no hardware gives. Set both, pin and external level, for every input.
set -euo pipefail
command -v avr-gcc >/dev/null && command -v gcc >/dev/null && [ -d /usr/lib/avr/include ] && [ -d /usr/include/simavr ] ||
  { apt-get update -qq && apt-get install -y -qq gcc libc6-dev gcc-avr avr-libc libsimavr-dev libelf-dev; }
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
cat >firmware.c <<'C'
#include <avr/io.h>

int main(void) {
  DDRD = 0xff;         // what is read is shown on port D
  DDRB = 1 << 3;       // B3 is an output
  PORTB = 1 << 0;      // B0 is an input with its pull-up on
  while (PINB & 1) {}  // until the switch closes
  PORTD = 0x10 | (PINB & 1);
  PORTB |= 1 << 3;
  PORTD = 0x20 | (PINB & 1);
  for (;;) {}
}
C
cat >world.c <<'C'
#include <simavr/avr_ioport.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdio.h>
#include <stdlib.h>

static int shown[2], count;

static void show(struct avr_irq_t *irq, uint32_t value, void *param) {
  if (count < 2) shown[count++] = value & 1;
}

int main(int argc, char **argv) {
  elf_firmware_t firmware = {0};
  if (elf_read_firmware("firmware.elf", &firmware)) return 2;
  avr_t *avr = avr_make_mcu_by_name("atmega2560");
  avr_init(avr);
  avr_load_firmware(avr, &firmware);
  avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('D'), IOPORT_IRQ_REG_PORT), show, NULL);
  for (int i = 0; i < 1000; i++) avr_run(avr);
  if (atoi(argv[1])) {
    avr_ioport_external_t ground = {.name = 'B', .mask = 1, .value = 0};
    avr_ioctl(avr, AVR_IOCTL_IOPORT_SET_EXTERNAL('B'), &ground);
  }
  avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ('B'), IOPORT_IRQ_PIN0), 0);
  for (int i = 0; i < 1000; i++) avr_run(avr);
  if (count == 2) printf("%d then %d\n", shown[0], shown[1]);
  return 0;
}
C
avr-gcc -mmcu=atmega2560 -Os firmware.c -o firmware.elf
gcc world.c -o world -lsimavr -lelf
pin=$(./world 0 | tail -n 1) both=$(./world 1 | tail -n 1)
echo "closed switch, before and after another pin is written: by the pin alone $pin, external level set too $both"
[ "$pin/$both" = "0 then 1/0 then 0" ] || { echo changed; exit 1; }

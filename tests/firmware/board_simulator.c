// Runs a firmware's ELF file on simavr's ATmega328P and tells what its motor pins and its serial
// line do. All times are simulated microseconds since the start.
//
//   board_simulator FIRMWARE.elf         does what the lines of standard input say, as fast as it
//                                        can: the same input gives the same output
//   board_simulator FIRMWARE.elf --pty   keeps real time, its serial line on a pseudo-terminal whose
//                                        name is the first line it prints; ends with its input
//
// Input, in the order of time:  TIME rx HEX       bytes on the line, one after the other
//                               TIME broken HEX   the same, each with a framing error
//                               TIME hang         the program falls into an endless loop
//                               TIME reset        the reset pin
//                               TIME end
// Output:  TIME pins OCR0A OCR0B TCCR0A PORTD DDRD   when one has changed
//          TIME tx HEX                               a byte from the board
//          TIME rx HEX                               a byte handed to the board; only with --pty

#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>

#define CYCLES_PER_US 16
#define WATCH_CYCLES 160  // pins are looked at every 10 us
#define BYTE_CYCLES 1504  // 94 us: simavr counts eleven bits a byte, a real line ten (87 us)
#define SLICE_CYCLES 8000 // real time is kept in steps of 0.5 ms

enum { OCR0A_AT = 0x47, OCR0B_AT = 0x48, TCCR0A_AT = 0x44, PORTD_AT = 0x2b, DDRD_AT = 0x2a };

static avr_t *avr;
static avr_irq_t *line_in;
static uint32_t hang_at; // an endless loop that avr-libc puts into every program
static int line = -1;    // the pseudo-terminal's board side

static void fail(const char *what) {
    fprintf(stderr, "board_simulator: %s\n", what);
    exit(1);
}

static unsigned long long now_us(void) {
    return avr->cycle / CYCLES_PER_US;
}

static void be_silent(avr_t *from, const int level, const char *format, va_list values) {
    (void)from, (void)level, (void)format, (void)values;
}

static void on_tx(avr_irq_t *irq, uint32_t value, void *unused) {
    (void)irq, (void)unused;
    uint8_t byte = value;
    printf("%llu tx %02x\n", now_us(), byte);
    if (line >= 0 && write(line, &byte, 1) < 0 && errno != EAGAIN) {
        fail("cannot write to the pseudo-terminal");
    }
}

// A state counts when it has lasted for two looks: the program sets one register after the other.
static void look_at_pins(void) {
    static int told[5] = {-1}, seen[5];
    static avr_cycle_count_t since;
    const uint8_t *at = avr->data;
    int pins[] = {at[OCR0A_AT], at[OCR0B_AT], at[TCCR0A_AT], at[PORTD_AT], at[DDRD_AT]};
    if (memcmp(seen, pins, sizeof pins)) {
        memcpy(seen, pins, sizeof pins);
        since = avr->cycle;
    } else if (avr->cycle >= since + WATCH_CYCLES && memcmp(told, pins, sizeof pins)) {
        memcpy(told, pins, sizeof pins);
        printf("%llu pins %d %d %d %d %d\n", (unsigned long long)since / CYCLES_PER_US, pins[0],
               pins[1], pins[2], pins[3], pins[4]);
    }
}

static void run_until(avr_cycle_count_t cycle) {
    while (avr->cycle < cycle) {
        if (avr->run_cycle_count > WATCH_CYCLES) { // how far simavr would go in one step
            avr->run_cycle_count = WATCH_CYCLES;
        }
        int state = avr_run(avr);
        if (state == cpu_Done || state == cpu_Crashed) {
            fail("the firmware has crashed");
        }
        look_at_pins();
    }
}

static void load(const char *path) {
    elf_firmware_t firmware = {0};
    avr_global_logger_set(be_silent);
    if (elf_read_firmware(path, &firmware)) {
        fail("cannot read the firmware");
    }
    for (uint32_t i = 0; i < firmware.symbolcount; i++) {
        if (!strcmp(firmware.symbol[i]->symbol, "_exit")) {
            hang_at = firmware.symbol[i]->addr;
        }
    }
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr || avr_init(avr)) {
        fail("simavr has no ATmega328P");
    }
    avr_load_firmware(avr, &firmware);
    avr->frequency = CYCLES_PER_US * 1000000;
    uint32_t flags = 0; // neither sleep nor print on its own
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    line_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_tx,
                            NULL);
}

static void run_script(void) {
    static char text[1 << 16], verb[16], hex[1 << 16];
    unsigned long long us;
    while (fgets(text, sizeof text, stdin)) {
        *hex = 0;
        if (sscanf(text, "%llu %15s %65535s", &us, verb, hex) < 2) {
            fail("a line of the input cannot be read");
        }
        avr_cycle_count_t at = us * CYCLES_PER_US;
        run_until(at);
        if (!strcmp(verb, "end")) {
            return;
        } else if (!strcmp(verb, "hang")) {
            avr->pc = hang_at;
            avr->sreg[S_I] = 0;
        } else if (!strcmp(verb, "reset")) {
            avr_reset(avr);
        } else {
            unsigned byte, error = strcmp(verb, "rx") ? UART_INPUT_FE : 0;
            for (const char *digits = hex; sscanf(digits, "%2x", &byte) == 1; digits += 2) {
                run_until(at);
                avr_raise_irq(line_in, byte | error);
                at += BYTE_CYCLES;
            }
        }
    }
}

static int open_terminal(void) {
    struct termios raw;
    line = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (line < 0 || grantpt(line) || unlockpt(line)) {
        fail("no pseudo-terminal");
    }
    int other = open(ptsname(line), O_RDWR | O_NOCTTY); // kept open, so that hosts may come and go
    if (other < 0 || tcgetattr(other, &raw)) {
        fail("cannot open the pseudo-terminal");
    }
    cfmakeraw(&raw);
    tcsetattr(other, TCSANOW, &raw);
    return other;
}

// Simulated time never runs faster than real time: when this process was held up it falls behind
// and stays there, or the firmware would see a silence that never was.
static void run_live(void) {
    uint8_t waiting[64];
    size_t taken = 0, got = 0;
    struct timespec due;
    clock_gettime(CLOCK_MONOTONIC, &due);
    setvbuf(stdout, NULL, _IOLBF, 0);
    open_terminal();
    printf("%s\n", ptsname(line));
    for (avr_cycle_count_t next_byte = 0;;) {
        avr_cycle_count_t end = avr->cycle + SLICE_CYCLES;
        while (avr->cycle < end) {
            if (taken == got) {
                ssize_t size = read(line, waiting, sizeof waiting);
                taken = 0;
                got = size > 0 ? (size_t)size : 0;
            }
            if (taken < got && avr->cycle >= next_byte) {
                next_byte = avr->cycle + BYTE_CYCLES;
                printf("%llu rx %02x\n", now_us(), waiting[taken]);
                avr_raise_irq(line_in, waiting[taken++]);
            }
            run_until(taken < got && next_byte < end ? next_byte : end);
        }
        struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
        if (poll(&input, 1, 0) > 0) {
            return;
        }
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        due.tv_nsec += SLICE_CYCLES * 1000L / CYCLES_PER_US;
        due.tv_sec += due.tv_nsec / 1000000000L;
        due.tv_nsec %= 1000000000L;
        if (now.tv_sec > due.tv_sec || (now.tv_sec == due.tv_sec && now.tv_nsec > due.tv_nsec)) {
            due = now;
        } else {
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
        }
    }
}

int main(int count, char **words) {
    if (count < 2 || count > 3 || (count == 3 && strcmp(words[2], "--pty"))) {
        fail("usage: board_simulator FIRMWARE.elf [--pty]");
    }
    load(words[1]);
    if (count == 3) {
        run_live();
    } else {
        run_script();
    }
    return 0;
}

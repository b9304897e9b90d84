// An mCore board: runs a firmware, an ELF or Intel HEX file (.hex), on simavr's ATmega328P and tells
// what its motor pins and its serial line do. All times are simulated microseconds since the start.
//
//   board_simulator FIRMWARE            does what the lines of standard input say, as fast as it
//                                       can: the same input gives the same output
//   board_simulator FIRMWARE --pty MS   keeps real time, its serial line on a pseudo-terminal whose
//                                       name is the first line it prints; ends with its input. With
//                                       MS above 0, opening the terminal resets the board, as DTR
//                                       does, and it is deaf so long, as in its boot loader
//
// Input, in the order of time:  TIME rx HEX       bytes on the line, one after the other
//                               TIME broken HEX   the same, each with a framing error
//                               TIME hang         the program falls into an endless loop
//                               TIME reset        the reset pin
//                               TIME high B1      something outside raises a pin, or lowers it (low)
//                               TIME echo MM      the ultrasonic sensor, whichever port calls it,
//                                                 answers as from a wall so far away; 0: no echo
//                               TIME supply MV    what the board runs on
//                               TIME sync         TIME sync is printed, and nothing is held back
//                               TIME end
//          With --pty the times are not looked at, and there are only pins, echo and supply.
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
#include <strings.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_hex.h>

#define CYCLES_PER_US 16
#define WATCH_CYCLES 160  // pins are looked at every 10 us
#define BYTE_CYCLES 1504  // 94 us: simavr counts eleven bits a byte, a real line ten (87 us)
#define SLICE_CYCLES 8000 // real time is kept in steps of 0.5 ms
#define SLICE_NS (SLICE_CYCLES * 1000L / CYCLES_PER_US)
#define CATCH_UP_NS 5000000L // a scheduler's hiccup; far below a torn frame's 20 ms
#define HIGH_MV 5000

enum { OCR0A_AT = 0x47, OCR0B_AT = 0x48, TCCR0A_AT = 0x44, PORTD_AT = 0x2b, DDRD_AT = 0x2a };
enum { PINB_AT = 0x23, PINC_AT = 0x26 }; // DDR and PORT follow
enum { PIN_D2 = 2 };
#define ECHO_BEGINS_US 450 // after the call
#define ECHO_US_A_MM 5.8

static avr_t *avr;
static avr_irq_t *line_in;
static uint32_t hang_at; // an endless loop that avr-libc puts into every program
static int line = -1;    // the pseudo-terminal's board side
static unsigned long echo_mm;

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
    if (line >= 0 && write(line, &byte, 1) < 0 && errno != EAGAIN && errno != EIO) {
        fail("cannot write to the pseudo-terminal");
    }
}

// A state counts when it has lasted for two looks: the program sets one register after the other.
static void look_at_pins(avr_cycle_count_t lasting) {
    static int told[5] = {-1}, seen[5];
    static avr_cycle_count_t since;
    const uint8_t *at = avr->data;
    int pins[] = {at[OCR0A_AT], at[OCR0B_AT], at[TCCR0A_AT], at[PORTD_AT], at[DDRD_AT]};
    if (memcmp(seen, pins, sizeof pins)) {
        memcpy(seen, pins, sizeof pins);
        since = avr->cycle;
    }
    if (avr->cycle >= since + lasting && memcmp(told, pins, sizeof pins)) {
        memcpy(told, pins, sizeof pins);
        printf("%llu pins %d %d %d %d %d\n", (unsigned long long)since / CYCLES_PER_US, pins[0],
               pins[1], pins[2], pins[3], pins[4]);
    }
}

static void set_pin(char port, int bit, int level) {
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_IOPORT_GETIRQ(port), bit), level);
}

// The sensor sits at the second signal of one of four ports. It has been called when the pin that the
// firmware held high goes low.
static void look_at_sonar(void) {
    static const struct {
        char port;
        int at, bit;
    } PINS[] = {{'B', PINB_AT, 4}, {'B', PINB_AT, 2}, {'C', PINC_AT, 3}, {'C', PINC_AT, 1}};
    static bool called[4];
    static avr_cycle_count_t rises, falls;
    static int answering = -1;
    for (int i = 0; i < 4; i++) {
        const uint8_t *at = avr->data + PINS[i].at;
        bool calls = at[1] & at[2] & 1 << PINS[i].bit;
        if (called[i] && !calls && echo_mm) {
            answering = i;
            rises = avr->cycle + ECHO_BEGINS_US * CYCLES_PER_US;
            falls = rises + (avr_cycle_count_t)(echo_mm * ECHO_US_A_MM * CYCLES_PER_US);
        }
        called[i] = calls;
    }
    if (answering >= 0 && rises && avr->cycle >= rises) {
        set_pin(PINS[answering].port, PINS[answering].bit, 1);
        rises = 0;
    } else if (answering >= 0 && !rises && avr->cycle >= falls) {
        set_pin(PINS[answering].port, PINS[answering].bit, 0);
        answering = -1;
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
        look_at_pins(WATCH_CYCLES);
        look_at_sonar();
    }
}

static void load_elf(const char *path) {
    elf_firmware_t firmware = {0};
    if (elf_read_firmware(path, &firmware) || !firmware.flashsize) {
        fail("cannot read the firmware");
    }
    for (uint32_t i = 0; i < firmware.symbolcount; i++) {
        if (!strcmp(firmware.symbol[i]->symbol, "_exit")) {
            hang_at = firmware.symbol[i]->addr;
        }
    }
    avr_load_firmware(avr, &firmware);
}

// In pieces: an image with its boot loader has a gap.
static void load_hex(const char *path) {
    ihex_chunk_p chunks = NULL;
    int count = read_ihex_chunks(path, &chunks);
    if (count <= 0) {
        fail("cannot read the firmware");
    }
    for (int i = 0; i < count; i++) {
        if (chunks[i].baseaddr + chunks[i].size > avr->flashend + 1) {
            fail("the firmware is larger than the board's memory");
        }
        avr_loadcode(avr, chunks[i].data, chunks[i].size, chunks[i].baseaddr);
    }
    free_ihex_chunks(chunks);
}

// Stock firmware looks at its button (A7), which is not pressed, and at its infrared receiver (D2),
// which hears nothing; at port 2 the line follower sees a floor. A reset makes simavr forget its pins,
// but not that it has been told already.
static void reset(void) {
    avr_reset(avr);
    set_pin('D', PIN_D2, 0);
    set_pin('D', PIN_D2, 1);
    for (int bit = 1; bit <= 2; bit++) {
        set_pin('B', bit, 0);
        set_pin('B', bit, 1);
    }
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC7), HIGH_MV);
}

static void load(const char *path) {
    const char *ending = strrchr(path, '.');
    avr_global_logger_set(be_silent);
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr || avr_init(avr)) {
        fail("simavr has no ATmega328P");
    }
    if (ending && !strcasecmp(ending, ".hex")) {
        load_hex(path);
    } else {
        load_elf(path);
    }
    avr->frequency = CYCLES_PER_US * 1000000;
    avr->vcc = avr->avcc = avr->aref = HIGH_MV;
    uint32_t flags = 0; // neither sleep nor print on its own
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    line_in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_tx,
                            NULL);
    reset();
}

// What the world does to the board; false: it is not that.
static bool outside(const char *verb, const char *value) {
    if (!strcmp(verb, "high") || !strcmp(verb, "low")) {
        if ((*value != 'B' && *value != 'C') || value[1] < '0' || value[1] > '7') {
            fail("a pin is not known");
        }
        set_pin(*value, value[1] - '0', !strcmp(verb, "high"));
    } else if (!strcmp(verb, "echo")) {
        echo_mm = strtoul(value, NULL, 10);
    } else if (!strcmp(verb, "supply")) {
        avr->vcc = avr->avcc = avr->aref = (uint32_t)strtoul(value, NULL, 10);
    } else {
        return false;
    }
    return true;
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
            if (!hang_at) {
                fail("this firmware has no endless loop to hang in; give its ELF file");
            }
            avr->pc = hang_at;
            avr->sreg[S_I] = 0;
        } else if (!strcmp(verb, "reset")) {
            reset();
        } else if (!strcmp(verb, "sync")) {
            look_at_pins(0);
            printf("%llu sync\n", us);
            fflush(stdout);
        } else if (!outside(verb, hex)) {
            unsigned byte, error = strcmp(verb, "rx") ? UART_INPUT_FE : 0;
            for (const char *digits = hex; sscanf(digits, "%2x", &byte) == 1; digits += 2) {
                run_until(at);
                avr_raise_irq(line_in, byte | error);
                at += BYTE_CYCLES;
            }
        }
    }
}

// The board's side of a pseudo-terminal. The hosts' side is kept open here, so that they may come and
// go unnoticed; where their coming matters it is closed, as only then the kernel tells.
static void open_terminal(bool openings_matter) {
    struct termios raw;
    line = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (line < 0 || grantpt(line) || unlockpt(line)) {
        fail("no pseudo-terminal");
    }
    int other = open(ptsname(line), O_RDWR | O_NOCTTY);
    if (other < 0 || tcgetattr(other, &raw)) {
        fail("cannot open the pseudo-terminal");
    }
    cfmakeraw(&raw);
    tcsetattr(other, TCSANOW, &raw);
    if (openings_matter) {
        close(other);
    }
}

static bool happens(int descriptor, short event) {
    struct pollfd watched = {.fd = descriptor, .events = event};
    return poll(&watched, 1, 0) > 0 && watched.revents & event;
}

// Take in what has come on the input; whether that has ended.
static bool is_over(void) {
    static char text[256];
    static size_t size;
    while (happens(STDIN_FILENO, POLLIN | POLLHUP)) {
        ssize_t got = read(STDIN_FILENO, text + size, sizeof text - 1 - size);
        if (got <= 0) {
            return true;
        }
        size += (size_t)got;
        text[size] = 0;
        for (char *end; (end = strchr(text, '\n')); size = strlen(text)) {
            char verb[16], value[16] = "";
            if (sscanf(text, "%*u %15s %15s", verb, value) < 1 || !outside(verb, value)) {
                fail("a line of the input cannot be read");
            }
            memmove(text, end + 1, strlen(end + 1) + 1);
        }
    }
    return false;
}

// Sleep until the next step is due. After a hold-up of more than CATCH_UP_NS simulated time falls
// behind and stays there, or the firmware would see a silence that never was.
static void keep_pace(struct timespec *due) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    due->tv_nsec += SLICE_NS;
    due->tv_sec += due->tv_nsec / 1000000000L;
    due->tv_nsec %= 1000000000L;
    long late_ns = now.tv_sec - due->tv_sec > 1
                       ? 1000000000L
                       : (now.tv_sec - due->tv_sec) * 1000000000L + now.tv_nsec - due->tv_nsec;
    if (late_ns > CATCH_UP_NS) {
        *due = now;
    } else if (late_ns < 0) {
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, due, NULL);
    }
}

// Motors off at once, as all pins are inputs then; what the host sends is lost.
static void boot(int boot_ms, struct timespec *due) {
    uint8_t lost[256];
    reset();
    look_at_pins(0);
    for (long steps = boot_ms * 1000000L / SLICE_NS; steps && !is_over(); steps--) {
        keep_pace(due);
    }
    while (read(line, lost, sizeof lost) > 0) {
    }
}

static void run_slice(void) {
    static uint8_t waiting[64];
    static size_t taken, got;
    static avr_cycle_count_t next_byte;
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
}

static void run_live(int boot_ms) {
    struct timespec due;
    bool open = true;
    setvbuf(stdout, NULL, _IOLBF, 0);
    open_terminal(boot_ms > 0);
    printf("%s\n", ptsname(line));
    clock_gettime(CLOCK_MONOTONIC, &due);
    while (!is_over()) {
        bool was_open = open;
        open = !happens(line, POLLHUP);
        if (open && !was_open && boot_ms > 0) {
            boot(boot_ms, &due);
        }
        run_slice();
        keep_pace(&due);
    }
}

int main(int count, char **words) {
    bool live = count == 4 && !strcmp(words[2], "--pty");
    if (count != 2 && !live) {
        fail("usage: board_simulator FIRMWARE [--pty BOOT_MS]");
    }
    load(words[1]);
    if (live) {
        run_live(atoi(words[3]));
    } else {
        run_script();
    }
    return 0;
}

// mbot-deadman: firmware for the mCore board (ATmega328P, 16 MHz) that stops by itself.
//
// It obeys the board's stock frames for driving (docs/mcore-protocol.md) and adds what the stock
// firmware lacks: a command holds for 300 ms at most, a frame that was torn is not obeyed, and a
// program that hangs is reset. Whatever happens, the motors end up off:
//
//   reset of any cause   all pins become inputs; the first instructions here keep the motors off,
//                        and drive commands are refused until ARM has come ("latched")
//   silence              motors off after COMMAND_TIMEOUT_MS, latched
//   a hung program       the watchdog resets the board after 250 ms
//
// A refused command is not acknowledged, so the host learns of it as of any lost command. STOP does
// not unlatch: the host says it all the time, also when nobody wants to drive. Speeds are the board's own, -255..255, used as they come: the daemon maps
// the policy's 501 steps onto them (mbot_protocol.drive.actions).
//
// Everything runs in the loop of main, which never waits; two interrupts move bytes. Time is
// Timer 1, free running in hardware, so that no lost interrupt can lengthen the time-out.

#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/wdt.h>

#ifndef COMMAND_TIMEOUT_MS
#define COMMAND_TIMEOUT_MS 300 // the daemon repeats commands every 100 ms
#endif

#define TEXT_OF(number) #number
#define TEXT(number) TEXT_OF(number)
// The daemon trusts names that begin with mbot-deadman, and from 2 on it sends ARM.
#define NAME "mbot-deadman 2 " TEXT(COMMAND_TIMEOUT_MS) "ms"
#define LINE_END "\r\n"

#define TICKS_OF_US(us) ((uint16_t)((us) / 16UL)) // Timer 1: 16 MHz / 256
#define COMMAND_TIMEOUT TICKS_OF_US(COMMAND_TIMEOUT_MS * 1000UL)
#define TORN_FRAME_GAP TICKS_OF_US(20000UL) // one frame is sent without such a pause in it
#define QUIET TICKS_OF_US(256UL)            // three bytes' time: nothing follows without a pause
_Static_assert(COMMAND_TIMEOUT_MS >= 20 && COMMAND_TIMEOUT_MS <= 1000, "Timer 1 wraps at 1.05 s");

// ---- motors: DIR and PWM pins, all on port D; M1 hangs on OC0A, M2 on OC0B ----

enum { M1_DIR = PD7, M1_PWM = PD6, M2_DIR = PD4, M2_PWM = PD5 };
#define MOTOR_PINS (_BV(M1_DIR) | _BV(M1_PWM) | _BV(M2_DIR) | _BV(M2_PWM))

static bool moving; // a motor is on

// The flags of MCUSR at the last reset: 1 power, 2 reset pin, 4 brown-out, 8 watchdog. A boot loader
// may have cleared them: 0.
static uint8_t reset_cause __attribute__((section(".noinit")));

// Before the C runtime has set up anything, whatever the reset's cause. A watchdog reset leaves the
// watchdog running at its shortest, so it is set again at once.
__attribute__((naked, used, section(".init3"))) static void motors_off_first(void) {
    TCCR0A = 0;
    PORTD = 0;
    DDRD = MOTOR_PINS;
    reset_cause = MCUSR;
    MCUSR = 0;
    wdt_enable(WDTO_250MS);
}

// The duty is (|speed| + 1) / 256. The timer can't make 0, so the pin is taken from it instead;
// that also takes effect at once and not only at the end of the period.
static void set_motors(int16_t m1, int16_t m2) {
    PORTD = (m1 >= 0 ? _BV(M1_DIR) : 0) | (m2 >= 0 ? _BV(M2_DIR) : 0);
    OCR0A = (uint8_t)(m1 < 0 ? -m1 : m1);
    OCR0B = (uint8_t)(m2 < 0 ? -m2 : m2);
    TCCR0A = (m1 ? _BV(COM0A1) : 0) | (m2 ? _BV(COM0B1) : 0) | _BV(WGM01) | _BV(WGM00);
    moving = m1 || m2;
}

// ---- serial line: two ring buffers, one byte of each always free ----

#define RING_BYTES 64 // a power of two; longer than the longest burst, 62 bytes

static volatile uint8_t rx_ring[RING_BYTES], rx_head, rx_tail;
static volatile uint8_t tx_ring[RING_BYTES], tx_head, tx_tail;
static volatile bool line_broken; // a byte was lost or garbled: believe nothing that is in the ring

static uint8_t after(uint8_t index) {
    return (index + 1) % RING_BYTES;
}

ISR(USART_RX_vect) {
    bool garbled = UCSR0A & (_BV(FE0) | _BV(DOR0)); // must be read before the byte
    uint8_t byte = UDR0;
    uint8_t head = rx_head;
    if (garbled || after(head) == rx_tail) {
        line_broken = true;
    } else {
        rx_ring[head] = byte;
        rx_head = after(head);
    }
}

ISR(USART_UDRE_vect) {
    uint8_t tail = tx_tail;
    if (tail == tx_head) {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    } else {
        UDR0 = tx_ring[tail];
        tx_tail = after(tail);
    }
}

// All of it or, when the host asks faster than the line can answer, nothing: never wait.
static void send(const void *data, uint8_t size) {
    const uint8_t *byte = data;
    if ((uint8_t)(tx_tail - tx_head - 1) % RING_BYTES < size) {
        return;
    }
    while (size--) {
        tx_ring[tx_head] = *byte++;
        tx_head = after(tx_head);
    }
    cli(); // the interrupt changes the same register
    UCSR0B |= _BV(UDRIE0);
    sei();
}

// ---- frames: ff 55 length index action device data... ----

enum { GET = 1, RUN = 2, RESET = 4 };
enum { VERSION = 0, JOYSTICK = 5, MOTOR = 10 };
enum { RESET_CAUSE = 0x70, ARM = 0x71 }; // ours; the stock firmware knows no such devices
enum { PORT_M1 = 9, PORT_M2 = 10 };

// The frames there are. Anything else is dropped at the first byte that fits none of them.
static const struct {
    uint8_t length, action, device;
} KINDS[] = {
    {2, RESET, 0}, // has no device
    {3, GET, VERSION},
    {3, GET, RESET_CAUSE},
    {3, RUN, ARM},
    {6, RUN, MOTOR},
    {7, RUN, JOYSTICK},
};

static uint8_t frame[11]; // the longest frame and the byte that follows it
static uint8_t size;      // bytes in it
static bool latched = true;
static uint16_t driven_at; // Timer 1, when the last drive command was obeyed

static bool is_complete(void) {
    return size >= 3 && size == 3 + frame[2];
}

// Could the bytes so far be the beginning of a frame, or all of it?
static bool is_plausible(void) {
    if (frame[0] != 0xff || (size > 1 && frame[1] != 0x55)) {
        return false;
    }
    if (size > 2 && size > 3 + frame[2]) {
        return false;
    }
    for (uint8_t kind = 0; kind < sizeof KINDS / sizeof *KINDS; kind++) {
        if ((size < 3 || frame[2] == KINDS[kind].length) &&
            (size < 5 || frame[4] == KINDS[kind].action) &&
            (size < 6 || frame[5] == KINDS[kind].device) &&
            (size < 7 || frame[5] != MOTOR || frame[6] == PORT_M1 || frame[6] == PORT_M2)) {
            return true;
        }
    }
    return false;
}

static int16_t speed_at(uint8_t index) {
    int16_t speed = (int16_t)(frame[index] | (uint16_t)frame[index + 1] << 8);
    return speed > 255 ? 255 : speed < -255 ? -255 : speed;
}

static bool is_drive(void) {
    return frame[4] == RUN &&
           (frame[5] == MOTOR || (frame[5] == JOYSTICK && (speed_at(6) || speed_at(8))));
}

static void acknowledge(void) {
    send("\xff\x55" LINE_END, 4);
}

static void tell_version(void) {
    uint8_t head[] = {0xff, 0x55, frame[3], 4 /* a string */, sizeof NAME - 1};
    uint8_t reply[sizeof head + sizeof NAME LINE_END - 1];
    memcpy(reply, head, sizeof head);
    memcpy(reply + sizeof head, NAME LINE_END, sizeof NAME LINE_END - 1);
    send(reply, sizeof reply);
}

static void tell_reset_cause(void) {
    uint8_t reply[] = {0xff, 0x55, frame[3], 1 /* a byte */, reset_cause, '\r', '\n'};
    send(reply, sizeof reply);
}

static void drive(void) {
    static int16_t m1, m2; // what a command for the other motor leaves as it is
    if (!moving) {
        m1 = m2 = 0; // it may have stopped without us
    }
    if (frame[5] == JOYSTICK) {
        m1 = speed_at(6);
        m2 = speed_at(8);
    } else if (frame[6] == PORT_M1) {
        m1 = speed_at(7);
    } else {
        m2 = speed_at(7);
    }
    set_motors(m1, m2);
    driven_at = TCNT1;
}

// Do what the complete frame says and forget it.
static void obey(void) {
    size = 0;
    if (frame[4] == GET) {
        if (frame[5] == VERSION) {
            tell_version();
        } else {
            tell_reset_cause();
        }
        return;
    }
    if (!is_drive()) {
        set_motors(0, 0);
        latched = latched && !(frame[4] == RUN && frame[5] == ARM);
    } else if (latched) {
        return; // the missing acknowledgement says so
    } else {
        drive();
    }
    acknowledge();
}

// Take the next byte. A drive command is not obeyed before silence or the start of another frame
// has shown that it ended where it should: a frame with a byte missing is completed by what comes
// next, and would set speeds nobody asked for. Its bytes are then searched for a frame once more,
// so that the STOP that completed it is not lost.
static void receive(uint8_t byte) {
    if (is_complete() && byte == 0xff) {
        obey();
    }
    frame[size++] = byte;
    while (size && !is_plausible()) {
        memmove(frame, frame + 1, --size);
    }
    if (is_complete() && !is_drive()) {
        obey();
    }
}

// The next byte from the line, if there is one.
static bool take(uint8_t *byte) {
    bool any = rx_tail != rx_head;
    if (any) {
        *byte = rx_ring[rx_tail];
        rx_tail = after(rx_tail);
    }
    return any;
}

static void forget_line(void) {
    cli();
    rx_tail = rx_head;
    line_broken = false;
    sei();
    size = 0;
}

int main(void) {
    TCCR0B = _BV(CS01) | _BV(CS00); // PWM at 16 MHz / 64 / 256 = 977 Hz
    TCCR1B = _BV(CS12);             // 16 us a tick
    UCSR0A = _BV(U2X0);             // 16 MHz / 8 / (16 + 1) = 117,647 baud: 2.1 % too fast,
    UBRR0 = 16;                     // the nearest to 115,200 that 16 MHz gives
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    set_motors(0, 0);
    sei();
    send("Version: " NAME LINE_END, sizeof "Version: " NAME LINE_END - 1);

    uint16_t received_at = 0;
    for (;;) {
        wdt_reset();
        uint8_t byte;
        if (line_broken) {
            forget_line();
        } else if (take(&byte)) {
            received_at = TCNT1;
            receive(byte);
        } else if (size) {
            uint16_t silence = TCNT1 - received_at;
            if (is_complete() && silence >= QUIET) {
                obey();
            } else if (silence >= TORN_FRAME_GAP) {
                size = 0;
            }
        }
        if (moving && (uint16_t)(TCNT1 - driven_at) >= COMMAND_TIMEOUT) {
            set_motors(0, 0);
            latched = true;
        }
    }
}

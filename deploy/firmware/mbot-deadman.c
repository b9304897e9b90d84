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
//   no floor in front    where the host has asked for it: no wheel turns forward
//   something in front   the same: the robot turns and backs, and does not go forward
//
// A refused command is not acknowledged, so the host learns of it as of any lost command. STOP does
// not unlatch: the host says it all the time, also when nobody wants to drive. Speeds are the
// board's own, -255..255, used as they come: the daemon maps the policy's 501 steps onto them
// (mbot_protocol.drive.actions).
//
// Everything runs in the loop of main, which never waits, not for an echo either; two interrupts
// move bytes. Time is Timer 1, free running in hardware, so that no lost interrupt can lengthen the
// time-out.

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
// The daemon trusts names that begin with mbot-deadman; from 2 on it sends ARM, from 3 on SENSES.
#define NAME "mbot-deadman 3 " TEXT(COMMAND_TIMEOUT_MS) "ms"
#define LINE_END "\r\n"

#define TICKS_OF_US(us) ((uint16_t)((us) / 16UL)) // Timer 1: 16 MHz / 256
#define COMMAND_TIMEOUT TICKS_OF_US(COMMAND_TIMEOUT_MS * 1000UL)
#define TORN_FRAME_GAP TICKS_OF_US(20000UL) // one frame is sent without such a pause in it
#define QUIET TICKS_OF_US(256UL)            // three bytes' time: nothing follows without a pause
_Static_assert(COMMAND_TIMEOUT_MS >= 20 && COMMAND_TIMEOUT_MS <= 1000, "Timer 1 wraps at 1.05 s");

// ---- motors: DIR and PWM pins, all on port D; M1 hangs on OC0A, M2 on OC0B ----

enum { M1_DIR = PD7, M1_PWM = PD6, M2_DIR = PD4, M2_PWM = PD5 };
#define MOTOR_PINS (_BV(M1_DIR) | _BV(M1_PWM) | _BV(M2_DIR) | _BV(M2_PWM))

static int16_t wanted_m1, wanted_m2; // by the command in force; a reflex may let through less
static bool turning;                 // a motor is on
static bool edge, near;              // reflexes: no floor, or something, in front of the robot
static uint8_t m1_ahead = 1;         // whether M1 drives the robot forward by negative speeds,
static uint8_t m2_ahead = 0;         // and M2; as the kit is built

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
static void turn_motors(int16_t m1, int16_t m2) {
    PORTD = (m1 >= 0 ? _BV(M1_DIR) : 0) | (m2 >= 0 ? _BV(M2_DIR) : 0);
    OCR0A = (uint8_t)(m1 < 0 ? -m1 : m1);
    OCR0B = (uint8_t)(m2 < 0 ? -m2 : m2);
    TCCR0A = (m1 ? _BV(COM0A1) : 0) | (m2 ? _BV(COM0B1) : 0) | _BV(WGM01) | _BV(WGM00);
    turning = m1 || m2;
}

// What is wanted, less what a reflex forbids. At an edge no wheel turns forward: in a turn on the
// spot the outer one would swing over it, since the wheels stand as far apart as the edge is away.
// In front of a thing the robot may turn on the spot.
static void move(void) {
    int16_t left = m1_ahead ? -wanted_m1 : wanted_m1, right = m2_ahead ? -wanted_m2 : wanted_m2;
    int16_t ahead = (left + right) / 2;
    if (near && ahead > 0) {
        left -= ahead;
        right -= ahead;
    }
    if (edge) {
        left = left > 0 ? 0 : left;
        right = right > 0 ? 0 : right;
    }
    turn_motors(m1_ahead ? -left : left, m2_ahead ? -right : right);
}

static bool is_driven(void) {
    return wanted_m1 || wanted_m2;
}

static void set_motors(int16_t m1, int16_t m2) {
    wanted_m1 = m1;
    wanted_m2 = m2;
    move();
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
enum { RESET_CAUSE = 0x70, ARM = 0x71, SENSES = 0x72 }; // ours; the stock firmware has none such
enum { PORT_M1 = 9, PORT_M2 = 10 };

// The frames there are. Anything else is dropped at the first byte that fits none of them.
static const struct {
    uint8_t length, action, device;
} KINDS[] = {
    {2, RESET, 0}, // has no device
    {3, GET, VERSION},
    {3, GET, RESET_CAUSE},
    {3, GET, SENSES},
    {3, RUN, ARM},
    {7, RUN, SENSES},
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
    if (frame[5] == JOYSTICK) {
        set_motors(speed_at(6), speed_at(8));
    } else if (frame[6] == PORT_M1) {
        set_motors(speed_at(7), wanted_m2);
    } else {
        set_motors(wanted_m1, speed_at(7));
    }
    driven_at = TCNT1;
}

// ---- senses: what the kit's two infrared pairs and its ultrasonic sensor tell, where asked for ----

#define FLOOR_EVERY TICKS_OF_US(4000UL)
#define FLOOR_LOOKS 2  // in a row say that there is none: 4 to 8 ms
#define FLOOR_BACK 150 // in a row, while a wheel turns, say that the robot has backed off: 0.6 s
#define PING_EVERY TICKS_OF_US(60000UL)
#define PULSE 2            // ticks; more than 16 us of the 10 us that it takes
#define ECHO_WITHIN TICKS_OF_US(30000UL)
#define LONGEST_ECHO TICKS_OF_US(23200UL) // 4 m there and back
#define TELL_EVERY TICKS_OF_US(50000UL)
#define NO_ECHO_MM 4000
#define FREE_MM 20         // an obstacle has gone when it is so much farther away than where it counts

enum { EDGE_REFLEX = 1, M1_REVERSED = 2, M2_REVERSED = 4 }; // the first byte of SENSES
enum { FLOOR_1 = 1, FLOOR_2 = 2, AT_EDGE = 4, AT_THING = 8 }; // the third of what is told

// The two signals of an RJ25 port, on port B or C. The ultrasonic sensor has the second.
static const struct {
    volatile uint8_t *input; // DDR and PORT follow it
    uint8_t first, second;
} PORTS[] = {
    {&PINB, _BV(PB3), _BV(PB4)},
    {&PINB, _BV(PB1), _BV(PB2)},
    {&PINC, _BV(PC2), _BV(PC3)},
    {&PINC, _BV(PC0), _BV(PC1)},
};
#define PORT_COUNT (sizeof PORTS / sizeof *PORTS)

static uint8_t reflexes, line_ports, sonar_port; // a bit a port, from port 1; a port's number, or 0
static uint16_t nearest_mm;                      // what is nearer cuts forward; 0: nothing does
static bool telling;
static uint8_t floor_seen = FLOOR_1 | FLOOR_2;
static uint16_t distance_mm = NO_ECHO_MM;
static uint8_t supply; // in 20 mV; 0: not measured yet

static void take_senses(const uint8_t *setting) {
    reflexes = setting[0];
    m1_ahead = !(reflexes & M1_REVERSED);
    m2_ahead = !!(reflexes & M2_REVERSED);
    line_ports = setting[1];
    sonar_port = setting[2] <= PORT_COUNT ? setting[2] : 0;
    nearest_mm = sonar_port ? setting[3] * 10 : 0;
    distance_mm = NO_ECHO_MM;
    floor_seen = FLOOR_1 | FLOOR_2;
    edge = near = false;
    telling = line_ports || sonar_port;
    DDRB = PORTB = DDRC = PORTC = 0;      // inputs, and no echo half waited for
    ADMUX = _BV(REFS0) | 0x0e;            // the 1.1 V reference, measured against the supply
    ADCSRA = _BV(ADEN) | 7;               // 125 kHz
}

static void tell_senses(void) {
    uint8_t told = floor_seen | (edge ? AT_EDGE : 0) | (near ? AT_THING : 0);
    uint8_t reply[] = {0xff, 0x55, SENSES, 6 /* four bytes */, (uint8_t)distance_mm,
                       (uint8_t)(distance_mm >> 8), told, supply, '\r', '\n'};
    send(reply, sizeof reply);
}

// A conversion takes 0.1 ms, so the last one is over.
static void measure_supply(void) {
    uint16_t measured = ADC; // 1024 is the supply
    if (measured) {
        uint16_t volts = 56320U / measured; // 1.1 V * 1024 / 20 mV
        supply = volts > 255 ? 255 : (uint8_t)volts;
    }
    ADCSRA |= _BV(ADSC);
}

static uint8_t floor_now(void) {
    uint8_t seen = FLOOR_1 | FLOOR_2;
    for (uint8_t port = 0; port < PORT_COUNT; port++) {
        if (line_ports & _BV(port)) {
            uint8_t level = *PORTS[port].input;
            seen &= (uint8_t)~(level & PORTS[port].first ? 0 : FLOOR_1);
            seen &= (uint8_t)~(level & PORTS[port].second ? 0 : FLOOR_2);
        }
    }
    return seen;
}

// Every four milliseconds. An edge is over when the robot has driven away from it: by then it has turned
// or backed so far that no wheel swings over it.
static void feel_floor(void) {
    static uint8_t missing;
    static uint16_t there;
    floor_seen = floor_now();
    if (floor_seen == (FLOOR_1 | FLOOR_2)) {
        missing = 0;
        there += edge && turning && there < FLOOR_BACK;
    } else {
        there = 0;
        missing += missing < FLOOR_LOOKS;
    }
    bool is_edge = (reflexes & EDGE_REFLEX) && (missing == FLOOR_LOOKS || (edge && there < FLOOR_BACK));
    if (is_edge != edge) {
        edge = is_edge;
        there = 0;
        move();
    }
}

static void take_echo(uint16_t ticks) {
    static uint8_t free_pings;
    distance_mm = ticks >= LONGEST_ECHO ? NO_ECHO_MM : (uint16_t)(ticks * 80UL / 29); // 5.8 us a mm
    free_pings = distance_mm < nearest_mm + FREE_MM ? 0 : free_pings + (free_pings < 2);
    bool is_near = distance_mm < nearest_mm || (near && free_pings < 2);
    if (is_near != near) {
        near = is_near;
        move();
    }
}

// One wire: a pulse out, then as long a one back as the sound was under way.
static void ping(uint16_t now) {
    static enum { RESTS, CALLS, LISTENS, HEARS } state;
    static uint16_t since;
    volatile uint8_t *input = PORTS[sonar_port - 1].input, *direction = input + 1, *output = input + 2;
    uint8_t pin = PORTS[sonar_port - 1].second;
    bool high = *input & pin;
    uint16_t passed = now - since;
    if (state == RESTS && passed >= PING_EVERY && !high) {
        *output |= pin;
        *direction |= pin;
        state = CALLS;
        since = now;
    } else if (state == CALLS && passed >= PULSE) {
        *output &= (uint8_t)~pin;
        *direction &= (uint8_t)~pin;
        state = LISTENS;
    } else if (state == LISTENS && high) {
        state = HEARS;
        since = now;
    } else if ((state == LISTENS && passed >= ECHO_WITHIN) || (state == HEARS && !high) ||
               (state == HEARS && passed >= LONGEST_ECHO)) {
        take_echo(state == HEARS ? passed : LONGEST_ECHO);
        state = RESTS;
    }
}

static void sense(uint16_t now) {
    static uint16_t felt_at, told_at;
    if (sonar_port) {
        ping(now);
    }
    if (line_ports && (uint16_t)(now - felt_at) >= FLOOR_EVERY) {
        felt_at = now;
        feel_floor();
    }
    if (telling && (uint16_t)(now - told_at) >= TELL_EVERY) {
        told_at = now;
        measure_supply();
        tell_senses();
    }
}

// ---- what is done with a frame ----

// Do what the complete frame says and forget it.
static void obey(void) {
    size = 0;
    if (frame[4] == GET) {
        if (frame[5] == VERSION) {
            tell_version();
        } else if (frame[5] == SENSES) {
            tell_senses();
        } else {
            tell_reset_cause();
        }
        return;
    }
    if (!is_drive()) {
        set_motors(0, 0);
        if (frame[4] == RUN && frame[5] == SENSES) {
            take_senses(frame + 6);
        }
        if (frame[4] == RUN && frame[5] == ARM) {
            latched = false;
            edge = edge && floor_now() != (FLOOR_1 | FLOOR_2); // somebody may have put it back
        }
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
        sense(TCNT1);
        if (is_driven() && (uint16_t)(TCNT1 - driven_at) >= COMMAND_TIMEOUT) {
            set_motors(0, 0);
            latched = true;
        }
    }
}

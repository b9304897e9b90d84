// A firmware that does what is dangerous about the stock one, and what an emulated board must bear
// with: it keeps its last command for ever, makes full speed without the timer, and does nothing
// while its button (A7 low) is pressed or its infrared receiver (D2 low) hears something.

#include <stdbool.h>
#include <stdint.h>

#include <avr/io.h>

#define REPLY_TO_VERSION "\xff\x55\x00\x04\x09" "06.01.107\r\n"

static void send(const char *text, uint8_t size) {
    while (size--) {
        while (!(UCSR0A & _BV(UDRE0))) {
        }
        UDR0 = *text++;
    }
}

static bool is_undisturbed(void) {
    ADCSRA |= _BV(ADSC);
    while (ADCSRA & _BV(ADSC)) {
    }
    return ADC > 512 && PIND & _BV(PD2);
}

static void set(int16_t speed, uint8_t dir, uint8_t pwm, volatile uint8_t *duty, uint8_t connected) {
    uint8_t size = speed < 0 ? -speed : speed;
    PORTD = speed < 0 ? PORTD & ~dir : PORTD | dir;
    if (size == 0 || size == 255) {
        TCCR0A &= ~connected;
        PORTD = size ? PORTD | pwm : PORTD & ~pwm;
    } else {
        *duty = size;
        TCCR0A |= connected;
    }
}

static void obey(const uint8_t *frame) {
    if (frame[4] == 1) {
        send(REPLY_TO_VERSION, sizeof REPLY_TO_VERSION - 1);
        return;
    }
    if (frame[4] == 2 && frame[5] == 5) {
        set(frame[6] | frame[7] << 8, _BV(PD7), _BV(PD6), &OCR0A, _BV(COM0A1));
        set(frame[8] | frame[9] << 8, _BV(PD4), _BV(PD5), &OCR0B, _BV(COM0B1));
    }
    send("\xff\x55\r\n", 4);
}

int main(void) {
    DDRD = _BV(PD7) | _BV(PD6) | _BV(PD5) | _BV(PD4);
    TCCR0A = _BV(WGM01) | _BV(WGM00);
    TCCR0B = _BV(CS01) | _BV(CS00);
    UCSR0A = _BV(U2X0);
    UBRR0 = 16; // 115,200 baud
    UCSR0B = _BV(RXEN0) | _BV(TXEN0);
    ADMUX = _BV(REFS0) | 7;
    ADCSRA = _BV(ADEN) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
    send("Version: 06.01.107\r\n", 20);

    uint8_t frame[52], size = 0;
    for (;;) {
        while (!(UCSR0A & _BV(RXC0))) {
        }
        frame[size++] = UDR0;
        if ((size == 1 && frame[0] != 0xff) || (size == 2 && frame[1] != 0x55)) {
            size = 0;
        } else if ((size > 3 && size == 3 + frame[2]) || size == sizeof frame) {
            size = 0;
            if (is_undisturbed()) {
                obey(frame);
            }
        }
    }
}

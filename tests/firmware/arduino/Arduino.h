// As much of Arduino's interface as deploy/serial-line needs, on an ATmega328P at 16 MHz: a stand-in of
// our own for the IDE's, so that the sketch can be compiled and tried without it. PWM: pins 5 and 6.

#pragma once
#include <avr/interrupt.h>
#include <avr/io.h>
#include <ctype.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { INPUT, OUTPUT };

static volatile uint32_t now_ms;
static volatile uint8_t ring[64], ring_head;
static uint8_t ring_tail;

ISR(TIMER1_COMPA_vect) { now_ms++; }
ISR(USART_RX_vect) { ring[ring_head++ % 64] = UDR0; }

static unsigned long millis() {
    cli();
    uint32_t now = now_ms;
    sei();
    return now;
}

static void put(uint8_t mask, bool high) { PORTD = high ? PORTD | mask : PORTD & ~mask; }
static void pinMode(uint8_t pin, uint8_t mode) { if (mode == OUTPUT) DDRD |= 1 << pin; }
static void digitalWrite(uint8_t pin, bool high) {
    if (pin == 6) TCCR0A &= ~_BV(COM0A1);
    if (pin == 5) TCCR0A &= ~_BV(COM0B1);
    put(1 << pin, high);
}
static void analogWrite(uint8_t pin, int duty) { // 0 and 255 are no PWM, as on an Arduino
    if (duty <= 0 || duty >= 255) return digitalWrite(pin, duty > 0);
    (pin == 6 ? OCR0A : OCR0B) = duty;
    TCCR0A |= pin == 6 ? _BV(COM0A1) : _BV(COM0B1);
}

struct SerialPort {
    void begin(unsigned long) {
        UCSR0A = _BV(U2X0);
        UBRR0 = 16; // 115,200 baud
        UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    }
    bool available() { return ring_head % 64 != ring_tail % 64; }
    int read() { return ring[ring_tail++ % 64]; }
    void println(const char *text) {
        while (*text) put(*text++);
        put('\r'), put('\n');
    }
    void put(uint8_t byte) {
        while (!(UCSR0A & _BV(UDRE0)));
        UDR0 = byte;
    }
};
static SerialPort Serial;

void setup();
void loop();
int main() {
    TCCR0A = _BV(WGM01) | _BV(WGM00); // PWM at 977 Hz, and millis()
    TCCR0B = _BV(CS01) | _BV(CS00);
    TCCR1B = _BV(WGM12) | _BV(CS11) | _BV(CS10);
    OCR1A = 249;
    TIMSK1 = _BV(OCIE1A);
    sei();
    setup();
    for (;;) loop();
}

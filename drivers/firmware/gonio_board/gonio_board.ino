// A photodiode behind a transimpedance amplifier, or a lamp (an LED on a PWM pin), for gonio. Arduino or Teensy.
//
// One board is one of the two: choose below. The protocol is core.h, which gonio's tests compile and drive.
// Photodiode: one amplifier a channel on PINS; with RANGES of two or more, a digital pin a range bit switches the
// feedback resistor (analogue switch, e.g. DG419). Lamp: LED_PIN through a transistor, INTERLOCK_PIN to ground while the
// door is closed. docs/instruments.md has the wiring.

#include "core.h"

#define PHOTODIODE  // or LAMP

const long BAUD = 115200;

#ifdef PHOTODIODE
const int PINS[] = {A0};                          // one a channel
const int CHANNELS = sizeof(PINS) / sizeof(PINS[0]);
const int RANGES = 1;
const double FULL_SCALE[RANGES] = {8.0};          // signal that fills the converter; 1 = a white diffuser, about
const int RANGE_PINS[] = {2};                     // bit 0, bit 1, ... of the range; used where RANGES > 1
const int BITS = 10;                              // 12 on a Teensy or an ESP32
const double TOP = (1L << BITS) - 1;

struct Diode : gonio::Hardware {
    int ranges_of[CHANNELS];
    int channels() override { return CHANNELS; }
    int ranges() override { return RANGES; }
    double full_scale(int r) override { return FULL_SCALE[r]; }
    void choose(int channel, int range) override {
        ranges_of[channel] = range;
        for (int bit = 0; (1 << bit) < RANGES; bit++) digitalWrite(RANGE_PINS[bit], (range >> bit) & 1);
    }
    void read(double seconds, double *signal, bool *over) override {
        double sum[CHANNELS];
        for (int c = 0; c < CHANNELS; c++) { sum[c] = 0; over[c] = false; }
        const unsigned long wanted = (unsigned long)(seconds * 1e6), begun = micros();
        unsigned long n = 0;
        do {
            for (int c = 0; c < CHANNELS; c++) {
                const int counts = analogRead(PINS[c]);
                sum[c] += counts;
                over[c] |= counts >= TOP;
            }
            n++;
        } while (micros() - begun < wanted);
        const double nominal = seconds > 0 ? seconds / EXPOSURE : 1;  // signals grow with the exposure
        for (int c = 0; c < CHANNELS; c++) {
            const double full = FULL_SCALE[ranges_of[c]];
            signal[c] = sum[c] / n / TOP * full * nominal;
            if (signal[c] >= full) { signal[c] = full; over[c] = true; }  // as a converter that integrates
        }
    }
    static constexpr double EXPOSURE = 0.02;      // exposure_s of the rig's YAML
} hardware;
gonio::Photodiode *board;
#else
const int LED_PIN = 9, INTERLOCK_PIN = 4;

struct Led : gonio::Hardware {
    bool interlock_open() override { return digitalRead(INTERLOCK_PIN) == HIGH; }
    void shine(double level) override { analogWrite(LED_PIN, (int)(255 * level + 0.5)); }
} hardware;
gonio::Lamp *board;
#endif

void setup() {
#ifdef PHOTODIODE
    for (int bit = 0; (1 << bit) < RANGES; bit++) pinMode(RANGE_PINS[bit], OUTPUT);
    static gonio::Photodiode made(hardware);
#else
    pinMode(LED_PIN, OUTPUT);
    pinMode(INTERLOCK_PIN, INPUT_PULLUP);
    static gonio::Lamp made(hardware);
#endif
    board = &made;
    Serial.begin(BAUD);
}

void loop() {
    while (Serial.available())
        if (board->take((char)Serial.read())) Serial.print(board->reply());
#ifndef PHOTODIODE
    board->watch();
#endif
}

// gonio's text protocol for a photodiode and a lamp, in plain C++: no Arduino header, no heap, no float in printf.
//
// `COMMAND arguments*HH` LF is answered by `text*HH` LF, HH being the exclusive or of all bytes before the star, in hex.
// The commands are written down at the top of drivers/photodiode.py and drivers/light.py. What is damaged or unknown is
// answered by `ERR -113,undefined header` and does nothing. Numbers that the host sent are sent back as it wrote them.
#pragma once

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

namespace gonio {

const int MOST_CHANNELS = 8;
const int LINE = 96;      // bytes of a command
const int ANSWER = 256;   // bytes of an answer

// What is soldered to the board.
struct Hardware {
    // Photodiode. ranges: lowest full scale first.
    virtual int channels() { return 0; }
    virtual int ranges() { return 0; }
    virtual double full_scale(int) { return 0; }  // of a range, in units of the signal
    virtual void choose(int, int) {}              // channel, range
    // The mean signal of every channel over so many seconds (0: one conversion each); whether a converter was full.
    virtual void read(double, double *, bool *) {}
    // Lamp.
    virtual bool interlock_open() { return false; }
    virtual void shine(double) {}  // 0 ... 1
    virtual const char *serial_number() { return "0"; }
};

// A text that cannot grow beyond its size: what does not fit makes it bad.
class Text {
  public:
    Text() { clear(); }
    void clear() { n = 0; good = true; buffer[0] = 0; }
    void put(char c) {
        if (n + 1 < ANSWER) {
            buffer[n++] = c;
            buffer[n] = 0;
        } else {
            good = false;
        }
    }
    void put(const char *s) { while (*s) put(*s++); }
    void put(long value) {
        char digits[12];
        int k = 0;
        unsigned long v = value < 0 ? 0UL - (unsigned long)value : (unsigned long)value;
        if (value < 0) put('-');
        do digits[k++] = char('0' + v % 10); while ((v /= 10) && k < 12);
        while (k) put(digits[--k]);
    }
    // NR3 with seven digits, as much as a float holds: -1.234567E-03
    void put(double value) {
        if (!(value == value) || value > 1e37 || value < -1e37) value = 0;  // no such signal
        if (value < 0) { put('-'); value = -value; }
        int exponent = 0;
        if (value > 0) {
            while (value >= 10) { value /= 10; exponent++; }
            while (value < 1 && exponent > -37) { value *= 10; exponent--; }
        }
        unsigned long digits = (unsigned long)(value * 1e6 + 0.5);
        if (digits >= 10000000UL) { digits /= 10; exponent++; }
        put((long)(digits / 1000000UL));
        put('.');
        for (unsigned long d = 100000UL; d; d /= 10) put(char('0' + digits / d % 10));
        put('E');
        put(exponent < 0 ? '-' : '+');
        int e = exponent < 0 ? -exponent : exponent;
        put(char('0' + e / 10));
        put(char('0' + e % 10));
    }
    const char *c_str() const { return buffer; }
    int length() const { return n; }
    bool good;

  private:
    char buffer[ANSWER];
    int n;
};

inline uint8_t checksum(const char *text, int n) {
    uint8_t sum = 0;
    for (int k = 0; k < n; k++) sum ^= (uint8_t)text[k];
    return sum;
}

inline int hex_digit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

// A plain decimal that takes up the whole text; false for anything else, NaN and infinity among it.
inline bool number(const char *text, double &value) {
    if (!*text || strlen(text) > 24) return false;
    int digits = 0;
    for (const char *c = text; *c; c++) {
        if (*c >= '0' && *c <= '9') digits++;
        else if (!strchr("+-.eE", *c)) return false;
    }
    char *end;
    value = strtod(text, &end);
    return digits > 0 && *end == 0 && value == value && value < 1e9 && value > -1e9;
}

// What one board does with a command. A board is asked by name; `answer` holds what it says without the first word.
class Board {
  public:
    explicit Board(Hardware &h) : hardware(h) {}
    virtual ~Board() {}

    // One byte from the host. True: `reply` is to be sent.
    bool take(char c) {
        if (c != '\n') {
            if (c == '\r') return false;
            if (used + 1 < LINE) line[used++] = c;
            else too_long = true;
            return false;
        }
        line[used] = 0;
        bool good = !too_long && undamaged();
        used = 0;
        too_long = false;
        answer.clear();
        if (!good || !obey() || !answer.good) {
            if (!failed) { answer.clear(); answer.put("ERR -113,undefined header"); }
        }
        failed = false;
        finish();
        return true;
    }
    const char *reply() const { return whole.c_str(); }

  protected:
    // The command's first word and its arguments; the answer is put together in `answer`. False: it is not known.
    virtual bool command(const char *word, const char *arguments) = 0;
    // An error with a number, in place of an answer.
    bool fail(const char *text) {
        answer.clear();
        answer.put("ERR ");
        answer.put(text);
        failed = true;
        return false;
    }
    Hardware &hardware;
    Text answer;

  private:
    bool undamaged() {
        char *star = strrchr(line, '*');
        if (!star || strlen(star) != 3) return false;
        int high = hex_digit(star[1]), low = hex_digit(star[2]);
        if (high < 0 || low < 0 || high * 16 + low != checksum(line, int(star - line))) return false;
        *star = 0;
        return true;
    }
    bool obey() {
        char *space = strchr(line, ' ');
        const char *arguments = "";
        if (space) { *space = 0; arguments = space + 1; }
        answer.put(line);
        int before = answer.length();
        answer.put(' ');
        if (!command(line, arguments)) return false;
        if (answer.length() == before + 1) { answer.clear(); answer.put(line); }  // nothing to say
        return true;
    }
    void finish() {
        const char *hex = "0123456789ABCDEF";
        uint8_t sum = checksum(answer.c_str(), answer.length());
        whole.clear();
        whole.put(answer.c_str());
        whole.put('*');
        whole.put(hex[sum >> 4]);
        whole.put(hex[sum & 15]);
        whole.put('\n');
    }
    char line[LINE];
    int used = 0;
    bool too_long = false, failed = false;
    Text whole;
};

class Photodiode : public Board {
  public:
    explicit Photodiode(Hardware &h) : Board(h) { reset(); }

  protected:
    bool command(const char *word, const char *arguments) override {
        const int channels = hardware.channels();
        if (!strcmp(word, "*IDN?")) {
            answer.put("gonio,photodiode,");
            answer.put(hardware.serial_number());
            answer.put(",1,");
            answer.put((long)channels);
        } else if (!strcmp(word, "*RST")) {
            reset();
        } else if (!strcmp(word, "CONF:FULL?")) {
            for (int r = 0; r < hardware.ranges(); r++) {
                if (r) answer.put(',');
                answer.put(hardware.full_scale(r));
            }
        } else if (!strcmp(word, "CONF:RANG")) {
            return choose(arguments);
        } else if (!strcmp(word, "READ?")) {
            double seconds;
            if (!number(arguments, seconds) || seconds < 0 || seconds > 600) return false;
            read(seconds, arguments);
            answer.put(last.c_str());
        } else if (!strcmp(word, "FETC?")) {
            answer.put(last.c_str());
        } else if (!strcmp(word, "SYST:ERR?")) {
            answer.put("0,\"No error\"");
        } else {
            return false;
        }
        return true;
    }

  private:
    void reset() {
        counter = 0;
        last.clear();
        for (int c = 0; c < hardware.channels(); c++) set(c, 0);
    }
    void set(int c, int r) {
        range[c] = r;
        hardware.choose(c, r);
    }
    bool choose(const char *arguments) {
        int wanted[MOST_CHANNELS], n = 0;
        const char *a = arguments;
        while (true) {  // r,r,...: one digit each
            if (n >= hardware.channels() || a[0] < '0' || a[0] > '9' || a[0] - '0' >= hardware.ranges()) return false;
            wanted[n++] = a[0] - '0';
            if (a[1] == 0) break;
            if (a[1] != ',') return false;
            a += 2;
        }
        if (n != hardware.channels()) return false;
        for (int c = 0; c < n; c++) if (range[c] != wanted[c]) set(c, wanted[c]);
        answer.put(arguments);
        return true;
    }
    void read(double seconds, const char *as_written) {
        double signal[MOST_CHANNELS];
        bool over[MOST_CHANNELS];
        hardware.read(seconds, signal, over);
        last.clear();
        last.put((long)++counter);
        last.put(',');
        last.put(as_written);
        for (int c = 0; c < hardware.channels(); c++) {
            last.put(',');
            last.put((long)range[c]);
            last.put(over[c] ? ",1," : ",0,");
            last.put(signal[c]);
        }
    }
    long counter;
    int range[MOST_CHANNELS];
    Text last;
};

class Lamp : public Board {
  public:
    explicit Lamp(Hardware &h) : Board(h) { hardware.shine(0); }

    // To be called all the time: an interlock that opens puts the lamp out, and it stays out.
    void watch() {
        if (on && hardware.interlock_open()) { on = false; hardware.shine(0); }
    }

  protected:
    bool command(const char *word, const char *arguments) override {
        watch();
        if (!strcmp(word, "*IDN?")) {
            answer.put("gonio,lamp,");
            answer.put(hardware.serial_number());
            answer.put(",1");
        } else if (!strcmp(word, "OUTP")) {
            if (strcmp(arguments, "0") && strcmp(arguments, "1")) return false;
            if (arguments[0] == '1' && hardware.interlock_open()) return fail("10,interlock open");
            on = arguments[0] == '1';
            hardware.shine(on ? level : 0);
            answer.put(arguments);
        } else if (!strcmp(word, "OUTP?")) {
            answer.put(on ? "1" : "0");
        } else if (!strcmp(word, "LEV")) {
            double wanted;
            if (!number(arguments, wanted) || wanted < 0 || wanted > 1) return false;
            level = wanted;
            hardware.shine(on ? level : 0);
            answer.put(arguments);
        } else if (!strcmp(word, "SYST:ERR?")) {
            answer.put("0,\"No error\"");
        } else {
            return false;
        }
        return true;
    }

  private:
    bool on = false;
    double level = 1;
};

}  // namespace gonio

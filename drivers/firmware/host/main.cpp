// The firmware's core as a program: `host photodiode SHARED` or `host lamp SHARED`, on its standard input and output.
//
// SHARED is a file of doubles that stands for the light between the two: lamp's level, interlock (1 = open), then the signal
// of every channel with the lamp at full, at the nominal exposure, and the dark; a negative signal ends the channels.
#include <cstdio>
#include <unistd.h>

#include "../gonio_board/core.h"

const double EXPOSURE = 0.02, DARK = 1e-3, BITS = 65535;
const double FULL_SCALE[] = {8, 240, 7200};

struct Bench : gonio::Hardware {
    explicit Bench(const char *path) : file(std::fopen(path, "r+b")) {}
    double get(int k) {
        double value = 0;
        std::rewind(file);
        std::fseek(file, 8L * k, SEEK_SET);
        return std::fread(&value, 8, 1, file) == 1 ? value : -1;
    }
    void put(int k, double value) {
        std::fseek(file, 8L * k, SEEK_SET);
        std::fwrite(&value, 8, 1, file);
        std::fflush(file);
    }
    int channels() override {
        int n = 0;
        while (n < gonio::MOST_CHANNELS && get(2 + n) >= 0) n++;
        return n;
    }
    int ranges() override { return 3; }
    double full_scale(int r) override { return FULL_SCALE[r]; }
    void choose(int channel, int r) override { range[channel] = r; }
    void read(double seconds, double *signal, bool *over) override {
        std::setvbuf(file, nullptr, _IONBF, 0);  // the lamp's process may have written meanwhile
        for (int c = 0; c < channels(); c++) {
            const double full = FULL_SCALE[range[c]], s = (get(0) * get(2 + c) + DARK) * seconds / EXPOSURE;
            const double counts = (double)(long)(s / full * BITS + 0.5);
            over[c] = counts >= BITS;
            signal[c] = (over[c] ? BITS : counts) / BITS * full;
        }
    }
    bool interlock_open() override { return get(1) > 0; }
    void shine(double level) override { put(0, level); }

  private:
    std::FILE *file;
    int range[gonio::MOST_CHANNELS] = {};
};

template <class Board> int serve(Bench &bench) {
    Board board(bench);
    char c;
    while (::read(0, &c, 1) == 1)
        if (board.take(c) && ::write(1, board.reply(), strlen(board.reply())) < 0) return 1;
    return 0;
}

int main(int argc, char **argv) {
    if (argc != 3) return 2;
    Bench bench(argv[2]);
    return !strcmp(argv[1], "lamp") ? serve<gonio::Lamp>(bench) : serve<gonio::Photodiode>(bench);
}

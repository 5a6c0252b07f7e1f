/* The firmware on a computer, to try a pad without a microcontroller and to test it (POSIX).
 *
 *   padgen_host script   reads commands: "feed HEX" bytes that come over the line, "run N" samples that pass,
 *                        "away N" samples that pass without the main program, "reset" the board starts anew
 *   padgen_host line     speaks the protocol over standard input and output, in real time
 *   padgen_host pty      the same over a pseudo-terminal, whose name it prints: a port for `padgen play`
 *
 * Options: --volts FILE   all voltages, 32-bit floats, a sample of all coils after the other
 *          --skip N       not those of the first N samples
 *          --log FILE     what began when: "begin SAMPLE frame LEVELS SIGNS", "begin SAMPLE silence", "silent SAMPLE"
 *          --speed X      so many times faster than real time
 *          --next N       the sequence number that is due first
 *          --boot 1       from the start-up silence on, else with coils that are cold and the silence over
 * Ends with the line (or SIGTERM), as soon as the pad is silent; exit code 1 if it is not in time.
 */
#define _XOPEN_SOURCE 600

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "padgen_protocol.h"

enum { CHUNK = 256, LONGEST_LINE = 1 << 20 };

typedef struct {
    padgen_drive drive;
    padgen_link link;
    FILE *volts, *log;
    int out; /* where answers go; -1 as text to standard output */
    uint32_t begun;
    int was_silent;
    unsigned long long sample, skip;
    float peak_v;
} host;

static volatile sig_atomic_t stopped;

static void stop(int number) {
    (void)number;
    stopped = 1;
}

static void answer(void *context, const uint8_t *bytes, size_t count) {
    const host *h = context;
    size_t k;
    if (h->out < 0) {
        printf("send ");
        for (k = 0; k < count; k++) printf("%02x", bytes[k]);
        printf("\n");
        return;
    }
    while (count) {
        const ssize_t done = write(h->out, bytes, count);
        if (done < 0 && errno != EINTR) return; /* nobody listens any more */
        if (done > 0) {
            bytes += done;
            count -= (size_t)done;
        }
    }
}

static void tell(host *h) {
    const int silent = padgen_state(&h->drive) == PADGEN_SILENT;
    unsigned k;
    if (h->begun != h->drive.begun) {
        h->begun = h->drive.begun;
        fprintf(h->log, "begin %llu %s", h->sample, h->drive.playing[h->drive.to] ? "frame " : "silence");
        for (k = 0; h->drive.playing[h->drive.to] && k < PADGEN_TAXELS; k++)
            fprintf(h->log, "%02x", h->drive.level[h->drive.to][k]);
        for (k = 0; h->drive.playing[h->drive.to] && k < PADGEN_SIGN_BYTES; k++)
            fprintf(h->log, "%s%02x", k ? "" : " ", h->drive.turned[h->drive.to][k]);
        fprintf(h->log, "\n");
    }
    if (silent && !h->was_silent) fprintf(h->log, "silent %llu\n", h->sample);
    h->was_silent = silent;
}

static void start(host *h) {
    memset(&h->drive, 0xa5, sizeof h->drive); /* whatever the memory holds */
    memset(&h->link, 0xa5, sizeof h->link);
    padgen_start(&h->drive);
    padgen_link_start(&h->link, &h->drive, answer, h);
    h->begun = 0;
}

static void run(host *h, unsigned long samples, int attended) {
    float volts[PADGEN_COILS];
    unsigned coil;
    while (samples--) {
        if (attended) padgen_link_tick(&h->link, 1);
        padgen_next(&h->drive, volts);
        for (coil = 0; coil < PADGEN_COILS; coil++) {
            if (volts[coil] > h->peak_v) h->peak_v = volts[coil];
            if (-volts[coil] > h->peak_v) h->peak_v = -volts[coil];
        }
        if (h->volts && h->sample >= h->skip) fwrite(volts, sizeof *volts, PADGEN_COILS, h->volts);
        tell(h);
        h->sample++;
    }
}

/* ---- Scripts --------------------------------------------------------------------------------------------- */

static int digit(char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    return -1;
}

static int script(host *h) {
    static char line[LONGEST_LINE];
    while (fgets(line, sizeof line, stdin)) {
        if (strncmp(line, "feed ", 5) == 0) {
            const char *at = line + 5;
            for (; digit(at[0]) >= 0 && digit(at[1]) >= 0; at += 2)
                padgen_link_byte(&h->link, (uint8_t)(digit(at[0]) * 16 + digit(at[1])));
        } else if (strncmp(line, "run ", 4) == 0) {
            run(h, strtoul(line + 4, NULL, 10), 1);
        } else if (strncmp(line, "away ", 5) == 0) {
            run(h, strtoul(line + 5, NULL, 10), 0);
        } else if (strncmp(line, "reset", 5) == 0) {
            start(h);
        } else {
            fprintf(stderr, "padgen_host: no command: %s", line);
            return 2;
        }
    }
    return 0;
}

/* ---- Lines ----------------------------------------------------------------------------------------------- */

static double now_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Bytes and samples in turn, until the line ends; where the machine is too slow, time is what slows down. */
static void serve(host *h, int in, double speed, int ends) {
    double last = now_s(), due = 0.0;
    const double most = 0.1 * PADGEN_RATE_HZ;
    int was_open = 0;
    while (!stopped) {
        struct pollfd waits = {in, POLLIN, 0};
        uint8_t bytes[CHUNK];
        ssize_t count = 0, k;
        double now;
        if (poll(&waits, 1, 1) > 0) {
            count = read(in, bytes, sizeof bytes);
            if (count <= 0 && (ends || was_open)) return;
            if (count <= 0) usleep(1000); /* a pseudo-terminal that nobody has opened yet */
        }
        if (count > 0) was_open = !ends;
        for (k = 0; k < count; k++) padgen_link_byte(&h->link, bytes[k]);
        now = now_s();
        due += (now - last) * speed * PADGEN_RATE_HZ;
        last = now;
        if (due > most) due = most;
        run(h, (unsigned long)due, 1);
        due -= (double)(unsigned long)due;
    }
}

static int pseudo_terminal(void) {
    struct termios raw;
    const int line = posix_openpt(O_RDWR | O_NOCTTY);
    if (line < 0 || grantpt(line) || unlockpt(line) || tcgetattr(line, &raw)) return -1;
    raw.c_iflag = raw.c_oflag = raw.c_lflag = 0;
    raw.c_cflag |= CS8;
    if (tcsetattr(line, TCSANOW, &raw)) return -1;
    printf("%s\n", ptsname(line));
    fflush(stdout);
    return line;
}

/* The line is gone: what the watchdog and a transition take, and the pad must be silent. */
static int fall_silent(host *h) {
    const unsigned long most = PADGEN_WATCHDOG_SAMPLES + 4ul * PADGEN_STEP_SAMPLES;
    unsigned long k;
    for (k = 0; k < most && padgen_state(&h->drive) != PADGEN_SILENT; k++) run(h, 1, 1);
    run(h, 1, 1);
    return padgen_state(&h->drive) == PADGEN_SILENT ? 0 : 1;
}

int main(int count, char **words) {
    static host h;
    const char *mode = count > 1 ? words[1] : "";
    double speed = 1.0;
    int k, code = 0, line, boots = 0;
    h.log = stderr;
    h.was_silent = 1;
    start(&h);
    for (k = 2; k + 1 < count; k += 2) {
        if (strcmp(words[k], "--volts") == 0) h.volts = fopen(words[k + 1], "wb");
        else if (strcmp(words[k], "--log") == 0) h.log = fopen(words[k + 1], "w");
        else if (strcmp(words[k], "--skip") == 0) h.skip = strtoull(words[k + 1], NULL, 10);
        else if (strcmp(words[k], "--speed") == 0) speed = atof(words[k + 1]);
        else if (strcmp(words[k], "--next") == 0) h.link.next_sequence = (uint16_t)atol(words[k + 1]);
        else if (strcmp(words[k], "--boot") == 0) boots = atoi(words[k + 1]);
    }
    if (!boots) {
        h.drive.rest = 0;
        memset(h.drive.heat, 0, sizeof h.drive.heat);
        memset(h.drive.warmth, 0, sizeof h.drive.warmth);
        h.drive.pad_warmth = 0.0f;
        h.drive.pad_heat = 0;
    }
    signal(SIGPIPE, SIG_IGN);
    signal(SIGTERM, stop);
    if (strcmp(mode, "script") == 0) {
        h.out = -1;
        code = script(&h);
    } else if (strcmp(mode, "line") == 0) {
        h.out = 1;
        serve(&h, 0, speed, 1);
        code = fall_silent(&h);
    } else if (strcmp(mode, "pty") == 0 && (line = pseudo_terminal()) >= 0) {
        h.out = line;
        serve(&h, line, speed, 0);
        code = fall_silent(&h);
    } else {
        fprintf(stderr, "use: padgen_host script|line|pty [--volts FILE] [--log FILE] [--speed X] [--next N] [--boot 1]\n");
        return 2;
    }
    if (h.log) fprintf(h.log, "peak %.6g\n", (double)h.peak_v);
    if (h.volts) fclose(h.volts);
    if (h.log && h.log != stderr) fclose(h.log);
    return code;
}

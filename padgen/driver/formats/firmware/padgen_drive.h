/* The coils' voltages, sample by sample, from the taxels' levels. Plain C99: no malloc, of libm only sqrtf.
 *
 * One structure holds everything. padgen_next belongs to the timer's interrupt, all others to the main
 * program; they meet in `waiting` alone, so that neither has to be locked out.
 *
 * A level is 0 ... 255, a share of the taxel's ON amplitude. Between two frames the force is blended in
 * PADGEN_RAMP_SAMPLES by a smooth step; time-shared, every channel has a slot, up over its one half and
 * down over the other. A frame that arrives meanwhile waits; there is room for one.
 *
 * Nothing that is asked for goes beyond the limits that pad_drive.h has of coil and amplifier: voltage, current, heat of
 * a coil and of all coils. The heat is of a coil whose time constant is 2^PADGEN_HEAT_SHIFT samples; from 63/64 of its
 * limit on, less and less is given, and nothing at the limit. A slower coil is then never above its limit either.
 */
#ifndef PADGEN_DRIVE_H
#define PADGEN_DRIVE_H

#include <stddef.h>
#include <stdint.h>

#include "pad_drive.h"

#if PADGEN_HEADER != 3
#error "pad_drive.h and the firmware are of different versions: write both anew with padgen drive --formats c"
#endif
#if PADGEN_VOLTAGE_LIMIT_UV < 1 || PADGEN_VOLTAGE_LIMIT_UV > PADGEN_AMPLIFIER_UV
#error "PADGEN_VOLTAGE_LIMIT_UV must be 1 ... PADGEN_AMPLIFIER_UV: no voltage beyond what the amplifier has"
#endif
#if PADGEN_CURRENT_LIMIT_UA < 1 || PADGEN_CURRENT_LIMIT_UA > PADGEN_AMPLIFIER_UA
#error "PADGEN_CURRENT_LIMIT_UA must be 1 ... PADGEN_AMPLIFIER_UA: no current beyond what the amplifier has"
#endif
#if PADGEN_COIL_LIMIT_UW < 1 || PADGEN_PAD_LIMIT_UW < 1 || PADGEN_PAD_LIMIT_UW > PADGEN_COIL_LIMIT_UW * PADGEN_COILS
#error "PADGEN_PAD_LIMIT_UW must be above 0 and no more than all coils bear together"
#endif
#if PADGEN_HEAT_SHIFT < 6 || PADGEN_HEAT_SHIFT > 24 || PADGEN_START_SAMPLES * 63 < 1 << PADGEN_HEAT_SHIFT
#error "PADGEN_START_SAMPLES must be 1/63 of the coils' time constant, 2^6 ... 2^24 samples, or more"
#endif
#if PADGEN_RAMP_SAMPLES < 1 || PADGEN_STEP_SAMPLES != (1 + PADGEN_TAKES_TURNS) * PADGEN_RAMP_SAMPLES
#error "PADGEN_STEP_SAMPLES must be a ramp, time-shared two"
#endif
#if PADGEN_SLOTS < 1 || PADGEN_FRAME_SAMPLES < PADGEN_STEP_SAMPLES * PADGEN_SLOTS
#error "PADGEN_FRAME_SAMPLES must hold the steps of all slots"
#endif
#if PADGEN_WATCHDOG_SAMPLES < PADGEN_RATE_HZ || \
    (PADGEN_WATCHDOG_SAMPLES > PADGEN_RATE_HZ && PADGEN_WATCHDOG_SAMPLES > 2 * PADGEN_FRAME_SAMPLES)
#error "PADGEN_WATCHDOG_SAMPLES must be a second or two frames: a line that is lost must not leave a coil on"
#endif
#if PADGEN_HOLD_SAMPLES < PADGEN_WATCHDOG_SAMPLES || PADGEN_HOLD_SAMPLES > 8 * PADGEN_WATCHDOG_SAMPLES
#error "PADGEN_HOLD_SAMPLES must be 1 ... 8 times PADGEN_WATCHDOG_SAMPLES: pings must not hold a coil on for ever"
#endif

/* What comes before is in memory before what comes after, as an interrupt sees it. */
#ifndef PADGEN_BARRIER
#ifdef __GNUC__
#define PADGEN_BARRIER() __asm__ __volatile__("" : : : "memory")
#else
#error "define PADGEN_BARRIER() as this compiler's memory barrier"
#endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define PADGEN_SIGN_BYTES ((PADGEN_TAXELS + 7) / 8)
/* Whether a current is a sum of roots of levels. */
#define PADGEN_HAS_ROOT_TONES (PADGEN_SCHEME == PADGEN_TONES || PADGEN_SCHEME == PADGEN_TIME_SHARED)

typedef struct {
    uint8_t level[3][PADGEN_TAXELS]; /* of three frames: blended from, blended to, next */
    uint8_t turned[3][PADGEN_SIGN_BYTES]; /* of the same, a bit a taxel from the lowest on: in counter-phase */
    float constant_a2[3][PADGEN_COILS]; /* spur-free: the constant of each coil's i2, for these frames */
    uint8_t playing[3]; /* whether each is a frame, or silence */
    volatile uint8_t from, to, next; /* which of the three */
    volatile uint8_t waiting; /* 0 nothing, else what lies in next */
    volatile uint8_t silent;
    volatile uint32_t begun; /* how many frames and silences have begun */
    uint32_t phase[PADGEN_KINDS][PADGEN_CHANNELS];
    float cosine[PADGEN_KINDS][PADGEN_CHANNELS], slope[PADGEN_KINDS][PADGEN_CHANNELS]; /* of the tones; slope in 1/s */
    float carrier[2]; /* its cosine, and that one's slope in 1/s */
    uint32_t carrier_phase;
    uint32_t sample; /* within the period */
    uint32_t step, slot; /* samples since the transition, or the slot, began */
    volatile uint32_t sweep_left; /* samples of a sweep that are still to come */
    uint32_t sweep_phase;
    volatile uint16_t sweep_coil;
    volatile uint8_t sweep_stops; /* it fades out, to end before its time */
    float sweep_gain;
    uint32_t rest; /* samples of silence that are left of the start */
    float current_a[PADGEN_COILS]; /* in each coil, after the last sample */
    uint32_t heat[PADGEN_COILS]; /* of each coil; 2^31 is its limit */
    float warmth[PADGEN_COILS]; /* the same in shares of the limit, with the heat that the coil's field will become */
    uint32_t pad_heat; /* of all coils together, likewise */
    float pad_warmth, lost_w, field_w;
    float awake; /* from 1 to 0 where the main program is gone */
    volatile uint32_t away; /* samples since the main program was there */
    volatile float given; /* smallest share of what was asked that a coil is given */
    volatile uint8_t faults; /* what the self-test found */
} padgen_drive;

enum { PADGEN_SILENT = 0, PADGEN_SWITCHING = 1, PADGEN_HOLDING = 2 };

enum { PADGEN_TABLES_FAULT = 1, PADGEN_CLAMP_FAULT = 2, PADGEN_ARITHMETIC_FAULT = 4 };

/* Test tables, clamp and arithmetic, and begin: silent for PADGEN_START_SAMPLES, and for ever where the test failed.
 * Before a reset the coils may have been as warm as they bear, so that is what is taken to be true. */
void padgen_start(padgen_drive *drive);

/* CRC-32 as in Ethernet and zlib of some bytes; `before` is that of the bytes before them, 0 if there are none. */
uint32_t padgen_crc32(uint32_t before, const void *bytes, size_t count);

/* The main program is alive: without this, or a frame, for PADGEN_WATCHDOG_SAMPLES nothing is put out. */
void padgen_attend(padgen_drive *drive);

/* Show a frame; 0 where one is waiting already or the self-test failed, and nothing was done. */
int padgen_show(padgen_drive *drive, const uint8_t level[PADGEN_TAXELS]);

/* The same with the taxels whose bit of `turned` is 1, from the lowest of the first byte on, in counter-phase: those of
 * one frequency then need not shake the pad. */
int padgen_show_signed(padgen_drive *drive, const uint8_t level[PADGEN_TAXELS],
                       const uint8_t turned[PADGEN_SIGN_BYTES]);

/* Ramp to silence, as soon as the present transition (time-shared: slot) is over; a waiting frame is dropped. */
void padgen_silence(padgen_drive *drive);

/* Shake the taxels of one coil by a sweep, so that they can be measured; 0 where the pad is not silent, and nothing was
 * done. It ends by itself, or by padgen_silence. */
int padgen_excite(padgen_drive *drive, uint16_t coil);

/* Voltages of all coils for the next sample, to be called PADGEN_RATE_HZ times a second. None is ever beyond
 * PADGEN_VOLTAGE_LIMIT_V, nor makes more current or heat than is borne: where a state asks for more, it gets less. */
void padgen_next(padgen_drive *drive, float volts[PADGEN_COILS]);

/* PADGEN_SILENT, PADGEN_SWITCHING or PADGEN_HOLDING. */
int padgen_state(const padgen_drive *drive);

/* A voltage as a signed code of 2 ... 32 bits; what is beyond full scale stays there, what is no number is 0. */
static inline int32_t padgen_code(float volts, float full_scale_v, unsigned bits) {
    const int32_t top = (int32_t)((UINT32_C(1) << (bits - 1)) - 1);
    const float code = volts / full_scale_v * (float)top;
    if (code >= (float)top) return top;
    if (code <= -(float)top) return -top;
    return code == code ? (int32_t)(code < 0 ? code - 0.5f : code + 0.5f) : 0;
}

#ifdef __cplusplus
}
#endif

#endif

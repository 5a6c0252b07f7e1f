/* The coils' voltages, sample by sample, from the taxels' levels. Plain C99: no malloc, of libm only sqrtf.
 *
 * One structure holds everything. padgen_next belongs to the timer's interrupt, all others to the main
 * program; they meet in `waiting` alone, so that neither has to be locked out.
 *
 * A level is 0 ... 255, a share of the taxel's ON amplitude. Between two frames the force is blended in
 * PADGEN_RAMP_SAMPLES by a smooth step; time-shared, every channel has a slot, up over its one half and
 * down over the other. A frame that arrives meanwhile waits; there is room for one.
 */
#ifndef PADGEN_DRIVE_H
#define PADGEN_DRIVE_H

#include <stdint.h>

#include "pad_drive.h"

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

typedef struct {
    uint8_t level[3][PADGEN_TAXELS]; /* of three frames: blended from, blended to, next */
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
} padgen_drive;

enum { PADGEN_SILENT = 0, PADGEN_SWITCHING = 1, PADGEN_HOLDING = 2 };

/* Begin, silent. */
void padgen_start(padgen_drive *drive);

/* Show a frame; 0 where one is waiting already, and nothing was done. */
int padgen_show(padgen_drive *drive, const uint8_t level[PADGEN_TAXELS]);

/* Ramp to silence, as soon as the present transition (time-shared: slot) is over; a waiting frame is dropped. */
void padgen_silence(padgen_drive *drive);

/* Shake the taxels of one coil by a sweep, so that they can be measured; 0 where the pad is not silent, and nothing was
 * done. It ends by itself, or by padgen_silence. */
int padgen_excite(padgen_drive *drive, uint16_t coil);

/* Voltages of all coils for the next sample, to be called PADGEN_RATE_HZ times a second. None is ever beyond
 * PADGEN_VOLTAGE_LIMIT_V: where a state asks for more, it stays there. */
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

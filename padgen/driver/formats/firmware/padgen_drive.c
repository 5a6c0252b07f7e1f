/* See padgen_drive.h. Formulas as in docs/driving.md; i is a coil's current, F the lines of i^2 in A^2. */
#include "padgen_drive.h"

#include <math.h>
#include <string.h>

enum { NOTHING = 0, FRAME = 1, SILENCE = 2 };

static const float turn = 6.283185307f;

/* The sine of a phase in 2^-32 turns: folded to a quarter, where a polynomial of least maximum error (3.3e-9)
 * has it to the last digits of a float. */
static float sine(uint32_t phase) {
    int32_t angle = (int32_t)(phase ^ (phase << 1)) < 0 ? (int32_t)(UINT32_C(0x80000000) - phase) : (int32_t)phase;
    const float x = (float)angle * 2.3283064365386963e-10f, z = x * x;
    return x * (6.283185159f + z * (-41.341654917f + z * (81.600998609f + z * (-76.549678455f + z * 39.536023390f))));
}

/* Below 0 for a taxel that moves in counter-phase. */
static float level_of(const padgen_drive *drive, unsigned frame, uint16_t taxel) {
    const float level = (float)drive->level[frame][taxel] * (1.0f / 255.0f);
    return drive->turned[frame][taxel / 8] >> taxel % 8 & 1 ? -level : level;
}

/* ---- The least constant of a spur-free force ------------------------------------------------------------ */

#if PADGEN_SCHEME == PADGEN_SPUR_FREE

/* A bound for the levels of one group of channels: the least constant is convex in them and known for all on/off
 * states. With levels sorted, g1 >= g2 >= ..., they are the mean of the states {1}, {1, 2}, ... with weights
 * g1 - g2, g2 - g3, ... For an on/off state it is the least constant itself. Each channel that is on adds its place to
 * the state's. */
static float group_constant(const float *least, const float *level, const unsigned *place_of, unsigned count) {
    unsigned order[PADGEN_GROUP_CHANNELS], k, state = 0;
    float sum = 0.0f;
    for (k = 0; k < count; k++) {
        unsigned place = k;
        for (; place > 0 && level[order[place - 1]] < level[k]; place--) order[place] = order[place - 1];
        order[place] = k;
    }
    for (k = 0; k < count; k++) {
        const float after = k + 1 < count ? level[order[k + 1]] : 0.0f;
        state += place_of[order[k]];
        sum += (level[order[k]] - after) * least[state];
    }
    return sum;
}

/* Where a channel moves in counter-phase: the sum over smaller groups, of which the states off, on and turned over are
 * known; a state's place has a digit of base 3 for each channel. */
static float turned_constant(unsigned kind, const float *level, unsigned count) {
    float size[PADGEN_SIGNED_CHANNELS], sum = 0.0f;
    unsigned place[PADGEN_SIGNED_CHANNELS], j, k, group, digit;
    for (j = 0, group = 0; j < count; j += PADGEN_SIGNED_CHANNELS, group++) {
        for (k = 0, digit = 1; k < PADGEN_SIGNED_CHANNELS && j + k < count; k++, digit *= 3) {
            size[k] = level[j + k] < 0.0f ? -level[j + k] : level[j + k];
            place[k] = level[j + k] < 0.0f ? 2 * digit : digit;
        }
        sum += group_constant(padgen_signed_a2[kind][group], size, place, k);
    }
    return sum;
}

/* All channels of a coil: what they have in common is as all on, the rest as the groups' sum; and the margin. */
static float constant_of(const padgen_drive *drive, unsigned frame, unsigned coil) {
    const unsigned kind = padgen_coil_kind[coil], count = padgen_kind_channels[kind];
    unsigned place[PADGEN_GROUP_CHANNELS], j, group;
    float level[PADGEN_CHANNELS], least = 1.0f, sum = 0.0f;
    for (j = 0; j < PADGEN_GROUP_CHANNELS; j++) place[j] = 1u << j;
    for (j = 0; j < count; j++) {
        level[j] = level_of(drive, frame, padgen_coil_taxel[coil][j]);
        if (level[j] < least) least = level[j];
        sum += (level[j] < 0.0f ? -level[j] : level[j]) * padgen_margin_a2[kind][j];
    }
    if (count == 0) return 0.0f;
    if (least < 0.0f) return sum + turned_constant(kind, level, count);
    for (j = 0; j < count; j++) level[j] -= least;
    sum += least * padgen_all_on_a2[kind];
    for (j = 0, group = 0; j < count; j += PADGEN_GROUP_CHANNELS, group++) {
        const unsigned rest = count - j;
        const unsigned size = rest < PADGEN_GROUP_CHANNELS ? rest : PADGEN_GROUP_CHANNELS;
        sum += group_constant(padgen_least_a2[kind][group], level + j, place, size);
    }
    return sum;
}

static void prepare(padgen_drive *drive, unsigned frame) {
    unsigned coil;
    for (coil = 0; coil < PADGEN_COILS; coil++) drive->constant_a2[frame][coil] = constant_of(drive, frame, coil);
}

#else

static void prepare(padgen_drive *drive, unsigned frame) {
    (void)drive;
    (void)frame;
}

#endif

/* ---- Frames ---------------------------------------------------------------------------------------------- */

static void restart_phases(padgen_drive *drive) {
    memcpy(drive->phase, padgen_phase, sizeof drive->phase);
    drive->carrier_phase = 0;
    drive->sample = 0;
}

void padgen_attend(padgen_drive *drive) { drive->away = 0; }

int padgen_show(padgen_drive *drive, const uint8_t level[PADGEN_TAXELS]) {
    static const uint8_t none[PADGEN_SIGN_BYTES] = {0};
    return padgen_show_signed(drive, level, none);
}

int padgen_show_signed(padgen_drive *drive, const uint8_t level[PADGEN_TAXELS],
                       const uint8_t turned[PADGEN_SIGN_BYTES]) {
    padgen_attend(drive);
    if (drive->waiting != NOTHING || drive->sweep_left || drive->faults) return 0;
    memcpy(drive->level[drive->next], level, PADGEN_TAXELS);
    memcpy(drive->turned[drive->next], turned, PADGEN_SIGN_BYTES);
    drive->playing[drive->next] = 1;
    prepare(drive, drive->next);
    PADGEN_BARRIER();
    drive->waiting = FRAME;
    return 1;
}

void padgen_silence(padgen_drive *drive) {
    const uint8_t waiting = drive->waiting;
    drive->sweep_stops = 1;
    if (waiting == SILENCE || (waiting == NOTHING && !drive->playing[drive->to])) return;
    drive->waiting = NOTHING; /* from here on the interrupt leaves `next` alone */
    PADGEN_BARRIER();
    memset(drive->level[drive->next], 0, PADGEN_TAXELS);
    drive->playing[drive->next] = 0;
    prepare(drive, drive->next);
    PADGEN_BARRIER();
    drive->waiting = SILENCE;
}

int padgen_state(const padgen_drive *drive) {
    if (drive->waiting != NOTHING || drive->sweep_left) return PADGEN_SWITCHING;
    if (drive->silent) return PADGEN_SILENT;
    return PADGEN_TAKES_TURNS || drive->step >= PADGEN_STEP_SAMPLES ? PADGEN_HOLDING : PADGEN_SWITCHING;
}

int padgen_excite(padgen_drive *drive, uint16_t coil) {
    padgen_attend(drive);
    if (coil >= PADGEN_COILS || drive->faults || padgen_state(drive) != PADGEN_SILENT) return 0;
    drive->sweep_coil = coil;
    drive->sweep_phase = 0;
    drive->sweep_gain = 1.0f;
    drive->sweep_stops = 0;
    PADGEN_BARRIER();
    drive->sweep_left = PADGEN_SWEEP_SAMPLES;
    return 1;
}

static void begin(padgen_drive *drive) {
    const uint8_t old = drive->from;
    drive->from = drive->to;
    drive->to = drive->next;
    drive->next = old;
    drive->step = 0;
    drive->slot = 0;
    drive->begun++;
    drive->silent = PADGEN_TAKES_TURNS && !drive->playing[drive->to];
    PADGEN_BARRIER();
    drive->waiting = NOTHING;
}

/* Before a sample: is a transition or slot over, and does another begin? */
static void turn_over(padgen_drive *drive) {
    if (!drive->silent && drive->step < PADGEN_STEP_SAMPLES) return;
    if (!drive->playing[drive->to]) drive->silent = 1;
    if (PADGEN_TAKES_TURNS && !drive->silent) {
        drive->step = 0;
        if (++drive->slot >= PADGEN_SLOTS) drive->slot = 0;
    }
    if (drive->waiting == SILENCE || (drive->waiting == FRAME && (drive->silent || drive->slot == 0))) begin(drive);
}

/* ---- Samples --------------------------------------------------------------------------------------------- */

/* How far the frame `to` has come, how much of `from` is left, and the former per second. */
typedef struct {
    float to, from, slope;
} blend;

/* The blends of a transition, and of its two halves: what is left of `from` in the first, how far `to` is in the other. */
typedef struct {
    blend all, falls, rises;
} blends;

/* From 0 to 1 with no jump up to the fourth derivative; for s up to 1/2, where it has all its digits. */
static float smooth_step(float s) {
    return s * s * s * s * s * (126.0f - s * (420.0f - s * (540.0f - s * (315.0f - s * 70.0f))));
}

/* After such a part of a ramp, by its samples. */
static blend blend_at(float step, float ramp, float per_second) {
    const float s = step / ramp, rest = (ramp - step) / ramp;
    blend now = {1.0f, 0.0f, 0.0f};
    if (step >= ramp) return now;
    now.to = s < 0.5f ? smooth_step(s) : 1.0f - smooth_step(rest);
    now.from = s < 0.5f ? 1.0f - now.to : smooth_step(rest);
    now.slope = 630.0f * (s * rest) * (s * rest) * (s * rest) * (s * rest) * per_second;
    return now;
}

/* Time-shared, `to` is the share of the slot and nothing is left of the frame before. */
static blends blend_now(const padgen_drive *drive) {
    const uint32_t ramp = PADGEN_RAMP_SAMPLES;
    const int falls = PADGEN_TAKES_TURNS && drive->step > ramp;
    const uint32_t step = falls ? 2 * ramp - drive->step : drive->step < ramp ? drive->step : ramp;
    const float per_second = (float)PADGEN_RATE_HZ / (float)PADGEN_RAMP_SAMPLES, all = (float)ramp;
    const blend silent = {0.0f, 0.0f, 0.0f}, left = {0.0f, 1.0f, 0.0f};
    blends now = {silent, silent, left};
    now.all = blend_at((float)step, all, falls ? -per_second : per_second);
    if (PADGEN_TAKES_TURNS) {
        now.all.from = 0.0f;
    } else if (2 * step < ramp) {
        now.falls = blend_at(2.0f * (float)step, all, 2.0f * per_second);
        now.rises = left;
    } else {
        now.rises = blend_at(2.0f * (float)step - all, all, 2.0f * per_second);
    }
    return now;
}

static void make_waves(padgen_drive *drive, unsigned kind) {
    unsigned j;
    for (j = 0; j < padgen_kind_channels[kind]; j++) {
        const uint32_t phase = drive->phase[kind][j];
        drive->cosine[kind][j] = sine(phase + UINT32_C(0x40000000));
        drive->slope[kind][j] = -turn * padgen_tone_hz[kind][j] * sine(phase);
    }
}

typedef struct {
    float value, slope; /* the latter per second */
} moving;

/* The level of a coil's channel at this sample. A tone that turns over goes to silence in the first half of the
 * transition and comes back in the other, as its root has no slope at 0; other currents pass through 0. */
static moving level_now(const padgen_drive *drive, unsigned coil, unsigned j, const blends *now) {
    const uint16_t taxel = padgen_coil_taxel[coil][j];
    const float to = level_of(drive, drive->to, taxel);
    const float from = PADGEN_TAKES_TURNS ? 0.0f : level_of(drive, drive->from, taxel);
    moving level = {0.0f, 0.0f};
    if (PADGEN_TAKES_TURNS && padgen_slot[padgen_coil_kind[coil]][j] != drive->slot) return level;
    if (PADGEN_HAS_ROOT_TONES && from * to < 0.0f) {
        level.value = from * now->falls.from + to * now->rises.to;
        level.slope = to * now->rises.slope - from * now->falls.slope;
        return level;
    }
    level.value = from * now->all.from + to * now->all.to;
    level.slope = (to - from) * now->all.slope;
    return level;
}

/* A sum and its slope, and a tone with an amplitude of its own more. */
static void add(moving *sum, float amplitude, float amplitude_slope, float cosine, float cosine_slope) {
    sum->value += amplitude * cosine;
    sum->slope += amplitude_slope * cosine + amplitude * cosine_slope;
}

#if PADGEN_SCHEME == PADGEN_SPUR_FREE

/* i = sqrt(F), F = constant + sum of level * line * cosine; on a carrier i = sqrt(2 F) times its cosine. */
static moving current(const padgen_drive *drive, unsigned coil, const blends *now) {
    const unsigned kind = padgen_coil_kind[coil];
    const float before = drive->constant_a2[drive->from][coil], after = drive->constant_a2[drive->to][coil];
    moving sum = {before * now->all.from + after * now->all.to, (after - before) * now->all.slope}, i = {0.0f, 0.0f};
    unsigned j;
    for (j = 0; j < padgen_kind_channels[kind]; j++) {
        const moving level = level_now(drive, coil, j, now);
        const float line = padgen_line_a2[kind][j];
        add(&sum, line * level.value, line * level.slope, drive->cosine[kind][j], drive->slope[kind][j]);
    }
    if (sum.value < 1e-30f) return i;
    i.value = sqrtf(sum.value);
    i.slope = sum.slope / (2.0f * i.value);
#if PADGEN_HAS_CARRIER
    i.slope = 1.414213562f * (i.slope * drive->carrier[0] + i.value * drive->carrier[1]);
    i.value *= 1.414213562f * drive->carrier[0];
#endif
    return i;
}

#elif PADGEN_SCHEME == PADGEN_BIASED

/* i = B + sum of level * line / (2 B) * cosine. From and to silence all of it times the root of the blend, so that
 * its square rises as the blend does. */
static moving current(const padgen_drive *drive, unsigned coil, const blends *now) {
    const unsigned kind = padgen_coil_kind[coil];
    const float bias = padgen_bias_a[kind];
    const int rises = !drive->playing[drive->from], falls = !drive->playing[drive->to];
    const float share = rises ? now->all.to : now->all.from, slope = rises ? now->all.slope : -now->all.slope;
    const blends all = {{rises ? 1.0f : 0.0f, rises ? 0.0f : 1.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}};
    moving i = {bias, 0.0f};
    unsigned j;
    for (j = 0; j < padgen_kind_channels[kind]; j++) {
        const moving level = level_now(drive, coil, j, rises || falls ? &all : now);
        const float tone = padgen_line_a2[kind][j] / (2.0f * bias);
        add(&i, tone * level.value, tone * level.slope, drive->cosine[kind][j], drive->slope[kind][j]);
    }
    if (rises || falls) {
        const float root = sqrtf(share);
        i.slope = share > 0.0f ? i.slope * root + i.value * slope / (2.0f * root) : 0.0f;
        i.value *= root;
    }
    return i;
}

#elif PADGEN_SCHEME == PADGEN_LINEAR

/* i = sum of level * line * cosine: the force goes with the current itself. */
static moving current(const padgen_drive *drive, unsigned coil, const blends *now) {
    const unsigned kind = padgen_coil_kind[coil];
    moving i = {0.0f, 0.0f};
    unsigned j;
    for (j = 0; j < padgen_kind_channels[kind]; j++) {
        const moving level = level_now(drive, coil, j, now);
        const float line = padgen_line_a2[kind][j];
        add(&i, line * level.value, line * level.slope, drive->cosine[kind][j], drive->slope[kind][j]);
    }
    return i;
}

#else

/* i = sum of sqrt(2 * level * line) * cosine, the cosine at half the force's frequency; in counter-phase it is a quarter
 * of its own period late. */
static moving current(const padgen_drive *drive, unsigned coil, const blends *now) {
    const unsigned kind = padgen_coil_kind[coil];
    moving i = {0.0f, 0.0f};
    unsigned j;
    for (j = 0; j < padgen_kind_channels[kind]; j++) {
        const moving level = level_now(drive, coil, j, now);
        const float size = level.value < 0.0f ? -level.value : level.value;
        if (size > 0.0f) {
            const float tone = sqrtf(2.0f * size * padgen_line_a2[kind][j]);
            const float slope = tone * level.slope / (2.0f * level.value);
            const float radians = turn * padgen_tone_hz[kind][j];
            if (level.value > 0.0f)
                add(&i, tone, slope, drive->cosine[kind][j], drive->slope[kind][j]);
            else
                add(&i, tone, slope, -drive->slope[kind][j] / radians, radians * drive->cosine[kind][j]);
        }
    }
    return i;
}

#endif

static void step_phases(padgen_drive *drive) {
    unsigned kind, j;
    if (drive->step < UINT32_MAX) drive->step++;
    if (++drive->sample >= PADGEN_PERIOD_SAMPLES) {
        restart_phases(drive); /* what the increments were rounded by never adds up */
        return;
    }
    drive->carrier_phase += PADGEN_CARRIER_INCREMENT;
    for (kind = 0; kind < PADGEN_KINDS; kind++)
        for (j = 0; j < padgen_kind_channels[kind]; j++) drive->phase[kind][j] += padgen_increment[kind][j];
}

/* ---- Limits ---------------------------------------------------------------------------------------------- */

/* Between -most and most, whatever the tables and levels hold; what is no number is silence. */
static float within(float value, float most) {
    if (value >= most) return most;
    if (value <= -most) return -most;
    return value == value ? value : 0.0f;
}

static const float coil_limit_w = PADGEN_COIL_LIMIT_UW / 1000000.0f, pad_limit_w = PADGEN_PAD_LIMIT_UW / 1000000.0f;
static const float ohm_rise = PADGEN_RESISTANCE_OHM / PADGEN_CURRENT_RISE;
static const float constant_samples = (float)(UINT32_C(1) << PADGEN_HEAT_SHIFT);

/* What is given of all that is asked where the heat is such a share of its limit: nothing at the limit itself. */
static float given_at(float warmth) {
    const float room = 64.0f * (1.0f - warmth);
    return room > 0.0f ? within(room, 1.0f) : 0.0f;
}

/* A sample later, `share` being what is lost in it over what is lost at the limit; rounded to the warm side. */
static uint32_t warmed(uint32_t heat, float share) {
    const uint32_t limit = UINT32_C(1) << 31;
    const float more = share * (2147483648.0f / constant_samples);
    heat -= heat >> PADGEN_HEAT_SHIFT;
    if (more > 0.0f) heat += more < 1073741824.0f ? (uint32_t)more + 1 : UINT32_C(1) << 30;
    return heat < limit ? heat : limit;
}

/* Take back what a coil does not bear of a voltage, and follow its current and heat, as if the converter held the voltage
 * for the sample. Warmth w is heat h and the field's energy, both over what is lost at the limit P in a time constant T:
 * it grows by the electrical energy v i dt / (P T) and falls by h dt / T. A sample brings at most |v| max|i| dt, which
 * `room_w` keeps below (1 - w) P T: so w, and with it the heat, never goes beyond 1. */
static float bear(padgen_drive *drive, unsigned coil, float volts, float pad_share, float pad_room_w) {
    const float before = drive->current_a[coil], share = given_at(drive->warmth[coil]);
    const float least = share < pad_share ? share : pad_share;
    const float coil_room_w = (1.0f - drive->warmth[coil]) * coil_limit_w * constant_samples;
    const float room_w = coil_room_w < pad_room_w ? coil_room_w : pad_room_w;
    /* Voltages that bring the current to its limits within the sample. */
    const float above = PADGEN_RESISTANCE_OHM * before + (PADGEN_CURRENT_LIMIT_A - before) * ohm_rise;
    const float below = PADGEN_RESISTANCE_OHM * before - (PADGEN_CURRENT_LIMIT_A + before) * ohm_rise;
    float most_w, after, lost_w, field_w;
    volts = least * within(volts, PADGEN_VOLTAGE_LIMIT_V);
    if (volts > above) volts = above;
    if (volts < below) volts = below;
    after = (volts < 0.0f ? -volts : volts) * (1.0f / ohm_rise);
    most_w = (volts < 0.0f ? -volts : volts) * ((before < 0.0f ? -before : before) + after);
    if (most_w > room_w) volts *= room_w > 0.0f ? room_w / most_w : 0.0f;
    after = before + (volts * (1.0f / PADGEN_RESISTANCE_OHM) - before) * PADGEN_CURRENT_RISE;
    if (after < 1e-18f && after > -1e-18f) after = 0.0f;
    lost_w = PADGEN_RESISTANCE_OHM * (PADGEN_SQUARE_AFTER * after * after + PADGEN_SQUARE_BOTH * after * before +
                                      PADGEN_SQUARE_BEFORE * before * before);
    field_w = after * after * (PADGEN_INDUCTANCE_H * (float)PADGEN_RATE_HZ / 2.0f / constant_samples);
    drive->current_a[coil] = after;
    drive->heat[coil] = warmed(drive->heat[coil], lost_w * (1.0f / coil_limit_w));
    drive->warmth[coil] = (float)drive->heat[coil] / 2147483648.0f + field_w * (1.0f / coil_limit_w);
    drive->lost_w += lost_w;
    drive->field_w += field_w;
    if (least < drive->given) drive->given = least;
    return volts;
}

/* Whether the main program is there: from 1 to 0 in a ramp where it is not, and back. */
static float awake(padgen_drive *drive) {
    const float step = 1.0f / (float)PADGEN_RAMP_SAMPLES;
    if (drive->away < PADGEN_WATCHDOG_SAMPLES) drive->away++;
    if (drive->away < PADGEN_WATCHDOG_SAMPLES) return within(drive->awake + step, 1.0f);
    return drive->awake > step ? drive->awake - step : 0.0f;
}

/* The next sample of a sweep, whose frequency and amplitude are straight between the table's rows. */
static float swept(padgen_drive *drive) {
    const float rows = (float)(PADGEN_SWEEP_ROWS - 1) / (float)PADGEN_SWEEP_SAMPLES;
    const float at = rows * (float)(PADGEN_SWEEP_SAMPLES - drive->sweep_left);
    const unsigned row = at < (float)(PADGEN_SWEEP_ROWS - 2) ? (unsigned)at : PADGEN_SWEEP_ROWS - 2;
    const float *here = padgen_sweep[row], *next = padgen_sweep[row + 1], share = at - (float)row;
    const float volts = (here[1] + share * (next[1] - here[1])) * drive->sweep_gain * sine(drive->sweep_phase);
    drive->sweep_phase += (uint32_t)(4294967296.0f / PADGEN_RATE_HZ * (here[0] + share * (next[0] - here[0])));
    drive->sweep_left--;
    if (drive->sweep_stops) drive->sweep_gain -= 50.0f / PADGEN_RATE_HZ;
    if (drive->sweep_gain <= 0.0f) drive->sweep_left = 0;
    return volts;
}

void padgen_next(padgen_drive *drive, float volts[PADGEN_COILS]) {
    unsigned kind, coil;
    float share, room_w;
    if (drive->rest > 0 || drive->faults) {
        for (coil = 0; coil < PADGEN_COILS; coil++) volts[coil] = 0.0f;
        if (drive->rest > 0) drive->rest--;
        return;
    }
    turn_over(drive);
    if (drive->silent) {
        for (coil = 0; coil < PADGEN_COILS; coil++) volts[coil] = 0.0f;
        if (drive->sweep_left) volts[drive->sweep_coil] = swept(drive);
    } else {
        const blends now = blend_now(drive);
        for (kind = 0; kind < PADGEN_KINDS; kind++) make_waves(drive, kind);
#if PADGEN_HAS_CARRIER
        drive->carrier[0] = sine(drive->carrier_phase + UINT32_C(0x40000000));
        drive->carrier[1] = -turn * PADGEN_CARRIER_HZ * sine(drive->carrier_phase);
#endif
        for (coil = 0; coil < PADGEN_COILS; coil++) {
            const moving i = current(drive, coil, &now);
            volts[coil] = PADGEN_RESISTANCE_OHM * i.value + PADGEN_INDUCTANCE_H * i.slope;
        }
    }
    drive->awake = awake(drive);
    share = given_at(drive->pad_warmth);
    if (drive->awake < share) share = drive->awake;
    room_w = (1.0f - drive->pad_warmth) * pad_limit_w * constant_samples / (float)PADGEN_COILS;
    drive->given = 1.0f;
    drive->lost_w = drive->field_w = 0.0f;
    for (coil = 0; coil < PADGEN_COILS; coil++) volts[coil] = bear(drive, coil, volts[coil], share, room_w);
    drive->pad_heat = warmed(drive->pad_heat, drive->lost_w / pad_limit_w);
    drive->pad_warmth = (float)drive->pad_heat / 2147483648.0f + drive->field_w / pad_limit_w;
    step_phases(drive);
}

/* ---- Start ----------------------------------------------------------------------------------------------- */

uint32_t padgen_crc32(uint32_t before, const void *bytes, size_t count) {
    static const uint32_t table[16] = { /* four bits at a time */
        UINT32_C(0x00000000), UINT32_C(0x1db71064), UINT32_C(0x3b6e20c8), UINT32_C(0x26d930ac),
        UINT32_C(0x76dc4190), UINT32_C(0x6b6b51f4), UINT32_C(0x4db26158), UINT32_C(0x5005713c),
        UINT32_C(0xedb88320), UINT32_C(0xf00f9344), UINT32_C(0xd6d6a3e8), UINT32_C(0xcb61b38c),
        UINT32_C(0x9b64c2b0), UINT32_C(0x86d3d2d4), UINT32_C(0xa00ae278), UINT32_C(0xbdbdf21c),
    };
    const uint8_t *at = bytes;
    uint32_t rest = ~before;
    while (count--) {
        rest ^= *at++;
        rest = table[rest & 15] ^ (rest >> 4);
        rest = table[rest & 15] ^ (rest >> 4);
    }
    return ~rest;
}

/* All at such a share of 2^31 of their heat, and without current. */
static void set_heat(padgen_drive *drive, uint32_t heat) {
    unsigned coil;
    memset(drive->current_a, 0, sizeof drive->current_a);
    for (coil = 0; coil < PADGEN_COILS; coil++) {
        drive->heat[coil] = heat;
        drive->warmth[coil] = (float)heat / 2147483648.0f;
    }
    drive->pad_heat = heat;
    drive->pad_warmth = (float)heat / 2147483648.0f;
}

static int near(float value, float wanted) { return value - wanted < 1e-5f && wanted - value < 1e-5f; }

/* What is volatile here the compiler cannot work out beforehand, nor with options by which nothing is no number. */
static uint8_t self_test(padgen_drive *drive) {
    static const float limit_v = PADGEN_VOLTAGE_LIMIT_V;
    volatile uint32_t last = UINT32_MAX;
    volatile float huge = 3e38f, two = 2.0f, none;
    uint32_t sum = 0;
    uint8_t faults = 0;
    float first, after;
#define PADGEN_SUM(table) sum = padgen_crc32(sum, table, sizeof table);
    PADGEN_TABLES(PADGEN_SUM)
    if (sum != PADGEN_TABLES_CRC) faults |= PADGEN_TABLES_FAULT;

    none = huge * huge;
    if (within(none, limit_v) != limit_v || padgen_code(-none, 1.0f, 16) != -32767) faults |= PADGEN_CLAMP_FAULT;
    none -= none;
    if (within(none, limit_v) != 0.0f || padgen_code(none, 1.0f, 16) != 0) faults |= PADGEN_CLAMP_FAULT;
    set_heat(drive, UINT32_C(1) << 31);
    if (bear(drive, 0, huge, 1.0f, huge) != 0.0f) faults |= PADGEN_CLAMP_FAULT;
    if (drive->heat[0] != (UINT32_C(1) << 31) - (UINT32_C(1) << (31 - PADGEN_HEAT_SHIFT)))
        faults |= PADGEN_ARITHMETIC_FAULT;
    set_heat(drive, 0);
    first = bear(drive, 0, huge, 1.0f, huge);
    after = drive->current_a[0];
    if (!(first > 0.0f && first <= limit_v && after > 0.0f && after <= 1.000001f * PADGEN_CURRENT_LIMIT_A))
        faults |= PADGEN_CLAMP_FAULT;
    if (drive->heat[0] == 0 || drive->warmth[0] > 1.0001f) faults |= PADGEN_ARITHMETIC_FAULT;
    if (last + 1 != 0 || !near(sqrtf(two) * sqrtf(two), 2.0f)) faults |= PADGEN_ARITHMETIC_FAULT;
    if (!near(sine(last / 4 + 1), 1.0f) || !near(sine(last / 4 * 3 + 3), -1.0f) || !near(sine(last / 8), 0.70710678f))
        faults |= PADGEN_ARITHMETIC_FAULT;
    return faults;
}

void padgen_start(padgen_drive *drive) {
    uint8_t faults;
    memset(drive, 0, sizeof *drive);
    faults = self_test(drive);
    memset(drive, 0, sizeof *drive);
    drive->faults = faults;
    drive->to = 1;
    drive->next = 2;
    drive->step = PADGEN_STEP_SAMPLES;
    drive->silent = 1;
    drive->rest = PADGEN_START_SAMPLES;
    drive->awake = drive->given = 1.0f;
    set_heat(drive, UINT32_C(63) << 25);
    restart_phases(drive);
}

/* See padgen_protocol.h and docs/protocol.md. */
#include "padgen_protocol.h"

#include <string.h>

enum { HELLO = 1, FRAME = 2, FRAME_BITS = 3, SILENCE = 4, PING = 5, EXCITE = 6, GREETING = 129, ACK = 130, NAK = 131 };
enum { DAMAGED = 1, VERSION = 2, KIND = 3, LENGTH = 4, STRANGER = 5, DUPLICATE = 6, ORDER = 7, BUSY = 8, FAULT = 9 };
enum { HEAD = 4, TAIL = 4, GREETING_BYTES = 37, LONGEST_ANSWER = HEAD + GREETING_BYTES + TAIL };

static uint8_t *put(uint8_t *at, uint32_t value, unsigned bytes) {
    while (bytes--) {
        *at++ = (uint8_t)value;
        value >>= 8;
    }
    return at;
}

static uint32_t get(const uint8_t *at, unsigned bytes) {
    uint32_t value = 0;
    while (bytes--) value = value << 8 | at[bytes];
    return value;
}

/* ---- Answers --------------------------------------------------------------------------------------------- */

/* Send a packet whose payload is in place: answers are shorter than a block of the stuffing. */
static void send_packet(padgen_link *link, uint8_t *packet, unsigned payload, unsigned kind, uint32_t sequence) {
    uint8_t line[LONGEST_ANSWER + 3];
    size_t count = HEAD + payload, mark = 1, k;
    packet[0] = PADGEN_PROTOCOL_VERSION;
    packet[1] = (uint8_t)kind;
    put(packet + 2, sequence, 2);
    put(packet + count, padgen_crc32(0, packet, count), 4);
    count += TAIL;
    line[0] = 0;
    for (k = 0; k < count; k++) {
        line[k + 2] = packet[k];
        if (packet[k] == 0) {
            line[mark] = (uint8_t)(k + 2 - mark);
            mark = k + 2;
        }
    }
    line[mark] = (uint8_t)(count + 2 - mark);
    line[count + 2] = 0;
    link->send(link->context, line, count + 3);
}

static void acknowledge(padgen_link *link, unsigned kind, uint32_t sequence) {
    const padgen_drive *drive = link->drive;
    uint8_t packet[LONGEST_ANSWER];
    uint32_t most = 0;
    unsigned coil;
    for (coil = 0; coil < PADGEN_COILS; coil++)
        if (drive->heat[coil] > most) most = drive->heat[coil];
    packet[HEAD] = (uint8_t)kind;
    packet[HEAD + 1] = (uint8_t)padgen_state(drive);
    packet[HEAD + 2] = drive->faults;
    packet[HEAD + 3] = (uint8_t)((most >> 16) * 255 >> 15);
    packet[HEAD + 4] = (uint8_t)(drive->given * 255.0f);
    send_packet(link, packet, 5, ACK, sequence);
}

static void refuse(padgen_link *link, unsigned kind, uint32_t sequence, unsigned reason) {
    uint8_t packet[LONGEST_ANSWER];
    packet[HEAD] = (uint8_t)kind;
    packet[HEAD + 1] = (uint8_t)reason;
    put(packet + HEAD + 2, link->next_sequence, 2);
    send_packet(link, packet, 4, NAK, sequence);
}

static uint32_t parts_of_s(uint64_t samples, uint32_t parts) {
    return (uint32_t)((samples * parts + PADGEN_RATE_HZ - 1) / PADGEN_RATE_HZ);
}

static void greet(padgen_link *link, uint32_t sequence) {
    const uint64_t longest = (uint64_t)PADGEN_STEP_SAMPLES * (PADGEN_TAKES_TURNS ? 1 : 2);
    const uint64_t least = (uint64_t)PADGEN_STEP_SAMPLES * (PADGEN_TAKES_TURNS ? PADGEN_SLOTS : 1);
    uint8_t packet[LONGEST_ANSWER], *at = packet + HEAD;
    memcpy(at, padgen_plan_hash, 8);
    at = put(at + 8, PADGEN_TAXELS, 2);
    at = put(at, PADGEN_COILS, 2);
    at = put(at, PADGEN_CHANNELS, 1);
    at = put(at, PADGEN_SCHEME, 1);
    at = put(at, link->next_sequence, 2);
    at = put(at, PADGEN_RATE_HZ, 4);
    at = put(at, parts_of_s(PADGEN_FRAME_SAMPLES, 1000000), 4);
    at = put(at, parts_of_s(least, 1000000), 4);
    at = put(at, parts_of_s(PADGEN_WATCHDOG_SAMPLES, 1000), 4);
    at = put(at, parts_of_s(longest, 1000), 4);
    *at++ = link->drive->faults;
    send_packet(link, packet, (unsigned)(at - packet) - HEAD, GREETING, sequence);
}

/* ---- Messages -------------------------------------------------------------------------------------------- */

/* A frame is shown as a whole or not at all, and each once: that of the sequence number which is due. */
static void frame(padgen_link *link, unsigned kind, uint16_t sequence, const uint8_t *payload, unsigned count) {
    const unsigned due = kind == FRAME ? PADGEN_TAXELS : PADGEN_SIGN_BYTES;
    const uint16_t behind = (uint16_t)(link->next_sequence - sequence);
    uint8_t level[PADGEN_TAXELS], turned[PADGEN_SIGN_BYTES] = {0};
    unsigned k;
    if (link->drive->faults) {
        refuse(link, kind, sequence, FAULT);
    } else if (!link->greeted) {
        refuse(link, kind, sequence, STRANGER);
    } else if (count != due && count != due + PADGEN_SIGN_BYTES) {
        refuse(link, kind, sequence, LENGTH);
    } else if (behind != 0) {
        refuse(link, kind, sequence, behind < 0x8000 ? DUPLICATE : ORDER);
    } else {
        for (k = 0; k < PADGEN_TAXELS; k++)
            level[k] = kind == FRAME ? payload[k] : (uint8_t)(payload[k / 8] >> k % 8 & 1 ? 255 : 0);
        if (count > due) memcpy(turned, payload + due, PADGEN_SIGN_BYTES);
        if (!padgen_show_signed(link->drive, level, turned)) {
            refuse(link, kind, sequence, BUSY);
            return;
        }
        link->next_sequence++;
        link->held = 0;
        acknowledge(link, kind, sequence);
    }
}

static void hello(padgen_link *link, uint16_t sequence, const uint8_t *payload, unsigned count) {
    if (count < 8) {
        refuse(link, HELLO, sequence, LENGTH);
        return;
    }
    link->greeted = memcmp(payload, padgen_plan_hash, 8) == 0;
    if (!link->greeted) padgen_silence(link->drive);
    greet(link, sequence);
}

static void excite(padgen_link *link, uint16_t sequence, const uint8_t *payload, unsigned count) {
    if (link->drive->faults) {
        refuse(link, EXCITE, sequence, FAULT);
    } else if (!link->greeted) {
        refuse(link, EXCITE, sequence, STRANGER);
    } else if (count != 2 || get(payload, 2) >= PADGEN_COILS) {
        refuse(link, EXCITE, sequence, LENGTH);
    } else if (!padgen_excite(link->drive, (uint16_t)get(payload, 2))) {
        refuse(link, EXCITE, sequence, BUSY);
    } else {
        link->held = PADGEN_HOLD_SAMPLES; /* a sweep ends by itself */
        acknowledge(link, EXCITE, sequence);
    }
}

static void message(padgen_link *link) {
    const uint8_t *packet = link->packet;
    const unsigned count = link->length;
    const unsigned kind = packet[1];
    uint16_t sequence;
    if (link->broken || link->left || count < HEAD + TAIL ||
        get(packet + count - TAIL, 4) != padgen_crc32(0, packet, count - TAIL)) {
        refuse(link, 0, 0, DAMAGED);
        return;
    }
    sequence = (uint16_t)get(packet + 2, 2);
    if (packet[0] != PADGEN_PROTOCOL_VERSION) {
        refuse(link, kind, sequence, VERSION);
        return;
    }
    link->quiet = 0;
    if (kind == HELLO) {
        hello(link, sequence, packet + HEAD, count - HEAD - TAIL);
    } else if (kind == FRAME || kind == FRAME_BITS) {
        frame(link, kind, sequence, packet + HEAD, count - HEAD - TAIL);
    } else if (kind == EXCITE) {
        excite(link, sequence, packet + HEAD, count - HEAD - TAIL);
    } else if (kind == SILENCE || kind == PING) {
        if (kind == SILENCE) padgen_silence(link->drive);
        acknowledge(link, kind, sequence);
    } else {
        refuse(link, kind, sequence, KIND);
    }
}

/* ---- Bytes ----------------------------------------------------------------------------------------------- */

static void clear(padgen_link *link) {
    link->length = 0;
    link->left = link->full = link->begun = link->broken = 0;
}

static void store(padgen_link *link, uint8_t byte) {
    if (link->length < PADGEN_LONGEST)
        link->packet[link->length++] = byte;
    else
        link->broken = 1;
}

void padgen_link_byte(padgen_link *link, uint8_t byte) {
    if (byte == 0) { /* the end of a packet, whatever came before */
        if (link->begun) message(link);
        clear(link);
    } else if (link->left) {
        link->left--;
        store(link, byte);
    } else { /* a block's first byte: how far it is to the next zero */
        if (link->begun && !link->full) store(link, 0);
        link->begun = 1;
        link->left = (uint8_t)(byte - 1);
        link->full = byte == 255;
    }
}

/* Count samples up to `most`; whether it is reached now. */
static int runs_out(uint32_t *count, uint32_t samples, uint32_t most) {
    const uint32_t left = most - *count;
    *count = samples < left ? *count + samples : most;
    return left > 0 && *count == most;
}

void padgen_link_tick(padgen_link *link, uint32_t samples) {
    const int lost = runs_out(&link->quiet, samples, PADGEN_WATCHDOG_SAMPLES);
    const int stale = runs_out(&link->held, samples, PADGEN_HOLD_SAMPLES);
    padgen_attend(link->drive);
    if (lost || stale) padgen_silence(link->drive);
}

void padgen_link_start(padgen_link *link, padgen_drive *drive, padgen_send send, void *context) {
    memset(link, 0, sizeof *link);
    link->drive = drive;
    link->send = send;
    link->context = context;
}

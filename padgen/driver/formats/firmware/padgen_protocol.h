/* The serial protocol of a pad, byte by byte (docs/protocol.md). All of it runs in the main program. */
#ifndef PADGEN_PROTOCOL_H
#define PADGEN_PROTOCOL_H

#include <stddef.h>
#include <stdint.h>

#include "padgen_drive.h"

#ifdef __cplusplus
extern "C" {
#endif

#define PADGEN_PROTOCOL_VERSION 1
#define PADGEN_LONGEST (PADGEN_TAXELS + PADGEN_SIGN_BYTES + 16) /* bytes of the longest packet that is understood, unstuffed */

typedef void (*padgen_send)(void *context, const uint8_t *bytes, size_t count);

typedef struct {
    padgen_drive *drive;
    padgen_send send;
    void *context;
    uint8_t packet[PADGEN_LONGEST];
    uint16_t length; /* bytes of the packet so far */
    uint8_t left; /* bytes to the end of the present block */
    uint8_t full; /* the block has 254 bytes, so that no zero follows it */
    uint8_t begun, broken;
    uint8_t greeted; /* the computer has named this pad */
    uint16_t next_sequence;
    uint32_t quiet; /* samples since the last valid message */
    uint32_t held; /* samples since the last frame that was accepted */
} padgen_link;

/* Begin; `send` is called with the bytes of every answer. */
void padgen_link_start(padgen_link *link, padgen_drive *drive, padgen_send send, void *context);

/* One byte came over the line. */
void padgen_link_byte(padgen_link *link, uint8_t byte);

/* So many samples have passed: without a valid message for PADGEN_WATCHDOG_SAMPLES, or without a new frame for
 * PADGEN_HOLD_SAMPLES whatever else comes, the pad falls silent. */
void padgen_link_tick(padgen_link *link, uint32_t samples);

#ifdef __cplusplus
}
#endif

#endif

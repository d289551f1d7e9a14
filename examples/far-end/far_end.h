/* The far end of valves and beam: it obeys the datagrams of stillpoint while they are valid, and else takes the safe state.
 *
 * C99, the C library alone, no allocation, no clock of its own: times are ns since the epoch, come from the caller,
 * and must never go back: count on a monotone clock from one reading of the time of day.
 * The bytes of orders and acknowledgements are in docs/reference/datagrams.md.
 *
 *     fe_far_end far;
 *     fe_begin(&far, key, 6, FE_VENT, FE_CLOCKS_WITHIN, FE_RAMP);
 *     for (;;) {
 *         // each datagram that has arrived, of either port
 *         fe_receive(&far, bytes, count, now);
 *         // every 2 ms
 *         fe_doing doing = fe_step(&far, now);
 *     }
 */
#ifndef FAR_END_H
#define FAR_END_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    FE_VALVES = 16,   /* valves that an order has room for */
    FE_PRESSURES = 8, /* pressures that an acknowledgement has room for */
    FE_KEY = 32,      /* bytes of a key */
    FE_CODE = 32,     /* bytes of an authentication code */
    FE_ORDER = 52,    /* bytes of an order before its duties */
    FE_ACKNOWLEDGEMENT = 88,
    FE_LONGEST_ORDER = FE_ORDER + 4 * FE_VALVES + FE_CODE,
    FE_LONGEST_ACKNOWLEDGEMENT = FE_ACKNOWLEDGEMENT + 4 * FE_PRESSURES + FE_CODE,
    FE_CLOCKS_WITHIN = 5000000, /* ns by which the clocks of both ends may differ */
    FE_RAMP = 100000000,        /* ns in which duties grow from zero after silence */
};

/* Why a datagram is refused; FE_ACCEPTED where it is not. The order is that in which stillpoint counts. */
typedef enum {
    FE_TOO_SHORT,
    FE_TOO_LONG,
    FE_FOREIGN,
    FE_VERSION,
    FE_LENGTH,
    FE_FORGED,
    FE_MALFORMED,
    FE_NOT_FINITE,
    FE_OUT_OF_RANGE,
    FE_LIFE,
    FE_RECIPIENT,
    FE_OTHER_VALVES,
    FE_LATE,
    FE_EARLY,
    FE_REPEATED,
    FE_OLD,
    FE_OLD_SESSION,
    FE_SECOND_SENDER,
    FE_IN_MOTION,
    FE_ACCEPTED,
} fe_result;

/* The name of a result, as stillpoint prints it. */
const char *fe_name(fe_result result);

typedef enum { FE_FOR_VALVES = 1, FE_FOR_BEAM = 2 } fe_recipient;

/* Hold: all valves shut, or the beam off. Vent: inlets shut, outlets open. Follow: the duties, or the beam on. */
typedef enum { FE_HOLD, FE_VENT, FE_FOLLOW } fe_order;

/* What a datagram says. */
typedef struct {
    fe_recipient recipient;
    fe_order order;
    fe_order safe; /* FE_HOLD or FE_VENT, when no datagram is valid */
    uint64_t started, nonce; /* session of the sender */
    uint64_t sequence;
    uint64_t stamp; /* ns */
    uint64_t life;  /* ns */
    uint32_t reasons;
    uint8_t valves;
    float duty[FE_VALVES]; /* 0 to 1; zero beyond `valves` */
} fe_message;

/* Reads an order: its form first, then its code, then its content. The message is set where it is accepted. */
fe_result fe_decode(const uint8_t *bytes, size_t count, const uint8_t key[FE_KEY], fe_message *message);

/* Takes the datagrams for valves or for the beam. */
typedef struct {
    fe_recipient recipient;
    uint8_t valves;
    fe_order idle;    /* before the first datagram */
    uint64_t within;  /* ns */
    uint64_t ramp;    /* ns */
    bool has_last;
    fe_message last;
    uint64_t ends;  /* when the life of the last is over, ns */
    uint64_t since; /* since when there was no silence, ns */
    uint64_t accepted, missing, in_session, sessions;
    uint64_t refused[FE_ACCEPTED];
} fe_receiver;

/* Valves and beam, locked to each other. */
typedef struct {
    uint8_t key[FE_KEY];
    fe_receiver valves, beam;
    bool was_on;
} fe_far_end;

/* What is to be done until the next step. */
typedef struct {
    fe_order valves;
    float duty[FE_VALVES]; /* inlet and outlet of the first bladder, of the second, ...: for FE_FOLLOW */
    bool beam;
} fe_doing;

/* A far end with so many valves, in its idle state. */
void fe_begin(fe_far_end *far, const uint8_t key[FE_KEY], uint8_t valves, fe_order idle, uint64_t within, uint64_t ramp);

/* Takes a datagram that arrived at a time, ns. A refusal is counted and changes nothing else. */
fe_result fe_receive(fe_far_end *far, const uint8_t *bytes, size_t count, uint64_t arrival);

/* What is to be done from now on. The beam is on only while its lease is valid and the valves follow. Before valves vent,
 * they hold for one step, so that the beam is off first. */
fe_doing fe_step(fe_far_end *far, uint64_t now);

/* Writes an acknowledgement and returns its length. `started` and `nonce` are the session of this far end, `number` grows by
 * one. Pressures are those over the room, Pa; if one is not finite, all are left out. */
size_t fe_acknowledge(const fe_far_end *far, const fe_doing *doing, uint64_t started, uint64_t nonce, uint64_t number,
                      uint64_t now, const float *pressure, uint8_t bladders,
                      uint8_t bytes[FE_LONGEST_ACKNOWLEDGEMENT]);

/* Reads the 64 hexadecimal digits of a key file; lines that begin with # are comments. False where they are not a key. */
bool fe_parse_key(const char *text, size_t count, uint8_t key[FE_KEY]);

#endif

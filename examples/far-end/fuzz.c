/* Feeds the far end 10,000 datagrams that are random, changed, cut, spliced, or changed and sealed again with the key, and
 * looks after each whether the state is a valid one. Ends with 0 if it always was. Arguments: how many, and the seed. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "far_end.h"
#include "sha256.h"

static uint64_t state;

static uint64_t draw(uint64_t below) /* splitmix64 */
{
    uint64_t z = (state += 0x9e3779b97f4a7c15u);
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return (z ^ z >> 31) % below;
}

static void put(uint8_t *bytes, uint64_t value, int count)
{
    for (int i = 0; i < count; i++, value >>= 8)
        bytes[i] = (uint8_t)value;
}

static void seal(uint8_t *bytes, size_t count, const uint8_t *key)
{
    if (count >= FE_CODE)
        hmac_sha256(key, FE_KEY, bytes, count - FE_CODE, bytes + count - FE_CODE);
}

/* An order that is well formed. */
static size_t order(uint8_t *bytes, uint64_t now, uint64_t sequence, const uint8_t *key)
{
    bool beam = draw(3) == 0;
    uint8_t what = (uint8_t)(beam ? 2 * draw(2) : draw(3)), valves = beam ? 0 : (uint8_t)(draw(9) ? 6 : draw(17));
    memset(bytes, 0, FE_LONGEST_ORDER);
    memcpy(bytes, "SPDG\1", 5);
    bytes[5] = beam ? 2 : 1;
    bytes[6] = what;
    bytes[7] = beam ? 0 : (uint8_t)draw(2);
    put(bytes + 8, 1000 + sequence / 64 - draw(50) / 49, 8);
    put(bytes + 24, draw(8) ? sequence : draw(sequence + 9), 8);
    put(bytes + 32, now - draw(20) * 1000000, 8);
    put(bytes + 40, draw(8) ? 60000 : draw(2000000), 4);
    bytes[48] = valves;
    for (int i = 0; i < valves && what == 2; i++) {
        float duty = (float)draw(1001) / 1000;
        memcpy(bytes + FE_ORDER + 4 * i, &duty, sizeof duty);
    }
    size_t count = (size_t)FE_ORDER + 4u * valves + FE_CODE;
    seal(bytes, count, key);
    return count;
}

static int wrong(const char *what, long k)
{
    printf("datagram %ld: %s\n", k, what);
    return 1;
}

int main(int count, char **arguments)
{
    long most = count > 1 ? atol(arguments[1]) : 10000, accepted = 0;
    state = count > 2 ? strtoull(arguments[2], NULL, 10) : 1;
    uint8_t key[FE_KEY], bytes[FE_LONGEST_ORDER + 64];
    for (int i = 0; i < FE_KEY; i++)
        key[i] = (uint8_t)draw(256);
    uint64_t now = 1000000000000u;
    fe_far_end far;
    fe_begin(&far, key, 6, FE_VENT, FE_CLOCKS_WITHIN, FE_RAMP);
    for (long k = 0; k < most; k++) {
        bool untouched = false;
        /* A sound order of a session that started in the year 2500 ends all others: so the far end begins anew. */
        if (k % 256 == 0)
            fe_begin(&far, key, 6, FE_VENT, FE_CLOCKS_WITHIN, FE_RAMP);
        size_t size = order(bytes, now, (uint64_t)k, key);
        switch (draw(6)) {
        case 0: /* noise */
            size = (size_t)draw(sizeof bytes + 1);
            for (size_t i = 0; i < size; i++)
                bytes[i] = (uint8_t)draw(256);
            break;
        case 1: /* one bit */
            bytes[draw(size)] ^= (uint8_t)(1u << draw(8));
            break;
        case 2: /* cut, or longer */
            size = (size_t)draw(sizeof bytes + 1);
            break;
        case 3: /* what a holder of the key may send by mistake */
            for (uint64_t n = 1 + draw(3); n > 0; n--)
                bytes[draw(size - FE_CODE)] = (uint8_t)draw(256);
            seal(bytes, size, key);
            break;
        default:
            untouched = true;
        }
        /* A copy without room behind it: a read beyond its end is seen by the sanitizer. */
        uint8_t *exact = malloc(size ? size : 1);
        if (!exact)
            return wrong("no memory", k);
        memcpy(exact, bytes, size);
        fe_far_end before = far;
        fe_result result = fe_receive(&far, exact, size, now);
        free(exact);
        if (result > FE_ACCEPTED || (untouched && (result < FE_LIFE || result == FE_MALFORMED)))
            return wrong("a sound datagram has a fault of form", k);
        if (result != FE_ACCEPTED) {
            fe_far_end changed = far;
            memcpy(changed.valves.refused, before.valves.refused, sizeof before.valves.refused);
            memcpy(changed.beam.refused, before.beam.refused, sizeof before.beam.refused);
            if (memcmp(&changed, &before, sizeof before) != 0)
                return wrong("a refusal changed the state", k);
        }
        accepted += result == FE_ACCEPTED;
        now += draw(12) * 1000000;
        bool was_on = far.was_on;
        fe_doing doing = fe_step(&far, now);
        if (doing.valves > FE_FOLLOW || (doing.beam && doing.valves != FE_FOLLOW))
            return wrong("the beam is on while the valves do not follow", k);
        if (was_on && doing.valves == FE_VENT)
            return wrong("the valves vent in the step in which the beam ends", k);
        for (int i = 0; i < FE_VALVES; i++)
            if (!(doing.duty[i] >= 0 && doing.duty[i] <= 1) || (i >= 6 && doing.duty[i] != 0))
                return wrong("a duty is out of range", k);
        if (doing.valves == FE_FOLLOW && now >= far.valves.ends)
            return wrong("an order is followed after its life", k);
        uint8_t out[FE_LONGEST_ACKNOWLEDGEMENT];
        float pressure[3] = {0, 1e3f, (float)draw(100000)};
        size_t length = fe_acknowledge(&far, &doing, 1, 2, (uint64_t)k, now, pressure, 3, out);
        if (length != FE_ACKNOWLEDGEMENT + 12 + FE_CODE)
            return wrong("an acknowledgement has another length", k);
    }
    printf("%ld datagrams, %ld accepted, the state was valid after each\n", most, accepted);
    return accepted == 0;
}

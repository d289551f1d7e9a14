/* Runs a script on the far end and prints what it does: one line for each command.
 *
 *     hmac KEY MESSAGE                            the code of a message, hexadecimal
 *     key KEY                                     the key of all that follows, 64 digits
 *     decode DATAGRAM                             the fields of an order, or why it is refused
 *     begin VALVES IDLE WITHIN RAMP               a far end; IDLE is hold or vent, times are ns
 *     receive ARRIVAL DATAGRAM                    accepted, or why it is refused
 *     step NOW                                    what valves and beam do; duties as the bits of their numbers
 *     acknowledge NOW STARTED NONCE NUMBER BITS.. the acknowledgement, hexadecimal; bits of pressures
 *     counts                                      accepted, missing and sessions of the valves, then all refusals
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "far_end.h"
#include "sha256.h"

enum { MOST = 512, WORDS = 16 };

static const char *const ORDERS[] = {"hold", "vent", "follow"};

static size_t bytes_of(const char *text, uint8_t bytes[MOST])
{
    size_t count = 0;
    for (unsigned byte; count < MOST && sscanf(text + 2 * count, "%2x", &byte) == 1; count++)
        bytes[count] = (uint8_t)byte;
    return count;
}

static void print(const uint8_t *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        printf("%02x", bytes[i]);
    puts("");
}

static void print_numbers(const float *numbers, int count)
{
    for (int i = 0; i < count; i++) {
        uint32_t bits;
        memcpy(&bits, &numbers[i], sizeof bits);
        printf(" %08" PRIx32, bits);
    }
}

static uint64_t whole(const char *text) { return strtoull(text ? text : "0", NULL, 10); }

int main(void)
{
    static char line[4096];
    static fe_far_end far;
    static fe_doing doing;
    uint8_t key[FE_KEY] = {0}, bytes[MOST];
    while (fgets(line, sizeof line, stdin)) {
        const char *word[WORDS] = {0};
        int count = 0;
        for (char *at = strtok(line, " \n"); at && count < WORDS; at = strtok(NULL, " \n"))
            word[count++] = at;
        if (count == 0 || word[0][0] == '#')
            continue;
        if (strcmp(word[0], "hmac") == 0 && count >= 2) {
            uint8_t long_key[MOST], code[SHA256_SIZE];
            size_t size = bytes_of(word[1], long_key), length = count > 2 ? bytes_of(word[2], bytes) : 0;
            hmac_sha256(long_key, size, bytes, length, code);
            print(code, sizeof code);
        } else if (strcmp(word[0], "key") == 0 && count == 2) {
            puts(fe_parse_key(word[1], strlen(word[1]), key) ? "a key" : "not a key");
        } else if (strcmp(word[0], "decode") == 0) {
            fe_message m;
            fe_result result = fe_decode(bytes, count > 1 ? bytes_of(word[1], bytes) : 0, key, &m);
            if (result != FE_ACCEPTED) {
                printf("refused %s\n", fe_name(result));
                continue;
            }
            printf("%s %s safe %s session %" PRIu64 " %" PRIu64, m.recipient == FE_FOR_BEAM ? "beam" : "valves",
                   ORDERS[m.order], ORDERS[m.safe], m.started, m.nonce);
            printf(" sequence %" PRIu64 " stamp %" PRIu64 " life %" PRIu64 " reasons %" PRIu32 " duties", m.sequence, m.stamp,
                   m.life, m.reasons);
            print_numbers(m.duty, m.valves);
            puts("");
        } else if (strcmp(word[0], "begin") == 0 && count == 5) {
            fe_order idle = strcmp(word[2], "vent") == 0 ? FE_VENT : FE_HOLD;
            fe_begin(&far, key, (uint8_t)whole(word[1]), idle, whole(word[3]), whole(word[4]));
            puts("begun");
        } else if (strcmp(word[0], "receive") == 0 && count >= 2) {
            puts(fe_name(fe_receive(&far, bytes, count > 2 ? bytes_of(word[2], bytes) : 0, whole(word[1]))));
        } else if (strcmp(word[0], "step") == 0 && count == 2) {
            doing = fe_step(&far, whole(word[1]));
            printf("%s beam %s duties", ORDERS[doing.valves], doing.beam ? "on" : "off");
            print_numbers(doing.duty, far.valves.valves);
            puts("");
        } else if (strcmp(word[0], "acknowledge") == 0 && count >= 5) {
            float pressure[FE_PRESSURES];
            uint8_t bladders = 0, out[FE_LONGEST_ACKNOWLEDGEMENT];
            for (; bladders < count - 5 && bladders < FE_PRESSURES; bladders++) {
                uint32_t bits = (uint32_t)strtoul(word[5 + bladders], NULL, 16);
                memcpy(&pressure[bladders], &bits, sizeof bits);
            }
            print(out, fe_acknowledge(&far, &doing, whole(word[2]), whole(word[3]), whole(word[4]), whole(word[1]), pressure,
                                      bladders, out));
        } else if (strcmp(word[0], "counts") == 0) {
            printf("%" PRIu64 " %" PRIu64 " %" PRIu64, far.valves.accepted, far.valves.missing, far.valves.sessions);
            for (int i = 0; i < FE_ACCEPTED; i++)
                printf(" %" PRIu64, far.valves.refused[i] + far.beam.refused[i]);
            puts("");
        } else {
            printf("unknown command %s\n", word[0]);
            return 2;
        }
    }
    return 0;
}

/* The far end as a program for POSIX: it takes datagrams over UDP, and prints what valves and beam are to do.
 *
 *     far-end KEY_FILE VALVES VALVES_PORT BEAM_PORT ACKNOWLEDGE_PORT
 *
 * `drive` is the place for your hardware. Acknowledgements go to this port of the host from which the last order came. */
#define _POSIX_C_SOURCE 200809L

#include <arpa/inet.h>
#include <inttypes.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "far_end.h"
#include "sha256.h"

enum { STEP = 2000000, ACKNOWLEDGE = 20000000 }; /* ns */
enum { AT_ONCE = 64 }; /* datagrams of a port between two looks at the time */

static uint64_t read_clock(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

/* The time of day at the start, and what has passed since. A clock that is set back while the program runs would make an old
 * order hold on, and refuse each new one as too early. */
static uint64_t now(void)
{
    static uint64_t wall, steady;
    if (wall == 0) {
        wall = read_clock(CLOCK_REALTIME);
        steady = read_clock(CLOCK_MONOTONIC);
    }
    return wall + (read_clock(CLOCK_MONOTONIC) - steady);
}

/* The place for your hardware: it is called at each step, since duties change from step to step. It must not wait. */
static void drive(const fe_doing *doing, uint8_t valves)
{
    (void)doing;
    (void)valves;
}

/* Says what is done, where it changes. A program that drives hardware leaves it out: a terminal that is stopped holds it up. */
static void say(const fe_doing *doing, uint8_t valves, uint64_t at)
{
    static const char *const orders[] = {"hold", "vent", "follow"};
    static int last = -1;
    int state = 2 * (int)doing->valves + doing->beam;
    if (state == last)
        return;
    last = state;
    printf("%" PRIu64 " %s beam %s", at, orders[doing->valves], doing->beam ? "on" : "off");
    for (int i = 0; doing->valves == FE_FOLLOW && i < valves; i++)
        printf(" %.3f", (double)doing->duty[i]);
    puts("");
    fflush(stdout);
}

static int listening(int port)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    int s = socket(AF_INET, SOCK_DGRAM, 0);
    if (s >= 0 && bind(s, (struct sockaddr *)&address, sizeof address) == 0)
        return s;
    perror("no datagrams can be taken at this port");
    exit(1);
}

static bool read_key(const char *path, uint8_t key[FE_KEY])
{
    char text[4096];
    struct stat about;
    FILE *file = fopen(path, "r");
    if (!file)
        return false;
    size_t count = fread(text, 1, sizeof text, file);
    bool is_private = fstat(fileno(file), &about) == 0 && (about.st_mode & 077) == 0;
    fclose(file);
    return is_private && fe_parse_key(text, count, key);
}

int main(int count, char **arguments)
{
    static fe_far_end far;
    uint8_t key[FE_KEY], code[SHA256_SIZE], bytes[FE_LONGEST_ORDER + 1], out[FE_LONGEST_ACKNOWLEDGEMENT];
    if (count != 6) {
        fprintf(stderr, "usage: far-end KEY_FILE VALVES VALVES_PORT BEAM_PORT ACKNOWLEDGE_PORT\n");
        return 2;
    }
    int valves = atoi(arguments[2]);
    if (valves < 1 || valves > FE_VALVES || !read_key(arguments[1], key)) {
        fprintf(stderr, "a key file has 64 hexadecimal digits and is yours alone (chmod 600); valves are 1 to %d\n", FE_VALVES);
        return 2;
    }
    struct pollfd ports[2] = {{listening(atoi(arguments[3])), POLLIN, 0}, {listening(atoi(arguments[4])), POLLIN, 0}};
    struct sockaddr_in sender = {0};
    fe_begin(&far, key, (uint8_t)valves, FE_VENT, FE_CLOCKS_WITHIN, FE_RAMP);
    uint64_t started = now(), stepped = 0, acknowledged = 0, number = 0, nonce;
    hmac_sha256(key, FE_KEY, &started, sizeof started, code);
    memcpy(&nonce, code, sizeof nonce);
    for (;;) {
        poll(ports, 2, 1);
        for (int k = 0; k < 2 * AT_ONCE; k++) {
            int i = k % 2;
            struct sockaddr_in from;
            socklen_t size = sizeof from;
            ssize_t got = recvfrom(ports[i].fd, bytes, sizeof bytes, MSG_DONTWAIT, (struct sockaddr *)&from, &size);
            /* A datagram that is longer than any order fills the room, and is refused for its length. */
            if (got >= 0 && fe_receive(&far, bytes, (size_t)got, now()) == FE_ACCEPTED && i == 0)
                sender = from;
        }
        uint64_t at = now();
        if (at - stepped < STEP)
            continue;
        stepped = at;
        fe_doing doing = fe_step(&far, at);
        drive(&doing, (uint8_t)valves);
        say(&doing, (uint8_t)valves, at);
        if (sender.sin_port != 0 && at - acknowledged >= ACKNOWLEDGE) {
            acknowledged = at;
            sender.sin_port = htons((uint16_t)atoi(arguments[5]));
            size_t length = fe_acknowledge(&far, &doing, started, nonce, number++, at, NULL, 0, out);
            sendto(ports[0].fd, out, length, 0, (struct sockaddr *)&sender, sizeof sender);
        }
    }
}

/* A driver of a depth camera for `ingest.driver`, in C99 and POSIX: an image of a plate that moves away by 1 mm a frame.
 *
 *     cc -std=c99 camera.c -o camera && ./camera camera.sock [IMAGES]
 */
#define _POSIX_C_SOURCE 200809L
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

enum { WIDTH = 64, HEIGHT = 48, PIXELS = WIDTH * HEIGHT, PERIOD = 33333333 /* ns */ };

/* 72 bytes and the counts, as docs/reference/driver-frames.md has them; this machine is little-endian. */
static struct {
    char beginning[4];
    uint32_t length; /* of what follows */
    uint64_t number, acquired /* ns since the epoch */;
    double fx, fy, cx, cy /* px */, depth_unit /* m */;
    uint32_t width, height;
    uint16_t counts[PIXELS]; /* row by row; 0 is no reading */
} frame = {{'S', 'P', 'F', '1'}, 64 + 2 * PIXELS, 0, 0, 60, 60, 31.5, 23.5, 1e-3, WIDTH, HEIGHT, {0}};

int main(int count, char **arguments)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const struct timespec period = {0, PERIOD};
    char answer[200] = "";
    int s = socket(AF_UNIX, SOCK_STREAM, 0);
    strncpy(address.sun_path, count > 1 ? arguments[1] : "camera.sock", sizeof address.sun_path - 1);
    if (connect(s, (struct sockaddr *)&address, sizeof address) != 0)
        return perror("nothing listens: start the pipeline first"), 1;
    for (long left = count > 2 ? atol(arguments[2]) : -1; left != 0; left--, frame.number++) {
        struct timespec now;
        clock_gettime(CLOCK_REALTIME, &now); /* as early as possible: when the camera exposed the image */
        frame.acquired = (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
        for (int i = 0; i < PIXELS; i++)
            frame.counts[i] = (uint16_t)(600 + frame.number % 100 + i % WIDTH);
        for (size_t sent = 0; sent < 72 + 2 * PIXELS;) {
            ssize_t part = send(s, (const char *)&frame + sent, 72 + 2 * PIXELS - sent, MSG_NOSIGNAL);
            if (part < 0) /* stillpoint has closed the connection, and says why */
                return fprintf(stderr, "%s", recv(s, answer, sizeof answer - 1, 0) > 0 ? answer : "it is gone\n"), 1;
            sent += (size_t)part;
        }
        nanosleep(&period, NULL);
    }
    return 0;
}

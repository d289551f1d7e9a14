/* A depth camera that is not there, for tests of examples/camera/v4l2.c: loaded before the C library (LD_PRELOAD), it answers
 * open, ioctl and poll of the path DEVICE in place of a device of V4L2. Its buffers are a file in memory, so mmap needs no help.
 * Programs may do in it what the kernel would let them: buffers that are asked for twice or not returned end the program.
 *
 * CAMERA in the environment is what it is: `whole`, `colour` (no 16-bit format), `silent` (never an image), `small` (rows that
 * are too short) or `blind` (no capture). It is unplugged when the file UNPLUGGED is there.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>
#include <linux/videodev2.h>

enum { WIDTH = 8, HEIGHT = 6, ROW = 2 * WIDTH + 16, BYTES = 4096, BUFFERS = 4, AGE = 50000000 /* ns */ };

/* The first images, by what is odd about them; those after them are as they should be. */
enum { PLAIN, FAULTY /* flagged as an error */, SHORT /* fewer bytes */, UNSTAMPED, WAITED /* and there before anyone asks */ };
static const struct { uint32_t sequence; int oddity; } SCRIPT[] = {
    {40, PLAIN}, {41, PLAIN}, {42, PLAIN}, {43, FAULTY}, {44, PLAIN}, {48, PLAIN}, {49, SHORT}, {50, PLAIN},
    {51, UNSTAMPED}, {52, WAITED}, {53, UNSTAMPED}, {54, PLAIN}};
enum { SCRIPTED = sizeof SCRIPT / sizeof *SCRIPT };

static int file = -1, streaming, queue[BUFFERS], queued;
static uint32_t image;
static unsigned char *memory;

static int is(const char *kind) { const char *k = getenv("CAMERA"); return k && !strcmp(k, kind); }
static int unplugged(void) { const char *path = getenv("UNPLUGGED"); return path && access(path, F_OK) == 0; }
static int oddity(void) { return image < SCRIPTED ? SCRIPT[image].oddity : PLAIN; }
static int fails(int cause) { errno = cause; return -1; }

int open(const char *path, int flags, ...)
{
    static int (*real)(const char *, int, ...);
    const char *device = getenv("DEVICE");
    va_list rest;
    va_start(rest, flags);
    int mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, int) : 0;
    va_end(rest);
    if (device && !strcmp(path, device)) {
        file = memfd_create("camera", MFD_CLOEXEC);
        if (file < 0 || ftruncate(file, BUFFERS * BYTES) != 0)
            return -1;
        memory = mmap(NULL, BUFFERS * BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        return file;
    }
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "open");
    return real(path, flags, mode);
}

static int set_format(struct v4l2_pix_format *p)
{
    if (is("colour"))
        p->pixelformat = V4L2_PIX_FMT_YUYV;
    else if (p->pixelformat != V4L2_PIX_FMT_Y16)
        p->pixelformat = V4L2_PIX_FMT_Z16;
    p->width = WIDTH, p->height = HEIGHT, p->field = V4L2_FIELD_NONE;
    p->bytesperline = is("small") ? WIDTH : ROW;
    p->sizeimage = p->bytesperline * HEIGHT;
    return 0;
}

/* Hands out the oldest buffer with the next image. */
static int hand_out(struct v4l2_buffer *b)
{
    struct timespec t;
    if (unplugged())
        return fails(ENODEV);
    if (!streaming || queued == 0 || is("silent"))
        return fails(EAGAIN);
    const uint32_t sequence = image < SCRIPTED ? SCRIPT[image].sequence : SCRIPT[SCRIPTED - 1].sequence + image - SCRIPTED + 1;
    const int odd = oddity(), index = queue[0];
    memmove(queue, queue + 1, sizeof queue - sizeof *queue), queued--;
    unsigned char *bytes = memory + index * BYTES;
    memset(bytes, 0xff, BYTES);
    for (int row = 0; row < HEIGHT; row++)
        for (int column = 0; column < WIDTH; column++) {
            const uint16_t count = (uint16_t)(100 * sequence + 10 * row + column);
            memcpy(bytes + ROW * row + 2 * column, &count, 2);
        }
    clock_gettime(CLOCK_MONOTONIC, &t);
    const int64_t ns = t.tv_sec * 1000000000LL + t.tv_nsec - AGE;
    b->index = (uint32_t)index, b->sequence = sequence, b->length = BYTES;
    b->bytesused = odd == SHORT ? ROW : ROW * HEIGHT;
    b->flags = odd >= UNSTAMPED ? V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN : V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    b->flags |= odd == FAULTY ? V4L2_BUF_FLAG_ERROR : 0;
    /* A stamp that does not count is one of no use. */
    b->timestamp.tv_sec = odd >= UNSTAMPED ? 1 : ns / 1000000000LL, b->timestamp.tv_usec = odd >= UNSTAMPED ? 0 : ns / 1000 % 1000000;
    image++;
    return 0;
}

static int answer(unsigned long request, void *argument)
{
    struct v4l2_buffer *b = argument;
    switch (request) {
    case VIDIOC_QUERYCAP: {
        struct v4l2_capability *c = argument;
        memset(c, 0, sizeof *c);
        c->capabilities = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING | V4L2_CAP_DEVICE_CAPS; /* of all devices of the camera */
        c->device_caps = is("blind") ? V4L2_CAP_META_CAPTURE : V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        return 0;
    }
    case VIDIOC_ENUM_FMT: {
        struct v4l2_fmtdesc *f = argument;
        const int last = is("colour") ? 0 : 1;
        if (f->index > (uint32_t)last)
            return fails(EINVAL);
        f->pixelformat = f->index == 0 ? V4L2_PIX_FMT_YUYV : V4L2_PIX_FMT_Z16;
        strcpy((char *)f->description, f->index == 0 ? "YUYV 4:2:2" : "16-bit Depth");
        return 0;
    }
    case VIDIOC_ENUM_FRAMESIZES: {
        struct v4l2_frmsizeenum *s = argument;
        if (s->index > 0)
            return fails(EINVAL);
        if (s->pixel_format == V4L2_PIX_FMT_YUYV) {
            s->type = V4L2_FRMSIZE_TYPE_STEPWISE;
            s->stepwise = (struct v4l2_frmsize_stepwise){8, 1920, 8, 6, 1080, 6};
        } else
            s->type = V4L2_FRMSIZE_TYPE_DISCRETE, s->discrete = (struct v4l2_frmsize_discrete){WIDTH, HEIGHT};
        return 0;
    }
    case VIDIOC_ENUM_FRAMEINTERVALS: {
        struct v4l2_frmivalenum *r = argument;
        if (r->index > 1)
            return fails(EINVAL);
        r->type = V4L2_FRMIVAL_TYPE_DISCRETE, r->discrete = (struct v4l2_fract){r->index == 0 ? 1 : 2, r->index == 0 ? 90 : 15};
        return 0;
    }
    case VIDIOC_S_FMT: return set_format(&((struct v4l2_format *)argument)->fmt.pix);
    case VIDIOC_S_PARM: {
        struct v4l2_fract *f = &((struct v4l2_streamparm *)argument)->parm.capture.timeperframe;
        f->numerator = 1, f->denominator = 90;
        return 0;
    }
    case VIDIOC_REQBUFS: ((struct v4l2_requestbuffers *)argument)->count = BUFFERS; return 0;
    case VIDIOC_QUERYBUF:
        b->length = BYTES, b->m.offset = b->index * BYTES;
        return b->index < BUFFERS ? 0 : fails(EINVAL);
    case VIDIOC_QBUF:
        if (b->index >= BUFFERS || queued == BUFFERS)
            abort();
        for (int i = 0; i < queued; i++)
            if (queue[i] == (int)b->index)
                abort();
        queue[queued++] = (int)b->index;
        return streaming && unplugged() ? fails(ENODEV) : 0;
    case VIDIOC_DQBUF: return hand_out(b);
    case VIDIOC_STREAMON: streaming = queued == BUFFERS; return streaming ? 0 : fails(EINVAL);
    default: return fails(ENOTTY);
    }
}

int ioctl(int fd, unsigned long request, ...)
{
    static int (*real)(int, unsigned long, ...);
    va_list rest;
    va_start(rest, request);
    void *argument = va_arg(rest, void *);
    va_end(rest);
    if (fd >= 0 && fd == file)
        return answer(request, argument);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "ioctl");
    return real(fd, request, argument);
}

int poll(struct pollfd *all, nfds_t count, int timeout)
{
    static int (*real)(struct pollfd *, nfds_t, int);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "poll");
    if (count < 2 || all[0].fd != file)
        return real(all, count, timeout);
    const int never = is("silent") && !unplugged();
    /* Between two images the device has nothing; the other file is asked for as long as a period. */
    const int ready = timeout == 0 ? oddity() == WAITED : 1, period = timeout < 11 || never ? timeout : 11;
    all[0].revents = 0;
    const int other = real(all + 1, count - 1, ready && timeout == 0 ? 0 : period);
    if (other < 0 || never || !ready)
        return other;
    all[0].revents = unplugged() ? POLLERR : POLLIN;
    return 1 + (other > 0);
}

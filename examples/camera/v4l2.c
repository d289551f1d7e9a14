/* A driver for `ingest.driver` of depth cameras that Linux knows as /dev/videoN and that send Z16 (16-bit depth), in C99,
 * over Video4Linux2. The intrinsics and the depth of one count come from you: V4L2 has no word for them.
 *
 *     cc -std=c99 v4l2.c -o v4l2
 *     ./v4l2 --list /dev/video2
 *     ./v4l2 /dev/video2 camera.sock --size 640x480 --rate 30 --camera 615,615,319.5,239.5 --unit 0.001
 *
 * --format Y16 takes a camera that calls its depth 16-bit grey. --wait SECONDS (5) is the longest time without an image.
 * Exit code: 0 stopped by SIGINT or SIGTERM; 1 the pipeline is gone or refuses; 2 the arguments are wrong, or the camera
 * cannot do what they ask for; 3 the camera is gone; 4 no image for --wait seconds.
 */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <poll.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>
#include <linux/videodev2.h>

enum { STOPPED = 0, NO_PIPELINE = 1, UNABLE = 2, UNPLUGGED = 3, SILENT = 4 };
enum { BUFFERS = 4, HEADER = 72, SLICE = 200 /* ms */, MOST_PIXELS = 1 << 24 };
#define SECOND 1000000000LL

static volatile sig_atomic_t stopped;
static const char *device, *path; /* of the camera, of the socket */
static unsigned width, height, rate, row_bytes;
static size_t image_bytes; /* of a buffer, up to the last pixel */
static const char *pixels[BUFFERS];
static double camera[4], unit, longest = 5; /* fx, fy, cx, cy in px; m; s */
static uint32_t format = V4L2_PIX_FMT_Z16;
static unsigned long long sent, lost, broken, waited; /* images */

static void stop(int signal) { (void)signal, stopped = 1; }

/* Prints a line, and ends with this exit code. */
static void end(int code, const char *text, ...)
{
    va_list values;
    va_start(values, text);
    fprintf(stderr, "v4l2: "), vfprintf(stderr, text, values), fprintf(stderr, "\n");
    va_end(values);
    exit(code);
}

static void counts(void)
{
    fprintf(stderr, "v4l2: %llu images sent, %llu lost before they were read, %llu with errors, %llu too old\n", sent, lost,
            broken, waited);
}

/* What the device answers, with interrupted calls repeated. */
static int ask(int fd, unsigned long request, void *argument)
{
    int answer;
    do
        answer = ioctl(fd, request, argument);
    while (answer < 0 && errno == EINTR);
    return answer;
}

static int64_t now(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return t.tv_sec * SECOND + t.tv_nsec;
}

static const char *letters(uint32_t code, char text[5])
{
    for (int i = 0; i < 4; i++)
        text[i] = (char)(code >> 8 * i & 0x7f);
    for (int i = 4; i >= 0 && (i == 4 || text[i] == ' '); i--)
        text[i] = 0;
    return text;
}

/* Prints the formats, sizes and rates of the camera. */
static void list(int fd)
{
    struct v4l2_fmtdesc f = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    char text[5];
    for (; ask(fd, VIDIOC_ENUM_FMT, &f) == 0; f.index++) {
        struct v4l2_frmsizeenum s = {.pixel_format = f.pixelformat};
        printf("%s  %s\n", letters(f.pixelformat, text), (const char *)f.description);
        for (; ask(fd, VIDIOC_ENUM_FRAMESIZES, &s) == 0; s.index++) {
            if (s.type != V4L2_FRMSIZE_TYPE_DISCRETE) { /* one entry has the whole range */
                printf("  %ux%u to %ux%u\n", s.stepwise.min_width, s.stepwise.min_height, s.stepwise.max_width,
                       s.stepwise.max_height);
                break;
            }
            struct v4l2_frmivalenum r = {
                .pixel_format = f.pixelformat, .width = s.discrete.width, .height = s.discrete.height};
            printf("  %ux%u", r.width, r.height);
            for (; ask(fd, VIDIOC_ENUM_FRAMEINTERVALS, &r) == 0 && r.type == V4L2_FRMIVAL_TYPE_DISCRETE; r.index++)
                printf("%s %g", r.index ? "," : " at", (double)r.discrete.denominator / r.discrete.numerator);
            printf("%s\n", r.index ? " images/s" : "");
        }
    }
}

static void read_arguments(int count, char **arguments, int *listing)
{
    static const struct option options[] = {{"list", 0, 0, 'l'},   {"size", 1, 0, 's'},   {"rate", 1, 0, 'r'}, {"camera", 1, 0, 'c'},
                                            {"unit", 1, 0, 'u'},   {"format", 1, 0, 'f'}, {"wait", 1, 0, 'w'}, {0, 0, 0, 0}};
    char rest; /* behind the last number */
    for (int option, good = 1; (option = getopt_long(count, arguments, "", options, NULL)) != -1;) {
        switch (option) {
        case 'l': *listing = 1; break;
        case 's': good = sscanf(optarg, "%5ux%5u%c", &width, &height, &rest) == 2; break;
        case 'r': good = sscanf(optarg, "%4u%c", &rate, &rest) == 1 && rate > 0; break;
        case 'c': good = sscanf(optarg, "%lf,%lf,%lf,%lf%c", camera, camera + 1, camera + 2, camera + 3, &rest) == 4; break;
        case 'u': good = sscanf(optarg, "%lf%c", &unit, &rest) == 1 && unit > 0 && unit <= 0.1; break;
        case 'w': good = sscanf(optarg, "%lf%c", &longest, &rest) == 1 && longest > 0 && longest <= 3600; break;
        case 'f': good = !strcmp(optarg, "Z16") || !strcmp(optarg, "Y16"); format = v4l2_fourcc(*optarg, '1', '6', ' '); break;
        default: exit(UNABLE); /* getopt has printed which */
        }
        if (!good)
            end(UNABLE, "invalid argument: %s (the first lines of v4l2.c show what is allowed)", optarg);
    }
    if (count - optind != (*listing ? 1 : 2))
        end(UNABLE, "usage: v4l2 --list DEVICE, or v4l2 DEVICE SOCKET --size WxH --camera FX,FY,CX,CY --unit METRES [--rate N] "
                    "[--format Y16] [--wait SECONDS]");
    device = arguments[optind], path = arguments[count - 1];
    if (*listing)
        return;
    if (width < 1 || height < 1 || (uint64_t)width * height > MOST_PIXELS)
        end(UNABLE, "invalid size: %ux%u (give --size WxH, such as 640x480)", width, height);
    /* Comparisons that are also false for NaN. */
    if (!(camera[0] > 0 && camera[1] > 0 && camera[2] >= 0 && camera[3] >= 0 && camera[2] < width && camera[3] < height))
        end(UNABLE, "invalid intrinsics: give --camera FX,FY,CX,CY in px, with the principal point in the image");
    if (unit == 0)
        end(UNABLE, "the depth of one count is missing: give --unit in m, such as 0.001 (allowed: above 0, at most 0.1)");
}

/* Sets format, size and rate. */
static void configure(int fd)
{
    struct v4l2_format f = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    struct v4l2_streamparm p = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE};
    char asked[5], given[5];
    f.fmt.pix.width = width, f.fmt.pix.height = height;
    f.fmt.pix.pixelformat = format, f.fmt.pix.field = V4L2_FIELD_NONE;
    if (ask(fd, VIDIOC_S_FMT, &f) != 0)
        end(UNABLE, "%s refuses the format %s: %s", device, letters(format, asked), strerror(errno));
    /* A device puts what it has in place of what it has not. */
    if (f.fmt.pix.pixelformat != format || f.fmt.pix.width != width || f.fmt.pix.height != height)
        end(UNABLE, "%s has no %s of %ux%u: it offers %s of %ux%u, and --list prints all", device, letters(format, asked), width,
            height, letters(f.fmt.pix.pixelformat, given), f.fmt.pix.width, f.fmt.pix.height);
    row_bytes = f.fmt.pix.bytesperline;
    if (f.fmt.pix.field != V4L2_FIELD_NONE || row_bytes < 2 * width)
        end(UNABLE, "%s has interlaced images, or rows of %u bytes for %u pixels", device, row_bytes, width);
    image_bytes = (size_t)row_bytes * (height - 1) + 2 * width;
    if (rate == 0)
        return;
    p.parm.capture.timeperframe.numerator = 1, p.parm.capture.timeperframe.denominator = rate;
    struct v4l2_fract *granted = &p.parm.capture.timeperframe;
    if (ask(fd, VIDIOC_S_PARM, &p) != 0 || granted->numerator == 0)
        fprintf(stderr, "v4l2: %s has a rate of its own: --rate %u is without effect\n", device, rate);
    else if (granted->denominator != rate * granted->numerator)
        fprintf(stderr, "v4l2: %s sends %g images/s, not %u\n", device, (double)granted->denominator / granted->numerator, rate);
}

static int open_camera(int listing)
{
    struct v4l2_capability c = {.driver = ""};
    int fd = open(device, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0)
        end(UNABLE, "cannot open %s: %s", device, strerror(errno));
    if (ask(fd, VIDIOC_QUERYCAP, &c) != 0)
        end(UNABLE, "%s is not a device of V4L2: %s", device, strerror(errno));
    uint32_t able = c.capabilities & V4L2_CAP_DEVICE_CAPS ? c.device_caps : c.capabilities;
    if (!(able & V4L2_CAP_VIDEO_CAPTURE))
        end(UNABLE, "%s captures no images in one plane: a camera may have several devices, so try the others", device);
    if (listing) {
        list(fd);
        exit(STOPPED);
    }
    if (!(able & V4L2_CAP_STREAMING))
        end(UNABLE, "%s cannot stream into mapped buffers", device);
    configure(fd);
    return fd;
}

/* Maps the buffers, and starts the stream. */
static void start(int fd)
{
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    struct v4l2_requestbuffers r = {.count = BUFFERS, .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
    if (ask(fd, VIDIOC_REQBUFS, &r) != 0 || r.count < 2)
        end(UNABLE, "%s has no buffers: %s", device, strerror(errno));
    for (unsigned i = 0; i < r.count && i < BUFFERS; i++) {
        struct v4l2_buffer b = {.index = i, .type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
        if (ask(fd, VIDIOC_QUERYBUF, &b) != 0 || b.length < image_bytes)
            end(UNABLE, "%s has buffers of %u bytes for images of %zu", device, b.length, image_bytes);
        pixels[i] = mmap(NULL, b.length, PROT_READ, MAP_SHARED, fd, b.m.offset);
        if (pixels[i] == MAP_FAILED || ask(fd, VIDIOC_QBUF, &b) != 0)
            end(UNABLE, "cannot map the buffers of %s: %s", device, strerror(errno));
    }
    struct sigaction action = {.sa_handler = stop};
    sigaction(SIGINT, &action, NULL), sigaction(SIGTERM, &action, NULL);
    if (ask(fd, VIDIOC_STREAMON, &type) != 0)
        end(UNABLE, "%s does not start: %s", device, strerror(errno));
}

static int connect_pipeline(void)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const struct timeval patience = {2, 0};
    int s = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (strlen(path) >= sizeof address.sun_path)
        end(UNABLE, "the path of the socket is too long: %s", path);
    memcpy(address.sun_path, path, strlen(path));
    if (s < 0 || connect(s, (struct sockaddr *)&address, sizeof address) != 0)
        end(NO_PIPELINE, "nothing listens at %s: start the pipeline first (%s)", path, strerror(errno));
    setsockopt(s, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
    return s;
}

/* The pipeline has closed the connection, perhaps after a line with the reason. */
static void gone(int s)
{
    char answer[200] = "";
    ssize_t length = recv(s, answer, sizeof answer - 1, MSG_DONTWAIT);
    counts();
    end(NO_PIPELINE, "the pipeline is gone: %s", length > 0 ? strtok(answer, "\n") : "it has closed the connection");
}

static void send_image(int s, const char *bytes, size_t length)
{
    for (size_t done = 0; done < length;) {
        ssize_t part = send(s, bytes + done, length - done, MSG_NOSIGNAL);
        if (part < 0 && errno == EAGAIN && stopped) /* a busy pipeline is waited for, but not for ever */
            counts(), end(NO_PIPELINE, "the pipeline takes no images: the last one is cut");
        if (part < 0 && errno != EINTR && errno != EAGAIN)
            gone(s);
        done += part > 0 ? (size_t)part : 0;
    }
}

static void lose_camera(void)
{
    int cause = errno;
    counts();
    end(UNPLUGGED, "%s is gone: %s; connect the camera, and start this driver anew", device, strerror(cause));
}

/* When the image was taken, ns since the epoch; `waiting` where it was there before this program waited for it.
 * 0 if nobody knows. */
static int64_t acquired(const struct v4l2_buffer *b, int waiting)
{
    static int before = -1;
    int stamped = (b->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    int64_t epoch = now(CLOCK_REALTIME);
    if (stamped != before)
        fprintf(stderr, "v4l2: the times are those of %s\n",
                !stamped ? "this program, when it gets an image: the camera states none"
                : (b->flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE ? "the camera, start of exposure"
                                                                                             : "the camera, end of the image");
    before = stamped;
    if (!stamped)
        return waiting ? 0 : epoch;
    /* The monotonic clock is read second: a pause between the two makes an image older, never newer. */
    int64_t stamp = b->timestamp.tv_sec * SECOND + b->timestamp.tv_usec * 1000LL;
    return epoch - (now(CLOCK_MONOTONIC) - stamp);
}

/* 72 bytes and the counts, as docs/reference/driver-frames.md has them; this machine is little-endian. */
static char *new_frame(void)
{
    char *frame = calloc(1, HEADER + 2 * (size_t)width * height);
    const uint32_t length = HEADER - 8 + 2 * width * height, size[2] = {width, height};
    if (frame == NULL)
        end(UNABLE, "no memory for an image of %ux%u", width, height);
    memcpy(frame, "SPF1", 4), memcpy(frame + 4, &length, 4);
    memcpy(frame + 24, camera, 32), memcpy(frame + 56, &unit, 8), memcpy(frame + 64, size, 8);
    return frame;
}

int main(int argument_count, char **arguments)
{
    int listing = 0;
    read_arguments(argument_count, arguments, &listing);
    int fd = open_camera(listing), s = connect_pipeline();
    char *frame = new_frame();
    start(fd);
    struct pollfd both[2] = {{.fd = fd, .events = POLLIN}, {.fd = s, .events = POLLIN}};
    int64_t last_image = now(CLOCK_MONOTONIC), last_line = last_image - SECOND;
    uint64_t number = 0;
    uint32_t last = 0; /* sequence number of the camera */
    for (int first = 1, changed = 0; !stopped;) {
        /* An image that is there already has waited, nobody knows how long. */
        const int waiting = poll(both, 2, 0) > 0 && both[0].revents;
        if (!waiting && poll(both, 2, SLICE) < 0)
            continue;
        if (both[1].revents)
            gone(s);
        const int64_t time = now(CLOCK_MONOTONIC);
        if (changed && time - last_line > SECOND) /* at most one line a second */
            counts(), changed = 0, last_line = time;
        if (!both[0].revents) {
            if ((double)(time - last_image) > longest * (double)SECOND)
                counts(), end(SILENT, "%s has sent no image for %g s", device, longest);
            continue;
        }
        struct v4l2_buffer b = {.type = V4L2_BUF_TYPE_VIDEO_CAPTURE, .memory = V4L2_MEMORY_MMAP};
        if (ask(fd, VIDIOC_DQBUF, &b) != 0) {
            if (errno == EAGAIN && !(both[0].revents & (POLLERR | POLLHUP)))
                continue;
            lose_camera();
        }
        const int64_t taken = acquired(&b, waiting);
        last_image = time;
        /* 1 where no image is lost. Some cameras do not count, or begin anew. */
        const uint32_t step = first ? 1 : b.sequence - last, skipped = step > 1 && step < UINT32_MAX / 2 ? step - 1 : 0;
        number += first ? 0 : 1 + skipped, lost += skipped;
        last = b.sequence, first = 0;
        const int whole = !(b.flags & V4L2_BUF_FLAG_ERROR) && b.bytesused >= image_bytes;
        broken += !whole, waited += whole && taken == 0;
        changed |= skipped > 0 || !whole || taken == 0;
        memcpy(frame + 8, &number, 8), memcpy(frame + 16, &taken, 8);
        for (unsigned row = 0; row < height && whole; row++) /* rows may have bytes behind their pixels */
            memcpy(frame + HEADER + 2 * (size_t)width * row, pixels[b.index] + (size_t)row_bytes * row, 2 * width);
        if (ask(fd, VIDIOC_QBUF, &b) != 0)
            lose_camera();
        if (whole && taken != 0)
            send_image(s, frame, HEADER + 2 * (size_t)width * height), sent++;
    }
    counts();
    return STOPPED; /* which stops the stream */
}

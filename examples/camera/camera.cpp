// A driver of a depth camera for `ingest.driver`, in C++11 and POSIX: an image of a plate that moves away by 1 mm a frame.
//
//     c++ -std=c++11 camera.cpp -o camera && ./camera camera.sock [IMAGES]
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

#include <sys/socket.h>
#include <sys/un.h>

constexpr std::uint32_t width = 64, height = 48, pixels = width * height;

// 72 bytes and the counts, as docs/reference/driver-frames.md has them; this machine is little-endian.
struct Frame {
    char beginning[4] = {'S', 'P', 'F', '1'};
    std::uint32_t length = 64 + 2 * pixels;      // of what follows
    std::uint64_t number = 0, acquired = 0;      // ns since the epoch
    double fx = 60, fy = 60, cx = 31.5, cy = 23.5; // px
    double depth_unit = 1e-3;                    // m
    std::uint32_t columns = width, rows = height;
    std::array<std::uint16_t, pixels> counts{};  // row by row; 0 is no reading
};
static_assert(sizeof(Frame) == 72 + 2 * pixels, "a frame has no padding");

int main(int count, char **arguments) {
    using namespace std::chrono;
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, count > 1 ? arguments[1] : "camera.sock", sizeof address.sun_path - 1);
    const int s = socket(AF_UNIX, SOCK_STREAM, 0);
    if (connect(s, reinterpret_cast<sockaddr *>(&address), sizeof address) != 0)
        return std::perror("nothing listens: start the pipeline first"), 1;
    static Frame frame;
    for (long left = count > 2 ? std::atol(arguments[2]) : -1; left != 0; --left, ++frame.number) {
        // As early as possible: when the camera exposed the image.
        frame.acquired = duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
        for (std::uint32_t i = 0; i < pixels; ++i)
            frame.counts[i] = static_cast<std::uint16_t>(600 + frame.number % 100 + i % width);
        for (std::size_t sent = 0; sent < sizeof frame;) {
            const auto part = send(s, reinterpret_cast<const char *>(&frame) + sent, sizeof frame - sent, MSG_NOSIGNAL);
            char answer[200] = "";
            if (part < 0) // stillpoint has closed the connection, and says why
                return std::fprintf(stderr, "%s", recv(s, answer, sizeof answer - 1, 0) > 0 ? answer : "it is gone\n"), 1;
            sent += static_cast<std::size_t>(part);
        }
        std::this_thread::sleep_for(microseconds(33333));
    }
}

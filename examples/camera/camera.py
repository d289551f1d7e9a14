"""A driver of a depth camera for `ingest.driver`, in Python: an image of a plate that moves away by 1 mm a frame.

    python3 camera.py camera.sock [IMAGES]
"""

import array
import socket
import struct
import sys
import time

WIDTH, HEIGHT = 64, 48
FX, FY, CX, CY, DEPTH_UNIT = 60.0, 60.0, 31.5, 23.5, 1e-3  # px, m
# As docs/reference/driver-frames.md has it: beginning, length of what follows, number, time, camera, size.
HEADER = struct.Struct("<4sIQQ5dII")


def image(number):
    """Counts of DEPTH_UNIT, row by row; 0 is no reading. With numpy: depth.astype("<u2").tobytes()."""
    counts = array.array("H", [600 + number % 100 + i % WIDTH for i in range(WIDTH * HEIGHT)])
    if sys.byteorder == "big":
        counts.byteswap()
    return counts.tobytes()


def main():
    path = sys.argv[1] if len(sys.argv) > 1 else "camera.sock"
    images = int(sys.argv[2]) if len(sys.argv) > 2 else sys.maxsize
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as stillpoint:
        stillpoint.connect(path)
        for number in range(images):
            acquired = time.time_ns()  # as early as possible: when the camera exposed the image
            counts = image(number)
            length = HEADER.size - 8 + len(counts)
            header = HEADER.pack(b"SPF1", length, number, acquired, FX, FY, CX, CY, DEPTH_UNIT, WIDTH, HEIGHT)
            try:
                stillpoint.sendall(header + counts)
            except OSError:  # stillpoint has closed the connection, and says why
                sys.exit(stillpoint.recv(200).decode() or "it is gone")
            time.sleep(1 / 30)


main()

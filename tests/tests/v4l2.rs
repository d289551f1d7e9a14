//! The driver of cameras that Linux knows (`examples/camera/v4l2.c`), on a device that is not there: `v4l2/device.c` answers
//! the calls of the program in place of the kernel. No real camera is in these tests.

use std::io::{Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::process::Command;

use rustix::process::Signal;
use stillpoint_recorder::Session;
use stillpoint_samples::{DepthImage, Diagnostics, Header, Intrinsics, Pieces, Sample};

use crate::bench::{Bench, Running, wait_for};
use crate::driver::{FOLDER, compiled, pipeline};

const DEVICE: &str = "/dev/depth-camera-of-a-test";
const CAMERA: [&str; 8] =
    ["camera.sock", "--size", "8x6", "--camera", "60,61,3.5,2.5", "--unit", "0.001", "--rate=30"];
/// Bytes of a frame of 8 x 6 pixels.
const FRAME: usize = 72 + 2 * 8 * 6;

/// The driver and the library that is loaded before it.
struct Driver {
    bench: Bench,
    program: PathBuf,
    library: PathBuf,
}

impl Driver {
    /// `None` where there is no compiler.
    fn new() -> Option<Self> {
        let bench = Bench::new();
        let device = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/v4l2/device.c");
        let program = compiled(&bench, "cc", &["-std=c99", "-Wpedantic"], &format!("{FOLDER}/v4l2.c"))?;
        let library = compiled(&bench, "cc", &["-std=gnu99", "-shared", "-fPIC"], device)?;
        Some(Self { bench, program, library })
    }

    /// Starts the driver at a camera of this kind, which is unplugged when the file `unplugged` is there.
    fn start(&self, camera: &str, arguments: &[&str]) -> Running {
        let mut command = Command::new(&self.program);
        command.arg(DEVICE).args(arguments).current_dir(self.bench.path("."));
        command.env("LD_PRELOAD", &self.library).env("DEVICE", DEVICE);
        command.env("CAMERA", camera).env("UNPLUGGED", self.bench.path("unplugged"));
        self.bench.begin(command)
    }

    /// A socket at which the test listens itself.
    fn listen(&self) -> UnixListener {
        UnixListener::bind(self.bench.path("camera.sock")).unwrap()
    }

    /// The connection of a driver, and the number and the first count of its next image.
    fn next(connection: &mut UnixStream) -> (u64, u16) {
        let mut bytes = [0; FRAME];
        connection.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes[..4], *b"SPF1");
        (u64::from_le_bytes(bytes[8..16].try_into().unwrap()), u16::from_le_bytes([bytes[72], bytes[73]]))
    }
}

/// The images that arrive of those of `v4l2/device.c`, by the numbers of the device: the others are lost, have an error, are
/// too short, or had waited without a stamp.
const ARRIVE: [u16; 9] = [40, 41, 42, 44, 48, 50, 51, 53, 54];
/// Those without a stamp of the camera.
const UNSTAMPED: [u16; 2] = [51, 53];

#[test]
fn depth_images_of_a_v4l2_device_arrive_with_their_pixels_and_times_and_all_others_are_counted() {
    let Some(driver) = Driver::new() else { return };
    let bench = &driver.bench;
    let run = bench.run(&pipeline(bench));
    let socket = bench.path("camera.sock");
    wait_for("the socket", || socket.exists().then_some(()));
    let driven = driver.start("whole", &CAMERA);
    bench.wait_for_samples("camera.depth", 12);
    std::fs::write(bench.path("unplugged"), "").unwrap();
    let done = driven.finish();
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);

    assert_eq!(done.code(), 3, "{}", done.err);
    for line in [
        "sends 90 images/s, not 30",
        "the times are those of the camera, end of the image\n",
        "the times are those of this program, when it gets an image: the camera states none\n",
        "images sent, 3 lost before they were read, 2 with errors, 1 too old\n",
        "is gone: No such device; connect the camera",
    ] {
        assert!(done.err.contains(line), "{line}: {}", done.err);
    }

    let session = report["session"].as_str().unwrap();
    let recorded = Session::open(&bench.path(session)).unwrap();
    let mut arrived = Vec::new();
    for sample in recorded.samples_where(|topic| topic.name == "camera.depth") {
        let sample = sample.unwrap().sample;
        let image = Pieces::split(DepthImage::KIND, &sample).unwrap().view::<DepthImage>().unwrap();
        let Intrinsics { fx, fy, cx, cy, depth_unit, width, height, .. } = *image.body;
        assert_eq!(([fx, fy, cx, cy, depth_unit], width, height), ([60.0, 61.0, 3.5, 2.5, 1e-3], 8, 6));
        let number = image.elements[0] / 100;
        // Rows of the device have 16 bytes behind their pixels.
        let expected: Vec<u16> = (0..6 * 8).map(|i| 100 * number + 10 * (i / 8) + i % 8).collect();
        assert_eq!(image.elements, expected, "image {number}");
        let Header { stamp, origin, .. } = image.header;
        let age = i128::from(stamp) - i128::from(origin);
        if UNSTAMPED.contains(&number) {
            // The device states the first second of the monotonic clock, or nothing at all: the pipeline got neither.
            assert!((0..50_000_000_000).contains(&age), "image {number}: {age} ns");
        } else {
            // The device states 50 ms before it hands out the image.
            assert!((49_000_000..50_000_000_000).contains(&age), "image {number}: {age} ns");
        }
        arrived.push(number);
    }
    assert_eq!(arrived[..ARRIVE.len()], ARRIVE);
    assert!(arrived[ARRIVE.len() - 1..].windows(2).all(|pair| pair[1] == pair[0] + 1), "{arrived:?}");

    let last =
        recorded.samples_where(|topic| topic.name == "camera.diagnostics").last().unwrap().unwrap().sample;
    let counts = Pieces::split(Diagnostics::KIND, &last).unwrap().view::<Diagnostics>().unwrap();
    for (name, expected) in
        [("images", arrived.len() as f64), ("missing", 6.0), ("restarts", 0.0), ("refused_cut", 0.0)]
    {
        let metric = counts.elements.iter().find(|metric| metric.name() == name).unwrap();
        assert_eq!(metric.value, expected, "{name}");
    }
}

#[test]
fn a_device_that_cannot_do_what_is_asked_is_refused_with_what_it_offers() {
    let Some(driver) = Driver::new() else { return };
    let with = |more: &[&'static str]| [&CAMERA[..], more].concat();
    for (camera, arguments, message) in [
        ("colour", CAMERA.to_vec(), "has no Z16 of 8x6: it offers YUYV of 8x6, and --list prints all"),
        ("colour", with(&["--format", "Y16"]), "has no Y16 of 8x6: it offers YUYV of 8x6"),
        ("whole", with(&["--size", "640x480"]), "has no Z16 of 640x480: it offers Z16 of 8x6"),
        ("small", CAMERA.to_vec(), "rows of 8 bytes for 8 pixels"),
        ("blind", CAMERA.to_vec(), "captures no images in one plane"),
        ("whole", with(&["--camera", "60,60,nan,2.5"]), "invalid intrinsics"),
        ("whole", with(&["--camera", "60,60,8,2.5"]), "invalid intrinsics"),
        ("whole", with(&["--camera", "60,60"]), "invalid argument: 60,60 "),
        ("whole", with(&["--unit", "1mm"]), "invalid argument: 1mm "),
        ("whole", with(&["--unit", "nan"]), "invalid argument: nan "),
        ("whole", with(&["--rate", "0"]), "invalid argument: 0 "),
        ("whole", with(&["--format", "RGB3"]), "invalid argument: RGB3 "),
        ("whole", vec!["camera.sock", "--size", "8x6", "--camera", "60,60,3,2"], "give --unit in m"),
        ("whole", vec![], "usage: "),
    ] {
        let done = driver.start(camera, &arguments).finish();
        assert!(
            done.code() == 2 && done.err.contains(message),
            "{camera} {arguments:?}: {} {}",
            done.code(),
            done.err
        );
    }
    let listed = driver.start("whole", &["--list"]).finish();
    assert_eq!(
        (listed.code(), listed.out.as_str()),
        (0, "YUYV  YUYV 4:2:2\n  8x6 to 1920x1080\nZ16  16-bit Depth\n  8x6 at 90, 7.5 images/s\n"),
        "{}",
        listed.err
    );
    // What is no camera at all.
    for (device, message) in
        [("/dev/null", "is not a device of V4L2"), ("/dev/none", "cannot open /dev/none")]
    {
        let mut command = Command::new(&driver.program);
        command.arg(device).args(CAMERA);
        let done = driver.bench.begin(command).finish();
        assert!(done.code() == 2 && done.err.contains(message), "{device}: {}", done.err);
    }
    let early = driver.start("whole", &CAMERA).finish();
    assert!(early.code() == 1 && early.err.contains("start the pipeline first"), "{}", early.err);
}

#[test]
fn a_device_that_sends_nothing_or_is_unplugged_ends_its_driver_with_a_code_for_each() {
    let Some(driver) = Driver::new() else { return };
    let _listener = driver.listen();
    let silent = driver.start("silent", &[&CAMERA[..], &["--wait", "0.3"]].concat()).finish();
    assert!(silent.code() == 4 && silent.err.contains("has sent no image for 0.3 s"), "{}", silent.err);
    std::fs::write(driver.bench.path("unplugged"), "").unwrap();
    let gone = driver.start("silent", &CAMERA).finish();
    assert!(gone.code() == 3 && gone.err.contains("is gone: No such device"), "{}", gone.err);
}

#[test]
fn the_v4l2_driver_stops_after_a_whole_image_and_with_its_pipeline() {
    let Some(driver) = Driver::new() else { return };
    let listener = driver.listen();
    for signal in [Signal::TERM, Signal::INT] {
        let driven = driver.start("whole", &CAMERA);
        let mut connection = listener.accept().unwrap().0;
        let images = [(); 4].map(|()| Driver::next(&mut connection));
        assert_eq!(images, [(0, 4000), (1, 4100), (2, 4200), (4, 4400)]);
        driven.signal(signal);
        let mut rest = Vec::new();
        connection.read_to_end(&mut rest).unwrap();
        assert_eq!(rest.len() % FRAME, 0, "{} bytes", rest.len());
        let done = driven.finish();
        let counted = format!("v4l2: {} images sent, ", 4 + rest.len() / FRAME);
        assert!(done.code() == 0 && done.err.contains(&counted), "{}", done.err);
    }
    // A camera that sends nothing does not hide that the pipeline is gone.
    for camera in ["whole", "silent"] {
        let driven = driver.start(camera, &[&CAMERA[..], &["--wait", "3600"]].concat());
        let mut connection = listener.accept().unwrap().0;
        connection.write_all(b"refused: another program sends already\n").unwrap();
        drop(connection);
        let done = driven.finish();
        let reason = "the pipeline is gone: refused: another program sends already\n";
        assert!(done.code() == 1 && done.err.contains(reason), "{camera}: {}", done.err);
    }
}

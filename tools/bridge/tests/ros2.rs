//! A run without hosts beside a program of ROS 2: a peer that is connected as such programs are gives depth images and
//! takes what is published.

use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;
use stillpoint_cdr::{Reader, schema};
use stillpoint_ros2::{Attachment, TopicName, key, rihs01};
use zenoh::pubsub::Subscriber;
use zenoh::{Config, Session, Wait};

use crate::bench::{Bench, Done, Running, two_ports, wait_for};

const EXAMPLE: &str = include_str!("../../../examples/ros2-camera.yaml");
const IMAGES: &str = "/camera/depth/image_raw";
const INFOS: &str = "/camera/depth/camera_info";

fn data(name: &str) -> String {
    format!("{}/../../examples/data/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Why the peer's broken messages are refused.
const REASONS: [&str; 5] = ["attachment", "damaged", "other_type", "too_long", "ahead"];

/// A count of `camera.diagnostics`.
fn metric(sample: &Value, name: &str) -> u64 {
    let found = sample["elements"].as_array().unwrap().iter().find(|m| m["name"] == name);
    found.unwrap_or_else(|| panic!("{name}: {sample}"))["value"].as_f64().unwrap() as u64
}

/// The example, at a router of its own.
fn pipeline(port: u16) -> String {
    EXAMPLE.replace("7447", &port.to_string()).replace("data/camera.mcap", &data("camera.mcap"))
}

/// The messages of the example's recording: of the camera, and of each image.
fn recorded() -> (Vec<u8>, Vec<Vec<u8>>) {
    let bytes = std::fs::read(Path::new(&data("camera.mcap"))).unwrap();
    let (mut info, mut images) = (Vec::new(), Vec::new());
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        match message.channel.topic.as_str() {
            IMAGES => images.push(message.data.into_owned()),
            _ => info = message.data.into_owned(),
        }
    }
    (info, images)
}

fn session(mode: &str, part: &str, port: u16) -> Session {
    let config = format!(
        "{{ mode: '{mode}', {part}: {{ endpoints: ['tcp/127.0.0.1:{port}'] }}, scouting: {{ multicast: {{ enabled: false }} }} }}"
    );
    zenoh::open(Config::from_json5(&config).unwrap()).wait().unwrap()
}

fn key_of(topic: &str, (name, text): schema::Schema) -> String {
    key(0, &TopicName::parse(topic).unwrap(), name, &rihs01(name, text).unwrap())
}

fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64
}

/// A message with its stamp set to now.
fn stamped(message: &[u8]) -> (Vec<u8>, u64) {
    let (mut message, now) = (message.to_vec(), now());
    // Behind the four bytes that name the form of the message.
    message[4..8].copy_from_slice(&((now / 1_000_000_000) as u32).to_le_bytes());
    message[8..12].copy_from_slice(&((now % 1_000_000_000) as u32).to_le_bytes());
    (message, now)
}

/// Messages of a topic with their attachments.
type Came = Arc<Mutex<Vec<(Vec<u8>, Vec<u8>)>>>;

/// A program of ROS 2.
struct Peer {
    session: Session,
    sequence: u64,
    info: Vec<u8>,
    images: Vec<Vec<u8>>,
    /// Stamps of the images that were sent.
    stamps: Vec<u64>,
}

impl Peer {
    fn new(port: u16) -> Self {
        let (info, images) = recorded();
        Self { session: session("peer", "connect", port), sequence: 0, info, images, stamps: Vec::new() }
    }

    fn put(&mut self, key: String, message: Vec<u8>) {
        self.sequence += 1;
        let neighbour = Attachment { sequence: self.sequence, time: now(), gid: [9; 16] }.to_bytes();
        self.session.put(key, message).attachment(&neighbour[..]).wait().unwrap();
    }

    /// Sends the camera and the next image, with the stamp of now.
    fn give(&mut self) {
        let image = self.images[self.stamps.len() % self.images.len()].clone();
        self.put(key_of(INFOS, schema::CAMERA_INFO), self.info.clone());
        let (image, stamp) = stamped(&image);
        self.put(key_of(IMAGES, schema::IMAGE), image);
        self.stamps.push(stamp);
    }

    fn takes(&self, topic: &str, schema: schema::Schema) -> (Came, Subscriber<()>) {
        let came = Came::default();
        let retained = came.clone();
        let subscriber = self.session.declare_subscriber(key_of(topic, schema)).callback(move |sample| {
            let attachment = sample.attachment().map(|a| a.to_bytes().into_owned()).unwrap_or_default();
            retained.lock().unwrap().push((sample.payload().to_bytes().into_owned(), attachment));
        });
        (came, subscriber.wait().unwrap())
    }
}

/// Gives images at the pace of a camera until something holds.
fn give_until(peer: &mut Peer, what: &str, mut holds: impl FnMut() -> bool) {
    wait_for(what, || {
        peer.give();
        std::thread::sleep(Duration::from_millis(60));
        holds().then_some(())
    });
}

fn numbers<const N: usize>(reader: &mut Reader<'_>) -> [f64; N] {
    std::array::from_fn(|_| reader.f64().unwrap())
}

/// Stamp, frame, position and orientation of a `PoseStamped`.
fn pose(message: &[u8]) -> (u64, String, [f64; 3], [f64; 4]) {
    let mut reader = Reader::new(message).unwrap();
    let (stamp, frame) = reader.header_and_frame().unwrap();
    let read = (stamp, frame.to_owned(), numbers(&mut reader), numbers(&mut reader));
    assert_eq!(reader.rest(), 0);
    read
}

/// The same of a `TFMessage` of one frame, and the frame that it places.
fn transform(message: &[u8]) -> ((u64, String, [f64; 3], [f64; 4]), String) {
    let mut reader = Reader::new(message).unwrap();
    assert_eq!(reader.u32().unwrap(), 1);
    let (stamp, frame) = reader.header_and_frame().unwrap();
    let child = reader.text().unwrap().to_owned();
    ((stamp, frame.to_owned(), numbers(&mut reader), numbers(&mut reader)), child)
}

fn start(bench: &Bench, port: u16) -> Running {
    let file = bench.write("ros2.yaml", &pipeline(port));
    bench.start(&["run", &file, "--json", "--record", "s"])
}

fn line<'r>(report: &'r Value, topic: &str, consumer: &str) -> &'r Value {
    let lines = report["ledger"].as_array().unwrap();
    let found = lines.iter().find(|l| l["topic"] == topic && l["consumer"] == consumer);
    found.unwrap_or_else(|| panic!("{topic} -> {consumer}: {}", report["ledger"]))
}

fn count(line: &Value, name: &str) -> u64 {
    line[name].as_u64().unwrap_or(0)
}

#[test]
fn depth_images_of_ros2_become_poses_that_ros2_gets_and_the_session_replays_without_a_network() {
    let (bench, port) = (Bench::new(), two_ports());
    // The run is there before the router.
    let run = start(&bench, port);
    run.wait_for_words(&format!("ROS 2: no router is at tcp/127.0.0.1:{port}"));
    let _router = session("router", "listen", port);
    let mut peer = Peer::new(port);
    let (poses, _poses) = peer.takes("/stillpoint/head_pose", schema::POSE_STAMPED);
    let (moved, _moved) = peer.takes("/tf", schema::TRANSFORMS);
    let (placed, _placed) = peer.takes("/tf_static", schema::TRANSFORMS);
    let (faces, _faces) = peer.takes("/stillpoint/face", schema::POINT_CLOUD);
    run.wait_for_words("ROS 2: the node /ros2_camera is connected");
    give_until(&mut peer, "five poses", || poses.lock().unwrap().len() >= 5);

    // Messages that are none: with a broken attachment, cut, of another type, too long, from the future.
    let image = peer.images[0].clone();
    let of_images = key_of(IMAGES, schema::IMAGE);
    let reported = bench.start(&["echo", "--json", "--run", "ros2-camera", "camera.diagnostics"]);
    for reason in REASONS {
        wait_for(reason, || {
            let (message, _) = stamped(&image);
            match reason {
                "attachment" => {
                    let short = peer.session.put(of_images.clone(), message).attachment(&[0_u8; 12][..]);
                    short.wait().unwrap();
                }
                "damaged" => peer.put(of_images.clone(), message[..100].to_vec()),
                "other_type" => peer.put(key_of(IMAGES, schema::POINT_CLOUD), message),
                "too_long" => peer.put(of_images.clone(), vec![0; 2_000_000]),
                _ => {
                    let mut message = message;
                    message[7] = 0x7f;
                    peer.put(of_images.clone(), message);
                }
            }
            std::thread::sleep(Duration::from_millis(60));
            let lines = reported.printed();
            let (whole, _) = lines.rsplit_once('\n')?;
            let last: Value = serde_json::from_str(whole.lines().last()?).unwrap();
            (metric(&last, &format!("refused_{reason}")) > 0).then_some(())
        });
    }
    run.wait_for_words("messages on /camera/depth/image_raw are sensor_msgs/msg/PointCloud2");
    reported.stop();

    // A bridge that dies is started again.
    run.kill_child("bridge");
    let before = poses.lock().unwrap().len();
    give_until(&mut peer, "poses after a new bridge", || poses.lock().unwrap().len() >= before + 3);
    let report = run.stop().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    assert_eq!(report["complete"], true, "{report}");
    let session = report["session"].as_str().unwrap();

    // What ROS 2 got is what the session holds, with the stamps of the images.
    let recorded = bench.samples(session, "head.pose");
    let poses = poses.lock().unwrap().clone();
    let mut last = 0;
    for (number, (message, attachment)) in poses.iter().enumerate() {
        let (stamp, frame, position, orientation) = pose(message);
        assert!(peer.stamps.contains(&stamp), "{number}: {stamp}");
        assert_eq!(frame, "couch");
        let sample = recorded.iter().find(|s| s["origin"] == stamp).unwrap();
        let element = &sample["elements"][0];
        let numbers = |name: &str| -> Vec<f64> {
            element[name].as_array().unwrap().iter().map(|n| n.as_f64().unwrap()).collect()
        };
        assert_eq!(numbers("position"), position);
        let [x, y, z, w] = orientation;
        assert_eq!(numbers("orientation"), [w, x, y, z]);
        // The head of the recording lies above the couch, and moves by millimetres.
        assert!((0.0..0.3).contains(&position[2]), "{position:?}");
        let sequence = Attachment::parse(attachment).unwrap().sequence;
        // A new bridge is another sender, which counts anew.
        assert!(sequence == last + 1 || sequence == 1, "{sequence} after {last}");
        last = sequence;
    }
    let moved = moved.lock().unwrap().clone();
    let places: Vec<_> = moved.iter().map(|(message, _)| transform(message)).collect();
    assert!(places.len() >= 5 && places.iter().all(|(_, child)| child == "head"));
    let of_poses: Vec<_> = poses.iter().map(|(message, _)| pose(message)).collect();
    assert!(places.iter().any(|(place, _)| of_poses.contains(place)));
    let ((_, parent, at, _), child) = transform(&placed.lock().unwrap()[0].0);
    assert_eq!((parent.as_str(), child.as_str(), at), ("couch", "camera", [0.0, -0.48, 0.59]));
    assert!(!faces.lock().unwrap().is_empty());

    // Every message is in one count.
    let reported = bench.samples(session, "camera.diagnostics");
    let last = reported.last().unwrap();
    let metrics = last["elements"].as_array().unwrap();
    let all: u64 = metrics.iter().map(|m| metric(last, m["name"].as_str().unwrap())).sum();
    let in_counts = all - metric(last, "lost") - metric(last, "senders");
    assert!(REASONS.iter().all(|reason| metric(last, &format!("refused_{reason}")) > 0), "{last}");
    let taken = line(&report, &format!("ros2:{IMAGES}"), "camera");
    assert_eq!((count(taken, "received"), reported.len() as u64), (in_counts, in_counts), "{taken}");
    let given = line(&report, "head.pose", "ros2:/stillpoint/head_pose");
    assert!(count(given, "received") >= poses.len() as u64, "{given}");

    // Replay needs no network, and compares every sample.
    let replay = bench.call(&["replay", session, "--json"]).good();
    assert_eq!((&replay["identical_all"], &replay["differences"]), (&true.into(), &0.into()), "{replay}");
}

#[test]
fn without_the_program_of_the_bridge_a_live_run_names_its_build_and_a_simulated_run_plays_the_recording() {
    let bench = Bench::new();
    let file = bench.write("ros2.yaml", &pipeline(two_ports()));
    let nowhere = "/nowhere/stillpoint-bridge";
    let done = bench.start_with_bridge(&["run", &file, "--no-record"], nowhere).finish();
    assert!(!done.status.success());
    for words in [nowhere, "with ROS 2", "--manifest-path tools/bridge/Cargo.toml"] {
        assert!(done.err.contains(words), "{}", done.err);
    }
    let simulated = ["run", &file, "--clock", "simulated", "--for", "1s", "--json", "--record", "s"];
    let report = bench.start_with_bridge(&simulated, nowhere).finish().good();
    assert_eq!(report["balanced"], true, "{}", report["ledger"]);
    let session = report["session"].as_str().unwrap();
    assert!(bench.samples(session, "head.pose").len() >= 3);
    assert_eq!(bench.call(&["replay", session, "--json"]).good()["identical_all"], true);
}

/// What `doctor` finds of a setting.
fn finding<'d>(doctor: &'d Value, setting: &str) -> &'d Value {
    let findings = doctor["findings"].as_array().unwrap();
    findings.iter().find(|f| f["setting"] == setting).unwrap_or_else(|| panic!("{setting}: {doctor}"))
}

#[test]
fn doctor_listens_to_the_camera_of_a_pipeline_and_names_what_it_sends() {
    let (bench, port) = (Bench::new(), two_ports());
    let file = bench.write("ros2.yaml", &pipeline(port));
    let doctor = ["doctor", &file, "--for", "1s", "--json"];
    let read = |done: Done| -> (Value, Option<i32>) {
        (serde_json::from_str(&done.out).unwrap_or_else(|e| panic!("{e}: {}", done.err)), done.status.code())
    };

    // Nobody is there: it cannot be known whether the camera will be.
    let (found, _) = read(bench.call(&doctor));
    let router = finding(&found, &format!("router of ROS 2 at tcp/127.0.0.1:{port}"));
    assert_eq!((&router["verdict"], &router["found"]), (&"unknown".into(), &"it does not answer".into()));

    // A router without a camera.
    let _router = session("router", "listen", port);
    let (found, code) = read(bench.call(&doctor));
    let of_images = format!("rate of {IMAGES}");
    let silent = finding(&found, &of_images);
    assert_eq!((&silent["verdict"], code), (&"bad".into(), Some(2)), "{silent}");
    assert!(silent["found"].as_str().unwrap().starts_with("no message"), "{silent}");

    // A camera. The same with an operator that takes messages more slowly than they come.
    let mut peer = Peer::new(port);
    let slow = bench.write("slow.yaml", &pipeline(port).replace("every: 2 ms", "every: 900 ms"));
    for (file, verdict) in [(&file, "good"), (&slow, "bad")] {
        let mut running = bench.start(&["doctor", file, "--for", "3s", "--json"]);
        give_until(&mut peer, "the end of doctor", || running.has_ended());
        let (found, _) = read(running.finish());
        let rate = finding(&found, &of_images);
        let words = rate["found"].as_str().unwrap();
        assert!(words.contains(" Hz, jitter ") && words.contains("messages"), "{rate}");
        // A busy machine sends in bursts, which is a hint.
        let is_hint = verdict == "good" && rate["mend"].as_str().unwrap().contains("bursts");
        assert!(rate["verdict"] == verdict || is_hint, "{rate}");
        if verdict == "bad" {
            assert!(rate["mend"].as_str().unwrap().contains("set `every` of `camera` to"), "{rate}");
        }
        assert_eq!(finding(&found, &format!("description of the camera on {INFOS}"))["verdict"], "good");
    }
}

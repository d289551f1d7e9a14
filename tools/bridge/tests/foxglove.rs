//! A run and a session in a client of the web socket of Foxglove: it subscribes, reads images, poses and logs, and plays,
//! pauses and seeks a session.

use std::collections::BTreeMap;
use std::net::TcpStream;
use std::time::{Duration, Instant};

use foxglove::Decode;
use foxglove::messages::{FrameTransforms, Log, PointCloud, PoseInFrame, RawImage};
use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

use crate::bench::{Bench, Running, udp_ports, wait_for};

const PIPELINE: &str = include_str!("../../../pipeline.yaml");
/// Codes of binary messages of the server, and of the client.
const DATA: u8 = 1;
const STATE: u8 = 5;
const CONTROL: u8 = 3;
const PAUSED: u8 = 1;
const ENDED: u8 = 3;

/// The default pipeline with a small camera, on ports of its own.
fn small_loop(bench: &Bench) -> String {
    let mut yaml = PIPELINE.replace(
        "camera: { every: 100 ms }",
        "camera: { every: 100 ms, width: 320 px, height: 240 px, focal_length: 283 px }",
    );
    let key = format!("{}/../../examples/data/rig.key", env!("CARGO_MANIFEST_DIR"));
    yaml = yaml.replace("examples/data/rig.key", &key);
    for (port, free) in ["127.0.0.1:5005", "127.0.0.1:5006", "127.0.0.1:5008"].iter().zip(udp_ports::<3>()) {
        yaml = yaml.replace(port, &format!("127.0.0.1:{free}"));
    }
    bench.write("loop.yaml", &yaml)
}

/// A client of the protocol.
struct Viewer {
    socket: WebSocket<TcpStream>,
    info: Value,
    /// By name of the topic: number, encoding, name of the schema.
    channels: BTreeMap<String, (u64, String, String)>,
    /// By number of the subscription.
    topics: Vec<String>,
    /// The newest message of each topic: time and content.
    newest: BTreeMap<String, (u64, Vec<u8>)>,
    /// The states of the playback: status, time, whether it sought, request.
    states: Vec<(u8, u64, bool, String)>,
}

impl Viewer {
    /// Connects to what `view` serves, and waits for its topics.
    fn open(view: &Running) -> Self {
        let address = wait_for("the address", || {
            let printed = view.printed();
            Some(printed.split("ws://").nth(1)?.split_whitespace().next()?.to_owned())
        });
        let mut request = format!("ws://{address}").into_client_request().unwrap();
        request.headers_mut().insert("sec-websocket-protocol", "foxglove.sdk.v1".parse().unwrap());
        let stream = TcpStream::connect(&address).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        let (socket, answer) = tungstenite::client(request, stream).unwrap();
        assert_eq!(answer.headers()["sec-websocket-protocol"], "foxglove.sdk.v1");
        let mut viewer = Self {
            socket,
            info: Value::Null,
            channels: BTreeMap::new(),
            topics: Vec::new(),
            newest: BTreeMap::new(),
            states: Vec::new(),
        };
        viewer.until("eight topics", |v| v.channels.len() == 8 && v.info["op"] == "serverInfo");
        viewer
    }

    fn subscribe(&mut self, topics: &[&str]) {
        let first = self.topics.len();
        self.topics.extend(topics.iter().map(|t| (*t).to_owned()));
        let all = (first..).zip(topics).map(|(id, t)| json!({ "id": id, "channelId": self.channels[*t].0 }));
        let text = json!({ "op": "subscribe", "subscriptions": all.collect::<Vec<_>>() }).to_string();
        self.socket.send(Message::text(text)).unwrap();
    }

    /// Reads until something holds.
    fn until(&mut self, what: &str, holds: impl Fn(&Self) -> bool) {
        let begun = Instant::now();
        while !holds(self) {
            assert!(
                begun.elapsed() < Duration::from_secs(100),
                "{what}: {:?} {:?}",
                self.states.last(),
                self.newest.keys()
            );
            match self.socket.read() {
                Ok(Message::Text(text)) => self.take_text(&serde_json::from_str(&text).unwrap()),
                Ok(Message::Binary(bytes)) => self.take_bytes(&bytes),
                Ok(_) => {}
                Err(tungstenite::Error::Io(e)) if e.kind() == std::io::ErrorKind::WouldBlock => {}
                Err(error) => panic!("{what}: {error}"),
            }
        }
    }

    fn take_text(&mut self, text: &Value) {
        match text["op"].as_str().unwrap() {
            "serverInfo" => self.info = text.clone(),
            "advertise" => {
                for channel in text["channels"].as_array().unwrap() {
                    let word = |name: &str| channel[name].as_str().unwrap().to_owned();
                    let id = channel["id"].as_u64().unwrap();
                    self.channels.insert(word("topic"), (id, word("encoding"), word("schemaName")));
                }
            }
            _ => {}
        }
    }

    fn take_bytes(&mut self, bytes: &[u8]) {
        let long = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
        match bytes[0] {
            DATA => {
                let id = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                let content = (long(5), bytes[13..].to_vec());
                self.newest.insert(self.topics[id as usize].clone(), content);
            }
            STATE => {
                let request = String::from_utf8(bytes[19..].to_vec()).unwrap();
                self.states.push((bytes[1], long(2), bytes[14] == 1, request));
            }
            _ => {}
        }
    }

    fn control(&mut self, plays: bool, speed: f32, seek: Option<u64>, request: &str) {
        let mut bytes = vec![CONTROL, u8::from(!plays)];
        bytes.extend_from_slice(&speed.to_le_bytes());
        bytes.push(u8::from(seek.is_some()));
        bytes.extend_from_slice(&seek.unwrap_or(0).to_le_bytes());
        bytes.extend_from_slice(&(request.len() as u32).to_le_bytes());
        bytes.extend_from_slice(request.as_bytes());
        self.socket.send(Message::binary(bytes)).unwrap();
    }

    fn message<M: Decode>(&self, topic: &str) -> M {
        M::decode(&self.newest[topic].1[..]).unwrap_or_else(|_| panic!("{topic}"))
    }

    fn values(&self, topic: &str) -> Value {
        self.newest.get(topic).map_or(Value::Null, |(_, bytes)| serde_json::from_slice(bytes).unwrap())
    }

    /// The image: pixels with more than one colour, and the points of the face in the couch's frame.
    fn check_images(&self) {
        let image: RawImage = self.message("/image");
        assert_eq!((image.width, image.height, image.encoding.as_str()), (320, 240, "rgb8"));
        assert_eq!((image.frame_id.as_str(), image.data.len()), ("camera", 3 * 320 * 240));
        assert!(image.data.chunks(3).any(|pixel| pixel != &image.data[..3]));
        let face: PointCloud = self.message("/face");
        assert_eq!((face.frame_id.as_str(), face.point_stride), ("couch", 12));
        assert!(face.data.len() > 200 * 12);
        // The points of the face lie over the couch.
        let z = face.data.chunks(12).map(|p| f32::from_le_bytes(p[8..12].try_into().unwrap()));
        assert!(z.clone().all(|z| (0.0..0.4).contains(&z)), "{:?}", z.collect::<Vec<_>>());
    }
}

const ALL: [&str; 8] = ["/image", "/face", "/estimate", "/target", "/tf", "/held", "/state", "/log"];

#[test]
fn a_client_of_foxglove_follows_a_run() {
    let bench = Bench::new();
    let run = bench.start(&["run", &small_loop(&bench), "--no-record", "--json"]);
    bench.wait_for_samples("head-3dof", "head.pose", 2);
    let view = bench.start(&["view", "head-3dof", "--foxglove", "--port", "0"]);
    let mut viewer = Viewer::open(&view);
    assert_eq!(viewer.info["name"], "stillpoint: head-3dof");
    assert_eq!(viewer.channels["/image"].1, "protobuf");
    let schema = |topic: &str| viewer.channels[topic].2.clone();
    assert_eq!([schema("/tf"), schema("/held")], ["foxglove.FrameTransforms", "stillpoint.Held"]);
    viewer.subscribe(&ALL);
    viewer.until("all topics", |v| ALL.iter().all(|topic| v.newest.contains_key(*topic)));
    viewer.check_images();
    let head: PoseInFrame = viewer.message("/estimate");
    let position = head.pose.unwrap().position.unwrap();
    assert!(head.frame_id == "couch" && (0.0..0.3).contains(&position.z), "{position:?}");
    let tf: FrameTransforms = viewer.message("/tf");
    assert!(["head", "camera"].contains(&tf.transforms[0].child_frame_id.as_str()), "{tf:?}");
    let log: Log = viewer.message("/log");
    assert!(!log.message.is_empty());
    assert_eq!(viewer.values("/state")["pipeline"], "head-3dof");
    // A second client comes and goes; the first one follows to the end of the run.
    let mut other = Viewer::open(&view);
    other.subscribe(&["/held"]);
    other.until("values", |v| v.newest.contains_key("/held"));
    drop(other);
    let before = viewer.newest["/held"].0;
    viewer.until("later values", |v| v.newest["/held"].0 > before + 300_000_000);
    // The page of another program has the port.
    let port = viewer.socket.get_ref().peer_addr().unwrap().port().to_string();
    let refused = bench.call(&["view", "head-3dof", "--foxglove", "--port", &port]);
    assert!(!refused.status.success() && refused.err.contains("choose another port"), "{}", refused.err);
    assert_eq!(run.stop().good()["balanced"], true);
    assert!(view.finish().status.success());
}

#[test]
fn a_client_of_foxglove_plays_pauses_and_seeks_a_session() {
    let bench = Bench::new();
    let file = small_loop(&bench);
    let report =
        bench.call(&["run", &file, "--clock", "simulated", "--for", "4 s", "--json", "--record", "s"]).good();
    let view = bench.start(&["view", report["session"].as_str().unwrap(), "--foxglove", "--port", "0"]);
    let mut viewer = Viewer::open(&view);
    let capabilities = viewer.info["capabilities"].as_array().unwrap();
    assert!(capabilities.contains(&"playbackControl".into()), "{}", viewer.info);
    let at = |name: &str| {
        let time = &viewer.info[name];
        time["sec"].as_u64().unwrap() * 1_000_000_000 + time["nsec"].as_u64().unwrap()
    };
    let (first, last) = (at("dataStartTime"), at("dataEndTime"));
    assert!((3_500_000_000..=4_100_000_000).contains(&(last - first)), "{first} to {last}");

    // At 0.9 s the valves are not armed yet.
    viewer.control(false, 1.0, Some(first + 900_000_000), "early");
    viewer.subscribe(&ALL);
    let early = first + 900_000_000;
    let answer = (PAUSED, early, true, "early".to_owned());
    viewer.until("the early state", |v| {
        v.states.contains(&answer) && v.values("/held")["valves"] == "disarmed"
    });
    viewer.until("an image", |v| v.newest.contains_key("/image") && v.newest.contains_key("/face"));
    viewer.check_images();
    assert!(early - viewer.newest["/image"].0 <= 200_000_000, "{:?}", viewer.newest["/image"].0);
    assert_eq!(viewer.newest["/held"].0, early);

    // From there it plays to the end, where the valves are armed.
    viewer.control(true, 4.0, None, "play");
    viewer.until("the end", |v| v.states.last().is_some_and(|state| state.0 == ENDED));
    assert_eq!(viewer.states.last().unwrap().1, last);
    viewer.until("the last values", |v| v.values("/held")["valves"] == "armed");
    assert_eq!(viewer.values("/held")["tracker"], "tracked");
    viewer.until("the last image", |v| v.newest["/image"].0 + 300_000_000 > last);

    // Back again.
    viewer.control(false, 1.0, Some(early), "back");
    viewer.until("the early state again", |v| v.values("/held")["valves"] == "disarmed");
    view.stop();
}

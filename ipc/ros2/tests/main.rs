//! Names, bytes and hashes are those that other implementations of the convention make.

#![allow(clippy::unwrap_used, clippy::panic, reason = "a test stops at the first surprise")]

use std::process::Command;

use stillpoint_cdr::schema;
use stillpoint_ros2::{
    Attachment, EndKind, NodePlace, Qos, TopicName, end_token, key, node_token, rihs01, who,
};

/// Made by the crate `hiroz-protocol`, of those who make zenoh, and by the serializer of their Python package. (The crate
/// itself would bring all transports of zenoh into the build of the tests.)
const VECTORS: &str = include_str!("../../../tests/vectors/ros2_convention.json");

#[test]
fn keys_tokens_and_attachments_are_those_of_the_makers_of_zenoh() {
    let vectors: serde_json::Value = serde_json::from_str(VECTORS).unwrap();
    let ends = vectors["ends"].as_array().unwrap();
    assert_eq!(ends.len(), 40);
    for end in ends {
        let text = |name: &str| end[name].as_str().unwrap();
        let (domain, depth) = (end["domain"].as_u64().unwrap() as u32, end["depth"].as_u64().unwrap() as u32);
        let place = NodePlace { domain, session: text("session").to_owned(), name: text("node").to_owned() };
        let topic = TopicName::parse(text("topic")).unwrap();
        assert_eq!(key(domain, &topic, text("type"), text("hash")), text("key"));
        assert_eq!(node_token(&place), text("node_token"));
        let qos = Qos {
            reliable: end["reliable"].as_bool().unwrap(),
            is_latched: end["latched"].as_bool().unwrap(),
            depth,
        };
        let publishes = end["publishes"].as_bool().unwrap();
        let kind = if publishes { EndKind::Publisher } else { EndKind::Subscription };
        let number = end["number"].as_u64().unwrap() as u32;
        let token = end_token(&place, number, kind, &topic, (text("type"), text("hash")), qos);
        assert_eq!(token, text("token"));
        let read = who(&token).unwrap();
        assert_eq!(
            (read.kind, read.topic.as_str(), read.type_name.as_str()),
            (kind, text("topic"), text("type"))
        );
    }
    for vector in vectors["attachments"].as_array().unwrap() {
        let number = |name: &str| vector[name].as_u64().unwrap();
        let bytes = |name: &str| -> Vec<u8> {
            let text = vector[name].as_str().unwrap().as_bytes().chunks(2);
            text.map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
        };
        let gid = bytes("gid").try_into().unwrap();
        let attachment = Attachment { sequence: number("sequence"), time: number("time"), gid };
        assert_eq!(&attachment.to_bytes()[..], bytes("bytes"));
    }
}

/// Prints one line per distribution and type: name and hash. `STILLPOINT_PYTHON` names a Python that has `rosbags`.
const PRINT: &str = "
import sys
from rosbags.typesys import Stores, get_typestore
for name in ['ROS2_IRON', 'ROS2_JAZZY', 'ROS2_KILTED', 'LATEST']:
    if name in Stores.__members__:
        store = get_typestore(Stores[name])
        for of in sys.argv[1:]:
            print(of, store.hash_rihs01(of))
";

#[test]
fn hashes_of_types_are_those_of_rosbags() {
    let Some(python) = std::env::var_os("STILLPOINT_PYTHON") else {
        eprintln!("skipped: STILLPOINT_PYTHON names no Python that has the package `rosbags`");
        return;
    };
    let names = schema::ALL.map(|(name, _)| name);
    let message = Command::new(python).args(["-c", PRINT]).args(names).output().unwrap();
    assert!(message.status.success(), "{}", String::from_utf8_lossy(&message.stderr));
    let message = String::from_utf8(message.stdout).unwrap();
    for (name, text) in schema::ALL {
        let own = rihs01(name, text).unwrap();
        let theirs: Vec<&str> = message
            .lines()
            .filter_map(|line| line.split_once(' '))
            .filter(|l| l.0 == name)
            .map(|l| l.1)
            .collect();
        assert!(theirs.len() >= 2 && theirs.iter().all(|hash| *hash == own), "{name}: {own}, not {theirs:?}");
    }
}

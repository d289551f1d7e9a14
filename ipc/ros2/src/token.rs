//! Liveliness tokens: a key that stands as long as a node, a publisher or a subscription is there.
//!
//! `@ros2_lv/DOMAIN/SESSION/NODE/END/KIND/ENCLAVE/NAMESPACE/NODE NAME`, and of an end of a topic
//! `.../TOPIC/TYPE/HASH/QOS`. A `/` within a part is written as `%`, and an empty part is `%`.

use twox_hash::XxHash3_128;

use crate::names::{TopicName, from_the_wire, on_the_wire};

/// The first part of every token.
const SPACE: &str = "@ros2_lv";
/// What stands for `/`, and for nothing.
const SLASH: &str = "%";
/// The depth that is not written.
const USUAL_DEPTH: u32 = 42;

/// The node of a program, in the root namespace and without an enclave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodePlace {
    /// The domain.
    pub domain: u32,
    /// Identity of the zenoh session.
    pub session: String,
    /// Name of the node, without namespace.
    pub name: String,
}

/// Number of the node within its session.
const NODE: u32 = 0;

/// Which end of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndKind {
    /// It sends.
    Publisher,
    /// It takes.
    Subscription,
}

impl EndKind {
    fn letters(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscription => "MS",
        }
    }
}

/// What an end offers or asks for. What is not named here has the value that ROS 2 gives it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Every message is to arrive; else messages may be lost.
    pub reliable: bool,
    /// Those who come later get the last messages, too.
    pub is_latched: bool,
    /// The most messages that wait.
    pub depth: u32,
}

impl Qos {
    /// What subscriptions of sensor data ask for.
    pub const SENSOR: Self = Self { reliable: false, is_latched: false, depth: 5 };
    /// What publishers offer if they are not told otherwise.
    pub const USUAL: Self = Self { reliable: true, is_latched: false, depth: 10 };
    /// What publishers of static frames offer.
    pub const LATCHED: Self = Self { reliable: true, is_latched: true, depth: 1 };

    fn text(self) -> String {
        let reliability = if self.reliable { "" } else { "2" };
        let depth = if self.depth == USUAL_DEPTH { String::new() } else { self.depth.to_string() };
        let durability = if self.is_latched { "1" } else { "" };
        // Deadline, lifespan and liveliness are the usual ones: none, none, automatic.
        format!("{reliability}:{durability}:,{depth}:,:,:,,")
    }
}

/// The token of a node.
pub fn node_token(place: &NodePlace) -> String {
    token(place, NODE, "NN")
}

/// The token of an end of a topic. `number` tells the ends of a session apart, from 1 on.
pub fn end_token(
    place: &NodePlace,
    number: u32,
    kind: EndKind,
    topic: &TopicName,
    (type_name, hash): (&str, &str),
    qos: Qos,
) -> String {
    let of = token(place, number, kind.letters());
    let topic = topic.as_str().replace('/', SLASH);
    format!("{of}/{topic}/{}/{hash}/{}", on_the_wire(type_name), qos.text())
}

fn token(place: &NodePlace, number: u32, kind: &str) -> String {
    let NodePlace { domain, session, name } = place;
    format!("{SPACE}/{domain}/{session}/{NODE}/{number}/{kind}/{SLASH}/{SLASH}/{name}")
}

/// The key expression of all tokens of a domain.
pub fn tokens(domain: u32) -> String {
    format!("{SPACE}/{domain}/**")
}

/// The identity of a sender in the attachments of its messages: the 128 bits of XXH3 of its token, the low half first.
pub fn gid(token: &str) -> [u8; 16] {
    XxHash3_128::oneshot(token.as_bytes()).to_le_bytes()
}

/// An end of a topic, from a token of another program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ended {
    /// Which end.
    pub kind: EndKind,
    /// Name of the node with its namespace.
    pub node: String,
    /// The topic.
    pub topic: String,
    /// Name of the type.
    pub type_name: String,
}

/// The end that a token stands for; `None` for nodes, services, and what is no token.
pub fn who(token: &str) -> Option<Ended> {
    let parts: Vec<&str> = token.split('/').collect();
    let [SPACE, _domain, _session, _node, _number, kind, _enclave, namespace, name, topic, type_name, ..] =
        parts[..]
    else {
        return None;
    };
    let kind = match kind {
        "MP" => EndKind::Publisher,
        "MS" => EndKind::Subscription,
        _ => return None,
    };
    let plain = |text: &str| text.replace(SLASH, "/");
    let namespace = plain(namespace);
    let node = format!("{}/{}", namespace.trim_end_matches('/'), plain(name));
    Some(Ended { kind, node, topic: plain(topic), type_name: from_the_wire(type_name)? })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn place() -> NodePlace {
        NodePlace { domain: 3, session: "a1b2".to_owned(), name: "head".to_owned() }
    }

    #[test]
    fn tokens_have_all_parts_in_their_order() {
        let topic = TopicName::parse("/a/pose").unwrap();
        let of = ("geometry_msgs/msg/PoseStamped", "RIHS01_00");
        assert_eq!(node_token(&place()), "@ros2_lv/3/a1b2/0/0/NN/%/%/head");
        let end = end_token(&place(), 2, EndKind::Publisher, &topic, of, Qos::USUAL);
        let rest = "%a%pose/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_00/::,10:,:,:,,";
        assert_eq!(end, format!("@ros2_lv/3/a1b2/0/2/MP/%/%/head/{rest}"));
        assert_eq!([Qos::SENSOR.text(), Qos::LATCHED.text()], ["2::,5:,:,:,,", ":1:,1:,:,:,,"]);
        assert_eq!(tokens(3), "@ros2_lv/3/**");
        let read = who(&end).unwrap();
        assert_eq!(
            (read.kind, read.node.as_str(), read.topic.as_str()),
            (EndKind::Publisher, "/head", "/a/pose")
        );
        assert_eq!(read.type_name, of.0);
        assert_eq!(who(&node_token(&place())), None);
    }

    #[test]
    fn a_sender_is_known_by_its_token() {
        // The hash of nothing, as XXH3 publishes it: 99aa06d3014798d86001c324468d497f, its low half last.
        let low = 0x6001_c324_468d_497f_u64.to_le_bytes();
        assert_eq!((gid("")[..8].to_vec(), gid("a") == gid("b")), (low.to_vec(), false));
    }

    proptest! {
        #[test]
        fn any_text_is_a_token_or_none(parts in prop::collection::vec("[a-zA-Z0-9_:%@,]{0,6}", 0..14)) {
            let _ = who(&parts.join("/"));
            let _ = who(&[&["@ros2_lv".to_owned()][..], &parts].concat().join("/"));
        }
    }
}

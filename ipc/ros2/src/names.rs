//! Names of topics, nodes and types, and the keys of publications.

use thiserror::Error;

/// The longest name of a topic, bytes.
const LONGEST: usize = 255;

/// Why a text names no topic of ROS 2.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NameError {
    /// It is relative.
    #[error("it does not begin with `/`")]
    Relative,
    /// It is too long.
    #[error("it has {0} characters, at most {LONGEST} are allowed")]
    Long(usize),
    /// A part of it is no name.
    #[error("its part `{0}` is not a name: letters, digits and `_`, and no digit first")]
    Part(String),
}

/// The name of a topic with all its namespaces: `/camera/depth/image_rect_raw`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TopicName(String);

impl TopicName {
    /// Checks a name.
    ///
    /// # Errors
    /// Why it names no topic.
    pub fn parse(text: &str) -> Result<Self, NameError> {
        let rest = text.strip_prefix('/').ok_or(NameError::Relative)?;
        if text.len() > LONGEST {
            return Err(NameError::Long(text.len()));
        }
        match rest.split('/').find(|part| !is_name(part)) {
            Some(part) => Err(NameError::Part(part.to_owned())),
            None => Ok(Self(text.to_owned())),
        }
    }

    /// The name, `/` first.
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The topic of this name in the same namespace.
    pub fn sibling(&self, name: &str) -> Result<Self, NameError> {
        let namespace = self.0.rsplit_once('/').map_or("", |(namespace, _)| namespace);
        Self::parse(&format!("{namespace}/{name}"))
    }
}

fn is_name(part: &str) -> bool {
    let is_plain = |b: u8| b.is_ascii_alphanumeric() || b == b'_';
    part.bytes().all(is_plain) && part.bytes().next().is_some_and(|first| !first.is_ascii_digit())
}

/// A text as the name of a node: characters that a node's name cannot have become `_`.
pub fn node_name(text: &str) -> String {
    let plain = text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' });
    let name: String = plain.take(LONGEST).collect();
    if is_name(&name) { name } else { format!("_{name}") }
}

/// The name of a type on the wire: `sensor_msgs::msg::dds_::Image_` of `sensor_msgs/msg/Image`.
pub(crate) fn on_the_wire(type_name: &str) -> String {
    match type_name.rsplit_once('/') {
        Some((package, name)) => format!("{}::dds_::{name}_", package.replace('/', "::")),
        None => type_name.to_owned(),
    }
}

/// The name of a type from that on the wire, where it is one.
pub(crate) fn from_the_wire(text: &str) -> Option<String> {
    let (package, name) = text.rsplit_once("::dds_::")?;
    Some(format!("{}/{}", package.replace("::", "/"), name.strip_suffix('_')?))
}

/// The key of the messages of a topic.
pub fn key(domain: u32, topic: &TopicName, type_name: &str, hash: &str) -> String {
    format!("{domain}{}/{}/{hash}", topic.as_str(), on_the_wire(type_name))
}

/// The key expression of the messages of a topic, of whatever type.
pub fn any_type(domain: u32, topic: &TopicName) -> String {
    format!("{domain}{}/*/*", topic.as_str())
}

/// Name of the type, and its hash, of a key.
pub fn type_of_key(key: &str) -> Option<(String, &str)> {
    let (rest, hash) = key.rsplit_once('/')?;
    let (_, type_name) = rest.rsplit_once('/')?;
    Some((from_the_wire(type_name)?, hash))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_that_are_none_are_refused_with_their_part() {
        for (text, error) in [
            ("camera", NameError::Relative),
            ("/", NameError::Part(String::new())),
            ("/a//b", NameError::Part(String::new())),
            ("/a/", NameError::Part(String::new())),
            ("/a/2b", NameError::Part("2b".to_owned())),
            ("/a/**", NameError::Part("**".to_owned())),
            ("/~/a", NameError::Part("~".to_owned())),
        ] {
            assert_eq!(TopicName::parse(text), Err(error), "{text}");
        }
        assert_eq!(TopicName::parse(&format!("/{}", "a".repeat(300))), Err(NameError::Long(301)));
        let topic = TopicName::parse("/camera/depth/image_rect_raw").unwrap();
        assert_eq!(topic.sibling("camera_info").unwrap().as_str(), "/camera/depth/camera_info");
        assert_eq!(
            TopicName::parse("/image").unwrap().sibling("camera_info").unwrap().as_str(),
            "/camera_info"
        );
    }

    #[test]
    fn nodes_get_names_that_ros_takes() {
        let named = ["head-3dof", "3d", "", "a.b/c"].map(node_name);
        assert_eq!(named, ["head_3dof", "_3d", "_", "a_b_c"]);
    }

    #[test]
    fn a_key_tells_its_type() {
        let topic = TopicName::parse("/a/b").unwrap();
        let of = key(7, &topic, "sensor_msgs/msg/Image", "RIHS01_00");
        assert_eq!(of, "7/a/b/sensor_msgs::msg::dds_::Image_/RIHS01_00");
        assert_eq!(type_of_key(&of), Some(("sensor_msgs/msg/Image".to_owned(), "RIHS01_00")));
        assert_eq!(type_of_key("0/a/b/Image/hash"), None);
        assert_eq!(any_type(7, &topic), "7/a/b/*/*");
    }

    proptest! {
        #[test]
        fn any_text_is_a_name_or_refused(text in "/?[a-z0-9_/*~$ ]{0,12}", any in ".*") {
            for text in [text, any] {
                if let Ok(name) = TopicName::parse(&text) {
                    prop_assert_eq!(name.as_str(), text.as_str());
                }
                prop_assert!(is_name(&node_name(&text)));
                let _ = type_of_key(&text);
            }
        }
    }
}

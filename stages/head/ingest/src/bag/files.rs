//! The MCAP files of a recording.

use stillpoint_operator::Files;
use stillpoint_operator::config::faults::Findings;
use stillpoint_operator::config::tree::{Node, Value};
use stillpoint_operator::config::yaml;

use super::walk::{Message, Walk};
use crate::checks::quoted;

const METADATA: &str = "metadata.yaml";
/// What to do with a recording in a database.
const CONVERT: &str = "its storage is sqlite3, which is not read: convert it to MCAP with `rosbags-convert --src BAG --dst \
                       NEW --dst-storage mcap`, or with `ros2 bag convert`";

/// Why a recording cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OpenError {
    /// A file of it cannot be read.
    #[error("{0}")]
    Unreadable(String),
    /// It is no recording in MCAP.
    #[error("{0}")]
    Other(String),
}

impl From<String> for OpenError {
    fn from(reason: String) -> Self {
        Self::Other(reason)
    }
}

/// A recording, in memory. A file is in it once.
pub struct Bag {
    /// Its files: name and bytes.
    pub files: Vec<(String, Vec<u8>)>,
    /// Files that its list names more than once.
    pub repeated: Vec<String>,
}

impl Bag {
    /// Reads the file, or the files of the folder, of this name.
    ///
    /// # Errors
    /// A file that cannot be read, or a folder that is no recording in MCAP.
    pub fn open(files: &dyn Files, place: &str) -> Result<Self, OpenError> {
        let read = |name: &str| files.read(name).map_err(|e| OpenError::Unreadable(format!("{name}: {e}")));
        let mut repeated = Vec::new();
        let found = files.list(place).map_err(OpenError::Unreadable)?;
        let named = match &found[..] {
            [one] if last(one) == METADATA => {
                return Err("name the folder of this file, not the file".to_owned().into());
            }
            [one] if is_database(one) => return Err(CONVERT.to_owned().into()),
            [one] => vec![one.clone()],
            several => match several.iter().find(|name| last(name) == METADATA) {
                Some(metadata) => listed(&read(metadata)?, several, &mut repeated)
                    .map_err(|e| format!("{metadata}: {e}"))?,
                None => several.iter().filter(|name| name.ends_with(".mcap")).cloned().collect(),
            },
        };
        if named.is_empty() {
            return Err(match found.iter().any(|name| is_database(name)) {
                true => CONVERT.to_owned().into(),
                false => "it has no MCAP file".to_owned().into(),
            });
        }
        let files = named.into_iter().map(|name| Ok((read(&name)?, name)));
        let files: Result<Vec<_>, OpenError> = files.map(|f| f.map(|(bytes, name)| (name, bytes))).collect();
        Ok(Self { files: files?, repeated })
    }

    /// The messages of all files, each with the numbers of its file and of its place in it.
    pub fn messages(&self) -> impl Iterator<Item = Result<((usize, u64), Message), String>> {
        self.files.iter().enumerate().flat_map(|(file, (name, bytes))| {
            let each = Walk::new(name, bytes).zip(0..);
            each.map(move |(message, number)| message.map(|m| ((file, number), m)))
        })
    }
}

/// The files that a `metadata.yaml` lists, which must be among those that are there.
fn listed(metadata: &[u8], there: &[String], repeated: &mut Vec<String>) -> Result<Vec<String>, String> {
    let text = std::str::from_utf8(metadata).map_err(|e| e.to_string())?;
    let findings = Findings::default();
    let root = yaml::parse(text, 0, 0, &findings).filter(|_| findings.is_empty());
    let root = root.ok_or(
        "it is not YAML that is read: empty, damaged, or with anchors or tags, which rosbag2 does not write",
    )?;
    let bag = entry(&root, "rosbag2_bagfile_information")
        .ok_or("it has no `rosbag2_bagfile_information`: it is of no bag")?;
    match entry(bag, "storage_identifier").and_then(text_of) {
        Some("mcap") => {}
        Some("sqlite3") => return Err(CONVERT.into()),
        other => return Err(format!("its storage is {}, not mcap", other.unwrap_or("not named"))),
    }
    let mode = entry(bag, "compression_mode").and_then(text_of).unwrap_or_default();
    if mode.eq_ignore_ascii_case("file") || mode.eq_ignore_ascii_case("message") {
        return Err(format!(
            "rosbag2 compressed it by {}, which is not read: convert it with `ros2 bag convert` without \
             `compression_mode`; MCAP compresses its chunks itself",
            mode.to_ascii_lowercase()
        ));
    }
    let Some(Value::List(paths)) = entry(bag, "relative_file_paths").map(|node| &node.value) else {
        return Err("it has no `relative_file_paths`".into());
    };
    let mut names = Vec::new();
    for path in paths.iter().filter_map(text_of) {
        // Bags of ROS 2 Dashing name the folder, too.
        let found = there.iter().find(|name| last(name) == last(path));
        let found = found.ok_or_else(|| format!("it lists {}, which is not there", quoted(path)))?;
        // A list that was written by hand or by a conversion may name a file twice; it is played once.
        let to = if names.contains(found) { &mut *repeated } else { &mut names };
        to.push(found.clone());
    }
    Ok(names)
}

fn entry<'a>(node: &'a Node, key: &str) -> Option<&'a Node> {
    let Value::Map(entries) = &node.value else { return None };
    entries.iter().find(|e| e.key.value == key).map(|e| &e.value)
}

fn text_of(node: &Node) -> Option<&str> {
    match &node.value {
        Value::Text(text) => Some(text),
        _ => None,
    }
}

fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

fn is_database(name: &str) -> bool {
    name.ends_with(".db3")
}

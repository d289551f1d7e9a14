//! The MCAP files of a recording.

use stillpoint_operator::Files;
use stillpoint_operator::config::faults::Findings;
use stillpoint_operator::config::tree::{Node, Value};
use stillpoint_operator::config::yaml;

use super::walk::{Message, Walk, WalkError};
use crate::checks::quoted;

const METADATA: &str = "metadata.yaml";
/// Why a recording cannot be opened.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum OpenError {
    /// A file of it cannot be read.
    #[error("{0}")]
    Unreadable(String),
    /// The list of its files is named, not their folder.
    #[error("name the folder of this file, not the file")]
    NamesMetadata,
    /// It is in a database.
    #[error("{DATABASE}")]
    Database,
    /// Its folder has no recording.
    #[error("it has no MCAP file")]
    NoMcap,
    /// The list of its files is wrong.
    #[error("{file}: {fault}")]
    Metadata {
        /// The list.
        file: String,
        /// What is wrong with it.
        fault: MetadataFault,
    },
}

/// What is wrong with a `metadata.yaml`.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MetadataFault {
    /// It is not text.
    #[error(transparent)]
    Text(#[from] std::str::Utf8Error),
    /// It is not YAML.
    #[error(
        "it is not YAML that is read: empty, damaged, or with anchors or tags, which rosbag2 does not write"
    )]
    Yaml,
    /// It has another content.
    #[error("it has no `rosbag2_bagfile_information`: it is of no bag")]
    NoBag,
    /// The recording is in a database.
    #[error("{DATABASE}")]
    Database,
    /// The recording is in another form.
    #[error("its storage is {0}, not mcap")]
    Storage(String),
    /// The recording is compressed outside of MCAP.
    #[error(
        "rosbag2 compressed it by {0}, which is not read: convert it with `ros2 bag convert` without `compression_mode`; MCAP \
         compresses its chunks itself"
    )]
    Compressed(String),
    /// It lists no files.
    #[error("it has no `relative_file_paths`")]
    NoPaths,
    /// A file of it is missing.
    #[error("it lists {}, which is not there", quoted(.0))]
    Missing(String),
}

/// What is wrong with a recording in a database, and what to do with it.
const DATABASE: &str = "its storage is sqlite3, which is not read: convert it to MCAP with `rosbags-convert --src BAG --dst \
                        NEW --dst-storage mcap`, or with `ros2 bag convert`";

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
        let found = files.list(place).map_err(|e| OpenError::Unreadable(e.to_string()))?;
        let named = match &found[..] {
            [one] if last(one) == METADATA => return Err(OpenError::NamesMetadata),
            [one] if is_database(one) => return Err(OpenError::Database),
            [one] => vec![one.clone()],
            several => match several.iter().find(|name| last(name) == METADATA) {
                Some(metadata) => listed(&read(metadata)?, several, &mut repeated)
                    .map_err(|fault| OpenError::Metadata { file: metadata.clone(), fault })?,
                None => several.iter().filter(|name| name.ends_with(".mcap")).cloned().collect(),
            },
        };
        if named.is_empty() {
            return Err(match found.iter().any(|name| is_database(name)) {
                true => OpenError::Database,
                false => OpenError::NoMcap,
            });
        }
        let files = named.into_iter().map(|name| Ok((read(&name)?, name)));
        let files: Result<Vec<_>, OpenError> = files.map(|f| f.map(|(bytes, name)| (name, bytes))).collect();
        Ok(Self { files: files?, repeated })
    }

    /// The messages of all files, each with the numbers of its file and of its place in it.
    pub fn messages(&self) -> impl Iterator<Item = Result<((usize, u64), Message), WalkError>> {
        self.files.iter().enumerate().flat_map(|(file, (name, bytes))| {
            let each = Walk::new(name, bytes).zip(0..);
            each.map(move |(message, number)| message.map(|m| ((file, number), m)))
        })
    }
}

/// The files that a `metadata.yaml` lists, which must be among those that are there.
fn listed(
    metadata: &[u8],
    there: &[String],
    repeated: &mut Vec<String>,
) -> Result<Vec<String>, MetadataFault> {
    let text = std::str::from_utf8(metadata)?;
    let findings = Findings::default();
    let root = yaml::parse(text, 0, 0, &findings).filter(|_| findings.is_empty());
    let root = root.ok_or(MetadataFault::Yaml)?;
    let bag = entry(&root, "rosbag2_bagfile_information").ok_or(MetadataFault::NoBag)?;
    match entry(bag, "storage_identifier").and_then(text_of) {
        Some("mcap") => {}
        Some("sqlite3") => return Err(MetadataFault::Database),
        other => return Err(MetadataFault::Storage(other.unwrap_or("not named").to_owned())),
    }
    let mode = entry(bag, "compression_mode").and_then(text_of).unwrap_or_default();
    if mode.eq_ignore_ascii_case("file") || mode.eq_ignore_ascii_case("message") {
        return Err(MetadataFault::Compressed(mode.to_ascii_lowercase()));
    }
    let Some(Value::List(paths)) = entry(bag, "relative_file_paths").map(|node| &node.value) else {
        return Err(MetadataFault::NoPaths);
    };
    let mut names = Vec::new();
    for path in paths.iter().filter_map(text_of) {
        // Bags of ROS 2 Dashing name the folder, too.
        let found = there.iter().find(|name| last(name) == last(path));
        let found = found.ok_or_else(|| MetadataFault::Missing(path.to_owned()))?;
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

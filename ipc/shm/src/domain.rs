//! A domain: one run's corner of shared memory.

use std::os::unix::fs::DirBuilderExt;
use std::path::Path;

use iceoryx2::config::Config;
use iceoryx2::node::NodeView;
use iceoryx2::prelude::*;
use iceoryx2::service::ipc;

use crate::error::{ShmError, name_error};
use crate::node_counter::{self, SHARED};

/// Name of the node of a program that joins a run without being a part of it. No process of a pipeline has this name.
pub const VISITOR: &str = "visitor.attached";

/// One run's corner of shared memory: its own prefix and root folder, so that runs do not see each other.
pub struct Domain {
    pub(crate) node: Node<ipc::Service>,
}

impl Domain {
    /// Creates the domain of this prefix and root folder, and joins it as its first node. The supervisor does it, before
    /// any other process starts.
    ///
    /// # Errors
    /// iceoryx2 does not take the names, or refuses the node; or an object of the domain belongs to another user.
    pub fn create(root: &Path, prefix: &str, node: &str) -> Result<Self, ShmError> {
        node_counter::check_free(prefix)?;
        keep_in_memory(root, prefix);
        let domain = Self::with_node(root, prefix, node)?;
        node_counter::make_private(prefix)?;
        Ok(domain)
    }

    /// Joins a domain as a new node. Every participant of a run must join with the prefix and root folder that it was
    /// created with, and through here: foreign settings would clean up samples of dead publishers too early.
    ///
    /// # Errors
    /// The domain is not there, or other users could write to it; iceoryx2 refuses the node.
    pub fn join(root: &Path, prefix: &str, node: &str) -> Result<Self, ShmError> {
        node_counter::check(prefix)?;
        let domain = Self::with_node(root, prefix, node)?;
        node_counter::check_joined(prefix)?;
        Ok(domain)
    }

    fn with_node(root: &Path, prefix: &str, node: &str) -> Result<Self, ShmError> {
        // Set before the first call: iceoryx2 says on stderr what is returned as an error too.
        set_log_level(LogLevel::Fatal);
        let config = config(root, prefix)?;
        let name = NodeName::new(node).map_err(|_| name_error(node))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(&config)
            // Signals are the command's: Ctrl-C ends a run in order.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| ShmError::Node { root: root.to_owned(), cause: e.into() })?;
        Ok(Self { node })
    }

    /// Gives the ports of programs back that joined a run as [`VISITOR`] and were killed: others could not attach any more.
    /// Nobody waits for samples of theirs.
    pub fn clean_dead_visitors(&self) {
        let _ = Node::<ipc::Service>::list(self.node.config(), |node| {
            if let NodeState::Dead(dead) = node
                && dead.details().as_ref().is_some_and(|of| of.name().as_str() == VISITOR)
            {
                let _ = dead.try_remove_stale_resources();
            }
            CallbackProgression::Continue
        });
    }

    /// Gives the ports and memory of dead nodes back. Only the supervisor calls it, after every consumer has connected
    /// to what the dead left: samples that nobody has connected to vanish here. What the processes `but` left stays. One
    /// that cannot be cleaned now is left to the next call.
    pub fn clean_dead_nodes(&self, but: &[u32]) {
        let _ = Node::<ipc::Service>::list(self.node.config(), |node| {
            if let NodeState::Dead(dead) = node
                && !dead.id().pid::<ipc::Service>().is_ok_and(|id| but.contains(&id.value().cast_unsigned()))
            {
                let _ = dead.try_remove_stale_resources();
            }
            CallbackProgression::Continue
        });
    }
}

/// Makes the root folder a link into memory. iceoryx2 writes three small files for each topic that a process opens, and
/// waits until the disk has each: with hundreds of topics that is most of a start. Where the link cannot be made, iceoryx2
/// makes the folder on the disk.
fn keep_in_memory(root: &Path, prefix: &str) {
    let folder = Path::new(SHARED).join(format!("{prefix}root"));
    // A folder that is there already may be another user's.
    if std::fs::DirBuilder::new().mode(0o700).create(&folder).is_ok()
        && std::os::unix::fs::symlink(&folder, root).is_err()
    {
        let _ = std::fs::remove_dir(&folder);
    }
}

/// Removes what a dead run left: its root folder, and its objects in `/dev/shm`. Nobody may still run in it.
/// Returns how many objects were removed.
pub fn sweep(root: &Path, prefix: &str) -> usize {
    let mut removed = 0;
    if prefix.is_empty() {
        return 0;
    }
    if let Ok(objects) = std::fs::read_dir(SHARED) {
        for object in objects.flatten() {
            // The root folder may be among them; of a link, the link alone is removed below.
            let is_folder = object.file_type().is_ok_and(|kind| kind.is_dir());
            let remove: fn(&Path) -> std::io::Result<()> = if is_folder {
                |path| std::fs::remove_dir_all(path)
            } else {
                |path| std::fs::remove_file(path)
            };
            if object.file_name().to_string_lossy().starts_with(prefix) && remove(&object.path()).is_ok() {
                removed += 1;
            }
        }
    }
    if std::fs::remove_dir_all(root).is_ok() {
        removed += 1;
    }
    removed
}

fn config(root: &Path, prefix: &str) -> Result<Config, ShmError> {
    // Not `Config::default()`'s look-up: a file in the current folder must not change a run.
    let mut config = Config::default();
    config.global.prefix = FileName::new(prefix.as_bytes()).map_err(|_| name_error(prefix))?;
    let root = root.display().to_string();
    let path = iceoryx2::prelude::Path::new(root.as_bytes()).map_err(|_| name_error(&root))?;
    config.global.set_root_path(&path);
    // A dead publisher's samples vanish when any process cleans up before the consumers have connected. The
    // supervisor alone cleans, when they have.
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    Ok(config)
}

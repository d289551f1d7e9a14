//! A domain: one run's corner of shared memory.

use std::path::Path;

use iceoryx2::config::Config;
use iceoryx2::node::NodeView;
use iceoryx2::prelude::*;
use iceoryx2::service::ipc;

use crate::ShmError;
use crate::words::words;

/// One run's corner of shared memory: its own prefix and root folder, so that runs do not see each other.
pub struct Domain {
    pub(crate) node: Node<ipc::Service>,
}

impl Domain {
    /// Joins the domain of this prefix and root folder as a new node. Every participant of a run must join with the
    /// same two, and through here: foreign settings would clean up samples of dead publishers too early.
    pub fn join(root: &Path, prefix: &str, node: &str) -> Result<Self, ShmError> {
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
            .map_err(|e| ShmError::Node { root: root.display().to_string(), reason: words(&e) })?;
        Ok(Self { node })
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

/// Removes what a dead run left: its root folder, and its objects in `/dev/shm`. Nobody may still run in it.
/// Returns how many objects were removed.
pub fn sweep(root: &Path, prefix: &str) -> usize {
    let mut removed = 0;
    if prefix.is_empty() {
        return 0;
    }
    if let Ok(objects) = std::fs::read_dir("/dev/shm") {
        for object in objects.flatten() {
            if object.file_name().to_string_lossy().starts_with(prefix)
                && std::fs::remove_file(object.path()).is_ok()
            {
                removed += 1;
            }
        }
    }
    if std::fs::remove_dir_all(root).is_ok() {
        removed += 1;
    }
    removed
}

/// A name that iceoryx2 does not take: it gives no more than that.
pub(crate) fn name_error(name: &str) -> ShmError {
    ShmError::Name { name: name.to_string() }
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

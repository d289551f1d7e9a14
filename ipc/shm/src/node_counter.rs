//! The object in which iceoryx2 counts the nodes of a domain.
//!
//! iceoryx2 creates it with mode 0666 whatever the umask says, and waits without a limit for an object of length zero.
//! So another user of the machine could cut it and thereby stop every process that joins. The process that creates a
//! domain replaces the object by one of mode 0600: a descriptor that was opened before names a file that nobody uses.
//! A process that joins looks at the object first, and does not start to wait for one that cannot be used.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::{CounterFault, ShmError};

/// Where POSIX shared memory is.
pub(crate) const SHARED: &str = "/dev/shm";
/// The end of the object's name. iceoryx2 writes the prefix of the domain, a hash, `_node`, its version and this.
const END: &str = ".global_mgmt";
/// The version of iceoryx2 as a number, and the count: it is longer than this.
const SHORTEST: u64 = 12;
/// Nothing in it is read beyond this: an object of another length is damaged.
const LONGEST: u64 = 4096;

/// Refuses a domain whose object is there already and belongs to another user.
pub(crate) fn check_free(prefix: &str) -> Result<(), ShmError> {
    let user = rustix::process::getuid().as_raw();
    for (object, owner) in find(prefix)? {
        if owner != user {
            return Err(fault(&object, CounterFault::OtherOwner { owner, user }));
        }
    }
    Ok(())
}

/// Replaces the object that iceoryx2 just created by one that only this user may open.
pub(crate) fn make_private(prefix: &str) -> Result<(), ShmError> {
    let object = own(prefix)?;
    let say = |e: io::Error| fault(&object, CounterFault::Io(Arc::new(e)));
    let bytes = read(&object)?;
    let draft = Path::new(SHARED).join(format!("{prefix}private"));
    let replaced = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&draft)
        .and_then(|mut file| file.write_all(&bytes))
        .and_then(|()| std::fs::rename(&draft, &object));
    replaced.map_err(|e| {
        let _ = std::fs::remove_file(&draft);
        say(e)
    })
}

/// Refuses a domain whose object is not there, is open to other users, or is cut: iceoryx2 would wait for it.
pub(crate) fn check(prefix: &str) -> Result<(), ShmError> {
    let object = own(prefix)?;
    let found = object.metadata().map_err(|e| fault(&object, CounterFault::Io(Arc::new(e))))?;
    let mode = found.mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(fault(&object, CounterFault::OpenToOthers { mode }));
    }
    read(&object).map(drop)
}

/// Refuses a domain that ended while this process joined it: iceoryx2 then created the object anew, open to all, and
/// nobody would remove it any more.
pub(crate) fn check_joined(prefix: &str) -> Result<(), ShmError> {
    check(prefix).map_err(|e| match e {
        ShmError::NodeCounter { object, fault: CounterFault::OpenToOthers { .. } } => {
            let _ = std::fs::remove_file(&object);
            fault(&object, CounterFault::NotThere)
        }
        e => e,
    })
}

/// What the object holds.
fn read(object: &Path) -> Result<Vec<u8>, ShmError> {
    let mut bytes = Vec::new();
    let read = File::open(object).and_then(|file| file.take(LONGEST).read_to_end(&mut bytes));
    read.map_err(|e| fault(object, CounterFault::Io(Arc::new(e))))?;
    let size = bytes.len() as u64;
    let has_version = bytes.first_chunk::<8>().is_some_and(|version| *version != [0; 8]);
    if !(SHORTEST..LONGEST).contains(&size) || !has_version {
        return Err(fault(object, CounterFault::Damaged { size }));
    }
    Ok(bytes)
}

/// The object of this user.
fn own(prefix: &str) -> Result<PathBuf, ShmError> {
    let user = rustix::process::getuid().as_raw();
    let own = find(prefix)?.into_iter().find(|(_, owner)| *owner == user);
    let absent = || Path::new(SHARED).join(format!("{prefix}*{END}"));
    own.map(|(object, _)| object).ok_or_else(|| fault(&absent(), CounterFault::NotThere))
}

/// Objects of that name with their owners.
fn find(prefix: &str) -> Result<Vec<(PathBuf, u32)>, ShmError> {
    let objects =
        std::fs::read_dir(SHARED).map_err(|e| fault(Path::new(SHARED), CounterFault::Io(Arc::new(e))))?;
    let is_counter = |name: &str| name.starts_with(prefix) && name.ends_with(END);
    let objects = objects.flatten().filter(|o| is_counter(&o.file_name().to_string_lossy()));
    Ok(objects.filter_map(|o| Some((o.path(), o.metadata().ok()?.uid()))).collect())
}

fn fault(object: &Path, fault: CounterFault) -> ShmError {
    ShmError::NodeCounter { object: object.to_owned(), fault }
}

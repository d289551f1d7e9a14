//! Messages of another program on this host, over a stream socket of the Unix domain.
//!
//! It is the receiving end alone: the senders are programs of others, in any language. One of them sends at a time.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use crate::{LinkState, Origin, Receiver, TransportError};

/// Bytes before the content of a message: its beginning, and the length of the content (`u32`, little-endian).
const HEAD: usize = 8;
/// Bytes that are read at once.
const CHUNK: usize = 1 << 16;
/// Who may send: the user of the run.
const MODE: u32 = 0o600;

/// Takes the messages of one program at a time, whole, with the bytes before their content.
///
/// What is no message ends the connection, after a line of text that says why. As much of it as arrived is given out, so
/// that whoever takes the messages can count it: a head with another beginning or too long a content, or a part of a
/// message whose sender is gone.
pub struct StreamReceiver {
    path: PathBuf,
    beginning: [u8; 4],
    longest: usize,
    listener: Option<UnixListener>,
    sender: Option<UnixStream>,
    /// The message that is arriving.
    partial: Vec<u8>,
}

impl StreamReceiver {
    /// Listens at a path, for messages with this beginning and of at most `longest` bytes. A socket that a program left there
    /// which has ended is replaced.
    ///
    /// # Errors
    /// Another program listens there, or the system refuses.
    pub fn listen(path: &str, beginning: [u8; 4], longest: usize) -> Result<Self, TransportError> {
        let refused = |reason: String| TransportError::Socket { path: path.to_owned(), reason };
        let is_socket = std::fs::symlink_metadata(path).map(|m| m.file_type().is_socket());
        match is_socket {
            Ok(true) if UnixStream::connect(path).is_ok() => {
                return Err(refused("a program listens there already".to_owned()));
            }
            Ok(false) => return Err(refused("there is a file that is not a socket".to_owned())),
            _ => {}
        }
        let listener = bound(Path::new(path)).map_err(|e| refused(e.to_string()))?;
        let (path, partial) = (PathBuf::from(path), Vec::new());
        Ok(Self { path, beginning, longest, listener: Some(listener), sender: None, partial })
    }

    /// The next program that has connected.
    fn accepted(&self) -> Result<Option<UnixStream>, TransportError> {
        let Some(listener) = &self.listener else { return Err(TransportError::Closed) };
        loop {
            match listener.accept() {
                Ok((stream, _)) if stream.set_nonblocking(true).is_ok() => return Ok(Some(stream)),
                Ok(_) => {}
                Err(e) if e.kind() == ErrorKind::WouldBlock => return Ok(None),
                Err(e) if matches!(e.kind(), ErrorKind::Interrupted | ErrorKind::ConnectionAborted) => {}
                Err(e) => return Err(TransportError::Receive { reason: e.to_string() }),
            }
        }
    }

    /// Reads what has arrived. Whether `partial` is to be given out.
    fn read(&mut self) -> bool {
        loop {
            let Some(stream) = &mut self.sender else { return false };
            let length = self.partial.get(4..HEAD).and_then(|l| l.first_chunk());
            let needed = HEAD + length.map_or(0, |l| u32::from_le_bytes(*l) as usize);
            let have = self.partial.len();
            if have >= HEAD {
                let fault = match self.partial.starts_with(&self.beginning) {
                    false => Some("this is not the beginning of a message"),
                    true if needed > self.longest => Some("the message is too long"),
                    true => None,
                };
                if let Some(fault) = fault {
                    answer(stream, fault);
                    self.sender = None;
                    return true;
                }
                if have == needed {
                    return true;
                }
            }
            self.partial.resize(have + (needed - have).min(CHUNK), 0);
            let read = stream.read(&mut self.partial[have..]);
            self.partial.truncate(have + *read.as_ref().unwrap_or(&0));
            match read {
                Ok(0) => {
                    self.sender = None;
                    return have > 0;
                }
                Ok(_) => {}
                Err(e) if e.kind() == ErrorKind::WouldBlock => return false,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(_) => {
                    self.sender = None;
                    return have > 0;
                }
            }
        }
    }
}

/// A socket at a path that only this user may connect to, from its first moment on.
fn bound(path: &Path) -> std::io::Result<UnixListener> {
    let mut new = path.as_os_str().to_owned();
    new.push(format!(".{}", std::process::id()));
    let _ = std::fs::remove_file(&new);
    let listener = UnixListener::bind(&new)?;
    listener.set_nonblocking(true)?;
    std::fs::set_permissions(&new, std::fs::Permissions::from_mode(MODE))?;
    std::fs::rename(&new, path)?;
    Ok(listener)
}

/// Tells the other program why nothing more is taken from it, as far as that goes without waiting.
fn answer(mut stream: &UnixStream, why: &str) {
    let _ = stream.write(format!("refused: {why}\n").as_bytes());
}

impl Receiver for StreamReceiver {
    fn receive(&mut self, bytes: &mut Vec<u8>) -> Result<Option<Origin>, TransportError> {
        let mut is_whole = self.read();
        // Whether a program is gone is known only after all that it sent: until then the next one waits.
        while !is_whole && self.sender.is_none() {
            self.partial.clear();
            self.sender = self.accepted()?;
            if self.sender.is_none() {
                return Ok(None);
            }
            is_whole = self.read();
        }
        if !is_whole && let Some(other) = self.accepted()? {
            answer(&other, "another program sends already");
        }
        if !is_whole {
            return Ok(None);
        }
        std::mem::swap(bytes, &mut self.partial);
        self.partial.clear();
        Ok(Some(Origin { sender: None }))
    }

    fn discarded(&mut self) -> u64 {
        0
    }

    fn keeps_waiting(&self) -> bool {
        true
    }

    fn state(&self) -> LinkState {
        match (&self.listener, &self.sender) {
            (None, _) => LinkState::Closed,
            (_, None) => LinkState::Waiting,
            (_, Some(_)) => LinkState::Open,
        }
    }

    fn close(&mut self) {
        if self.listener.take().is_some() {
            self.sender = None;
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

impl Drop for StreamReceiver {
    fn drop(&mut self) {
        self.close();
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::panic)]

    use super::*;

    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let folder =
                std::env::temp_dir().join(format!("stillpoint-stream-{name}-{}", std::process::id()));
            std::fs::create_dir_all(&folder).unwrap();
            Self(folder)
        }

        fn socket(&self) -> String {
            self.0.join("s").to_str().unwrap().to_owned()
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    fn message(content: &[u8]) -> Vec<u8> {
        [b"TEST", &(content.len() as u32).to_le_bytes()[..], content].concat()
    }

    /// The next message; what was written before the call has arrived.
    fn next(receiver: &mut StreamReceiver) -> Option<Vec<u8>> {
        let mut bytes = Vec::new();
        receiver.receive(&mut bytes).unwrap().map(|_| bytes)
    }

    #[test]
    fn messages_arrive_whole_in_their_order_from_one_program_after_the_other() {
        let folder = Folder::new("whole");
        let mut receiver = StreamReceiver::listen(&folder.socket(), *b"TEST", 1 << 20).unwrap();
        let mode = std::fs::metadata(folder.socket()).unwrap().permissions().mode();
        assert_eq!((mode & 0o777, receiver.state()), (MODE, LinkState::Waiting));
        let mut first = UnixStream::connect(folder.socket()).unwrap();
        let all = [message(b"one"), message(b""), message(&[7; 100_000])].concat();
        first.write_all(&all[..20]).unwrap();
        assert_eq!(next(&mut receiver), Some(message(b"one")));
        assert_eq!(next(&mut receiver), Some(message(b"")));
        assert_eq!((next(&mut receiver), receiver.state()), (None, LinkState::Open));
        first.write_all(&all[20..]).unwrap();
        assert_eq!(next(&mut receiver).map(|m| m.len()), Some(100_008));
        // Programs that were there and are gone before anyone looked hold nobody up.
        drop(first);
        drop(UnixStream::connect(folder.socket()).unwrap());
        let mut second = UnixStream::connect(folder.socket()).unwrap();
        second.write_all(&message(b"two")).unwrap();
        drop(second);
        let mut third = UnixStream::connect(folder.socket()).unwrap();
        third.write_all(&message(b"three")).unwrap();
        assert_eq!(next(&mut receiver), Some(message(b"two")));
        assert_eq!(next(&mut receiver), Some(message(b"three")));
    }

    #[test]
    fn what_is_no_message_ends_the_connection_with_the_cause_and_is_given_out() {
        let folder = Folder::new("cause");
        let mut receiver = StreamReceiver::listen(&folder.socket(), *b"TEST", 100).unwrap();
        let mut said = |sent: &[u8], given: &[u8], cause: &str| {
            let mut sender = UnixStream::connect(folder.socket()).unwrap();
            sender.write_all(sent).unwrap();
            assert_eq!(next(&mut receiver).as_deref(), Some(given));
            let mut answer = String::new();
            sender.read_to_string(&mut answer).unwrap();
            assert_eq!(answer, format!("refused: {cause}\n"));
        };
        said(b"GET / HT", b"GET / HT", "this is not the beginning of a message");
        let long = message(&[0; 93]);
        said(&long[..8], &long[..8], "the message is too long");
        // One that ends early is given out as far as it came.
        let mut sender = UnixStream::connect(folder.socket()).unwrap();
        sender.write_all(b"TEST\x05\0\0\0ab").unwrap();
        assert_eq!(next(&mut receiver), None);
        // A second program is told to go.
        let mut other = UnixStream::connect(folder.socket()).unwrap();
        assert_eq!(next(&mut receiver), None);
        let mut answer = String::new();
        other.read_to_string(&mut answer).unwrap();
        assert_eq!(answer, "refused: another program sends already\n");
        drop(sender);
        assert_eq!(next(&mut receiver).as_deref(), Some(&b"TEST\x05\0\0\0ab"[..]));
        assert_eq!((next(&mut receiver), receiver.state()), (None, LinkState::Waiting));
    }

    #[test]
    fn a_path_that_is_taken_is_refused_and_one_that_was_left_is_not() {
        let folder = Folder::new("path");
        let listen = || StreamReceiver::listen(&folder.socket(), *b"TEST", 100);
        let first = listen().unwrap();
        let reason = listen().err().unwrap().to_string();
        assert!(reason.contains("a program listens there already"), "{reason}");
        // A program that was killed leaves its socket.
        std::fs::hard_link(folder.socket(), folder.0.join("left")).unwrap();
        drop(first);
        assert!(!Path::new(&folder.socket()).exists());
        std::fs::rename(folder.0.join("left"), folder.socket()).unwrap();
        drop(listen().unwrap());
        std::fs::write(folder.socket(), b"a file").unwrap();
        assert!(listen().err().unwrap().to_string().contains("not a socket"));
    }
}

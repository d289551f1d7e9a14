//! Topics, ports and wake-ups within one process; what needs several stands in the whole-system tests.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

use stillpoint_samples::{Header, Pieces, PointCloud, Pose, Sample};
use stillpoint_shm::{Contract, CounterFault, Domain, PortRefusal, ShmError, Topic, Wake, sweep};
use zerocopy::IntoBytes;

struct Room {
    _folder: tempfile::TempDir,
    root: PathBuf,
    prefix: String,
}

/// A domain's corner for one test alone: tests run at the same time, so a name that two of them give is not enough.
fn room(name: &str) -> Room {
    static ROOMS: AtomicU32 = AtomicU32::new(0);
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().join("d");
    let number = ROOMS.fetch_add(1, Ordering::Relaxed);
    Room { _folder: folder, root, prefix: format!("spt{}_{number}_{name}_", std::process::id()) }
}

impl Drop for Room {
    fn drop(&mut self) {
        sweep(&self.root, &self.prefix);
    }
}

fn contract(depth: usize) -> Contract {
    Contract {
        buffer: depth,
        pool: depth + 4,
        ..Contract::new("a.cloud", PointCloud::KIND, Some("camera"), 100)
    }
}

fn send(publisher: &stillpoint_shm::Publisher, sequence: u64, count: u32) {
    let mut loan = publisher.loan(count as usize).unwrap().expect("memory");
    let (meta, payload) = loan.parts_mut();
    meta.fill(0);
    meta[..32].copy_from_slice(Header { sequence, count, ..Header::default() }.as_bytes());
    let end = meta.len();
    meta[end - 4..].copy_from_slice(&count.to_le_bytes());
    payload.fill(sequence as u8);
    publisher.send(loan).unwrap();
}

#[test]
fn bytes_arrive_as_they_were_written() {
    let room = room("bytes");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let topic = Topic::create(&domain, &contract(2)).unwrap();
    let subscriber = topic.subscriber(2).unwrap();
    let publisher = topic.publisher().unwrap();
    publisher.connect().unwrap();
    send(&publisher, 7, 3);
    let sample = subscriber.receive().unwrap().unwrap();
    let view = sample.pieces().view::<PointCloud>().unwrap();
    assert_eq!((view.header.sequence, view.elements.len(), view.body.length), (7, 3, 3));
    assert_eq!(sample.pieces().check(PointCloud::KIND).unwrap().payload, vec![7u8; 36]);
    assert!(subscriber.receive().unwrap().is_none());
}

#[test]
fn a_full_buffer_drops_the_oldest_and_never_blocks() {
    let room = room("full");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let topic = Topic::create(&domain, &contract(2)).unwrap();
    let subscriber = topic.subscriber(2).unwrap();
    let publisher = topic.publisher().unwrap();
    publisher.connect().unwrap();
    for sequence in 0..1000 {
        send(&publisher, sequence, 1);
    }
    let seen: Vec<u64> =
        std::iter::from_fn(|| subscriber.receive().unwrap()).map(|s| s.header().sequence).collect();
    assert_eq!(seen, [998, 999]);
}

#[test]
fn another_layout_or_frame_is_refused() {
    let room = room("refused");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let _topic = Topic::create(&domain, &contract(2)).unwrap();
    let other_frame = Contract::new("a.cloud", PointCloud::KIND, Some("couch"), 100);
    let other_type = Contract::new("a.cloud", Pose::KIND, Some("camera"), 1);
    for wrong in [other_frame, other_type] {
        let error = Topic::open(&domain, &wrong).err().expect("refused");
        let expected = matches!(&error, ShmError::Topic { topic, cause: PortRefusal::OtherContract, .. } if topic == "a.cloud");
        assert!(expected, "{error}");
    }
    assert!(Topic::open(&domain, &contract(2)).is_ok());
}

#[test]
fn used_up_memory_is_said_and_comes_back() {
    let room = room("memory");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let topic = Topic::create(&domain, &Contract { pool: 2, ..contract(1) }).unwrap();
    let publisher = topic.publisher().unwrap();
    let held = [publisher.loan(1).unwrap(), publisher.loan(1).unwrap()];
    assert!(held.iter().all(Option::is_some));
    assert!(publisher.loan(1).unwrap().is_none());
    drop(held);
    assert!(publisher.loan(1).unwrap().is_some());
}

#[test]
fn a_notification_wakes_and_silence_times_out() {
    let room = room("wake");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let topic = Topic::create(&domain, &contract(1)).unwrap();
    let (read, write) = std::io::pipe().unwrap();
    let mut wake = Wake::new(read.into(), vec![topic.listener().unwrap()]);
    let notifier = topic.notifier().unwrap();
    wake.wait(Some(1_000_000)).unwrap();
    assert!(!wake.drain().unwrap());
    notifier.notify();
    wake.wait(None).unwrap();
    assert!(wake.drain().unwrap());
    wake.wait(Some(1_000_000)).unwrap();
    assert!(!wake.drain().unwrap(), "a wake-up is taken once");
    assert!(!wake.wait(Some(1_000_000)).unwrap());
    drop(write);
    assert!(wake.wait(None).unwrap(), "the control pipe's end is seen");
}

#[test]
fn a_topic_name_says_which_frame_and_layout() {
    let contract = contract(1);
    assert!(contract.type_name.starts_with("PointCloud@") && contract.type_name.ends_with(" in camera"));
    let empty = Pieces { meta: &[], payload: &[] };
    assert!(empty.view::<PointCloud>().is_err());
}

#[test]
fn what_iceoryx2_refuses_is_said_in_words_with_what_to_do() {
    let room = room("words");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let absent = Topic::open(&domain, &contract(2)).err().unwrap().to_string();
    assert!(absent.contains("topic a.cloud") && absent.contains("the run has ended"), "{absent}");
    let few = Contract { subscribers: 1, publishers: 1, ..contract(2) };
    let topic = Topic::create(&domain, &few).unwrap();
    let repeated = Topic::create(&domain, &few).err().unwrap().to_string();
    assert!(repeated.contains("another run has the same prefix: start the run again"), "{repeated}");
    let _tap = topic.subscriber(1).unwrap();
    let tap = topic.subscriber(1).err().unwrap().to_string();
    assert!(tap.contains("subscriber on topic a.cloud") && tap.contains("end an `echo`"), "{tap}");
    let deep = topic.subscriber(9).err().unwrap().to_string();
    assert!(deep.contains("ask for a smaller depth"), "{deep}");
    let _publisher = topic.publisher().unwrap();
    let publisher = topic.publisher().err().unwrap().to_string();
    assert!(publisher.contains("end a `send`"), "{publisher}");
    let other = Contract { type_name: "another layout".into(), ..few };
    let other = Topic::open(&domain, &other).err().unwrap().to_string();
    assert!(other.contains("run the same build and the same pipeline"), "{other}");
    let long = Contract::new(&"a".repeat(300), PointCloud::KIND, None, 1);
    let long = Topic::create(&domain, &long).err().unwrap().to_string();
    assert!(long.contains("cannot name a part of shared memory"), "{long}");
}

#[test]
fn a_late_subscriber_has_the_newest_samples_that_were_kept_and_the_others_none() {
    let room = room("history");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let retained = Contract { history: 20, ..contract(2) };
    let _created = Topic::create(&domain, &retained).unwrap();
    // The creator alone says that samples are kept.
    let topic = Topic::open(&domain, &contract(2)).unwrap();
    assert_eq!(topic.contract().history, 20);
    let publisher = topic.publisher().unwrap();
    for sequence in 0..50 {
        send(&publisher, sequence, 1);
    }
    for _ in 0..2 {
        let (late, depth) = topic.subscriber_with_history().unwrap();
        let other = topic.subscriber(2).unwrap();
        publisher.connect().unwrap();
        let mut seen = Vec::new();
        while let Some(sample) = late.receive().unwrap() {
            assert_eq!(
                sample.pieces().check(PointCloud::KIND).unwrap().payload[0],
                sample.header().sequence as u8
            );
            seen.push(sample.header().sequence);
        }
        assert_eq!((depth, seen), (20, (30..50).collect()));
        assert!(other.receive().unwrap().is_none());
    }
    assert!(retained.pool_bytes() > contract(2).pool_bytes());
}

/// Objects of a domain in shared memory.
fn objects(room: &Room) -> Vec<PathBuf> {
    let all = std::fs::read_dir("/dev/shm").unwrap().flatten();
    all.filter(|o| o.file_name().to_string_lossy().starts_with(&room.prefix)).map(|o| o.path()).collect()
}

/// The one in which iceoryx2 counts nodes.
fn node_counter(room: &Room) -> PathBuf {
    objects(room).into_iter().find(|o| o.to_string_lossy().ends_with(".global_mgmt")).expect("a counter")
}

/// Joins on a thread, so that a join that hangs fails the test.
fn join(room: &Room) -> Result<(), ShmError> {
    let (answer, answered) = std::sync::mpsc::channel();
    let (root, prefix) = (room.root.clone(), room.prefix.clone());
    std::thread::spawn(move || answer.send(Domain::join(&root, &prefix, "other").map(drop)));
    answered.recv_timeout(std::time::Duration::from_secs(60)).expect("the join does not hang")
}

#[test]
fn no_object_of_a_domain_can_be_opened_by_others() {
    let room = room("modes");
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let topic = Topic::create(&domain, &contract(2)).unwrap();
    let (subscriber, publisher) = (topic.subscriber(2).unwrap(), topic.publisher().unwrap());
    publisher.connect().unwrap();
    send(&publisher, 1, 1);
    assert!(subscriber.receive().unwrap().is_some());
    assert!(objects(&room).contains(&node_counter(&room)));
    for object in objects(&room) {
        let mode = object.metadata().unwrap().mode() & 0o777;
        assert_eq!(mode & 0o077, 0, "{} has mode {mode:o}", object.display());
    }
}

#[test]
fn a_domain_is_joined_whatever_another_user_does_to_its_objects() {
    if !rustix::process::getuid().is_root() {
        eprintln!("skipped: only root can act as another user");
        return;
    }
    let room = room("users");
    let _domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    for object in objects(&room) {
        let other = 65_534;
        let cut = std::process::Command::new("truncate")
            .args(["-s", "0"])
            .arg(&object)
            .uid(other)
            .gid(other)
            .output();
        assert!(!cut.unwrap().status.success(), "{} was cut by another user", object.display());
    }
    join(&room).unwrap();
}

#[test]
fn a_node_counter_that_is_cut_or_open_to_others_is_refused_and_not_waited_for() {
    let room = room("cut");
    let _domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    let object = node_counter(&room);
    let fault = || match join(&room).unwrap_err() {
        ShmError::NodeCounter { fault, .. } => fault,
        e => panic!("{e}"),
    };
    std::fs::set_permissions(&object, std::fs::Permissions::from_mode(0o666)).unwrap();
    assert!(matches!(fault(), CounterFault::OpenToOthers { mode: 0o666 }));
    std::fs::set_permissions(&object, std::fs::Permissions::from_mode(0o600)).unwrap();
    join(&room).unwrap();
    std::fs::OpenOptions::new().write(true).open(&object).unwrap().set_len(0).unwrap();
    assert!(matches!(fault(), CounterFault::Damaged { size: 0 }));
}

#[test]
fn joining_a_domain_that_is_gone_is_refused_and_leaves_nothing() {
    let room = room("gone");
    let error = join(&room).unwrap_err();
    assert!(matches!(error, ShmError::NodeCounter { fault: CounterFault::NotThere, .. }), "{error}");
    assert_eq!(objects(&room), Vec::<PathBuf>::new());
}

#[test]
fn the_root_of_a_domain_is_in_memory_and_goes_with_a_sweep() {
    let room = room("memory");
    let memory = PathBuf::from(format!("/dev/shm/{}root", room.prefix));
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    assert_eq!(std::fs::read_link(&room.root).unwrap(), memory);
    assert_eq!(memory.metadata().unwrap().permissions().mode() & 0o777, 0o700);
    let topic = Topic::create(&domain, &contract(2)).unwrap();
    assert!(std::fs::read_dir(&memory).unwrap().count() > 0);
    let other = Domain::join(&room.root, &room.prefix, "other").unwrap();
    Topic::open(&other, &contract(2)).unwrap();
    drop((topic, domain, other));
    assert!(sweep(&room.root, &room.prefix) >= 2);
    assert!(!memory.exists() && room.root.symlink_metadata().is_err());
}

#[test]
fn where_the_folder_in_memory_is_there_already_the_root_is_on_the_disk() {
    let room = room("taken");
    let memory = PathBuf::from(format!("/dev/shm/{}root", room.prefix));
    std::fs::create_dir(&memory).unwrap();
    let domain = Domain::create(&room.root, &room.prefix, "test").unwrap();
    Topic::create(&domain, &contract(2)).unwrap();
    assert!(room.root.symlink_metadata().unwrap().is_dir());
    assert_eq!(std::fs::read_dir(&memory).unwrap().count(), 0);
}

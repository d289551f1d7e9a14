//! Bytes that anybody may send: no panic, bounded memory, and every refusal is counted.

use proptest::prelude::*;
use stillpoint_remote::{Attachment, Beat, BeatError, HostIdentity, Seen, Sends, Takes};
use stillpoint_samples::Header;
use zerocopy::IntoBytes;

fn beat() -> Beat {
    Beat {
        protocol: 1,
        host: "bedside".into(),
        incarnation: 7,
        number: 1,
        identity: HostIdentity {
            pipeline: "p".into(),
            hash: "h".into(),
            version: "v".into(),
            cpu: "c".into(),
        },
        at: 5,
        seen: vec![Seen {
            host: "cluster".into(),
            incarnation: 3,
            number: 2,
            at: 9,
            held: 1,
            refused: vec!["other".into()],
        }],
        sends: vec![Sends { edge: "a.b".into(), channel: "T@1 -".into(), end: 4, put: 8 }],
        takes: vec![Takes { edge: "c.d".into(), channel: "T@1 -".into(), from: 4, received: 7, refused: 1 }],
    }
}

#[test]
fn a_beat_is_read_as_it_was_written_and_bounds_hold() {
    assert_eq!(Beat::read(&beat().to_bytes()), Ok(beat()));
    let with = |change: fn(&mut Beat)| {
        let mut beat = beat();
        change(&mut beat);
        Beat::read(&beat.to_bytes()).unwrap_err()
    };
    assert_eq!(with(|b| b.protocol = 2), BeatError::Protocol(2));
    assert!(matches!(with(|b| b.host = String::new()), BeatError::Bounds(_)));
    assert!(matches!(with(|b| b.identity.hash = "x".repeat(600)), BeatError::Bounds(_)));
    assert!(matches!(with(|b| b.sends = vec![b.sends[0].clone(); 600]), BeatError::Bounds(_)));
    assert!(matches!(with(|b| b.takes[0].edge = "x".repeat(300_000)), BeatError::TooLong(_)));
}

proptest! {
    #[test]
    fn any_bytes_are_a_beat_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = Beat::read(&bytes);
    }

    #[test]
    fn a_damaged_beat_is_read_or_refused(at in 0_usize..1_000, byte in any::<u8>(), cut in 0_usize..1_000) {
        let mut bytes = beat().to_bytes();
        let length = bytes.len();
        bytes[at % length] = byte;
        let _ = Beat::read(&bytes);
        let _ = Beat::read(&bytes[..cut % length]);
    }

    #[test]
    fn an_attachment_is_read_as_it_was_written(
        stamp in any::<u64>(), sequence in any::<u64>(), count in any::<u32>(), end in any::<u64>(), number in 1..=u64::MAX,
    ) {
        let header = Header { stamp, origin: 1, sequence, incarnation: 2, count };
        let attachment = Attachment { header, end, number };
        let read = Attachment::read(&attachment.to_bytes()).unwrap();
        prop_assert_eq!(read.header.as_bytes(), header.as_bytes());
        prop_assert_eq!((read.end, read.number), (end, number));
    }

    #[test]
    fn an_attachment_of_another_length_is_refused(bytes in proptest::collection::vec(any::<u8>(), 0..120)) {
        prop_assert!(Attachment::read(&bytes).is_none() || bytes.len() == Attachment::SIZE);
    }
}

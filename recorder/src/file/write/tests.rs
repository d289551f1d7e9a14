use std::collections::BTreeMap;

use mcap::records::MessageHeader;
use mcap::write::NoSeek;

use super::*;

/// Lengths of messages: small ones, one that just fills a chunk, one larger than a chunk, an empty one.
const LENGTHS: [usize; 12] = [0, 40, 300_000, 400_000, 400_000, 7, 2_000_000, 0, 1_048_545, 1, 1_200_000, 5];

fn data(number: usize, length: usize) -> Vec<u8> {
    (0..length).map(|i| ((i / 5) ^ (i * number)) as u8).collect()
}

fn map(key: &str) -> BTreeMap<String, String> {
    BTreeMap::from([(key.to_owned(), "value".to_owned()), ("other".to_owned(), String::new())])
}

fn ours(compression: Compression) -> io::Result<Vec<u8>> {
    let mut w = FileWriter::new(Vec::new(), compression, "tests")?;
    w.attach(&AttachmentRecord {
        log_time: 4,
        create_time: 3,
        name: "pipeline.yaml".into(),
        media_type: "text/yaml".into(),
        data: b"stillpoint: 1".to_vec(),
    })?;
    w.metadata("facts", &map("a"))?;
    let schemas = [w.schema("a/msg/A", "ros2msg", b"uint8 a")?, w.schema("a/msg/B", "ros2msg", b"uint8 b")?];
    assert_eq!(w.schema("a/msg/A", "ros2msg", b"uint8 a")?, schemas[0]);
    let channels = [
        w.channel(schemas[0], "a", "cdr", &map("b"))?,
        w.channel(schemas[1], "b", "cdr", &BTreeMap::new())?,
        w.channel(0, "c", "json", &BTreeMap::new())?,
    ];
    for (i, length) in LENGTHS.iter().enumerate() {
        let data = data(i, *length);
        let time = 1000 - i as u64 * 7;
        let (channel, sequence) = (channels[i % 2], i as u32);
        w.message(&Message { channel, sequence, log_time: time, publish_time: time + 1, data: &data })?;
        if i == 5 {
            w.flush()?;
            w.flush()?;
        }
    }
    w.metadata("end", &map("c"))?;
    w.finish()
}

fn theirs() -> mcap::McapResult<Vec<u8>> {
    let options = mcap::WriteOptions::new()
        .profile("ros2")
        .library("tests")
        .chunk_size(Some(CHUNK_SIZE))
        .disable_seeking(true)
        .compression_threads(0)
        .compression(None);
    let mut w = options.create(NoSeek::new(Vec::new()))?;
    w.attach(&mcap::Attachment {
        log_time: 4,
        create_time: 3,
        name: "pipeline.yaml".into(),
        media_type: "text/yaml".into(),
        data: b"stillpoint: 1"[..].into(),
    })?;
    w.write_metadata(&mcap::records::Metadata { name: "facts".into(), metadata: map("a") })?;
    let schemas =
        [w.add_schema("a/msg/A", "ros2msg", b"uint8 a")?, w.add_schema("a/msg/B", "ros2msg", b"uint8 b")?];
    let channels = [
        w.add_channel(schemas[0], "a", "cdr", &map("b"))?,
        w.add_channel(schemas[1], "b", "cdr", &BTreeMap::new())?,
        w.add_channel(0, "c", "json", &BTreeMap::new())?,
    ];
    for (i, length) in LENGTHS.iter().enumerate() {
        let time = 1000 - i as u64 * 7;
        let (channel_id, sequence) = (channels[i % 2], i as u32);
        let header = MessageHeader { channel_id, sequence, log_time: time, publish_time: time + 1 };
        w.write_to_known_channel(&header, &data(i, *length))?;
        if i == 5 {
            w.flush()?;
            w.flush()?;
        }
    }
    w.write_metadata(&mcap::records::Metadata { name: "end".into(), metadata: map("c") })?;
    w.finish()?;
    Ok(w.into_inner().into_inner())
}

#[test]
fn the_bytes_are_those_of_the_formats_own_writer() {
    let (ours, theirs) = (ours(Compression::None).unwrap_or_default(), theirs().unwrap_or_default());
    let differ = ours.iter().zip(&theirs).position(|(a, b)| a != b);
    assert_eq!((ours.len(), differ), (theirs.len(), None));
    assert!(ours.len() > 5_000_000);
}

/// Channel, number, time and data of a message.
type Found = (u16, u32, u64, Vec<u8>);

/// Every message as the format's own reader finds it through the indexes, and how many chunks it looked into.
fn read(bytes: &[u8]) -> mcap::McapResult<(Vec<Found>, usize)> {
    let summary = mcap::Summary::read(bytes)?.unwrap_or_default();
    let mut found = Vec::new();
    for index in &summary.chunk_indexes {
        let places = summary.read_message_indexes(bytes, index)?;
        assert!(!places.is_empty() || index.message_index_offsets.is_empty());
        for message in summary.stream_chunk(bytes, index)? {
            let m = message?;
            found.push((m.channel.id, m.sequence, m.log_time, m.data.to_vec()));
        }
    }
    Ok((found, summary.chunk_indexes.len()))
}

#[test]
fn compressed_chunks_hold_the_same() {
    let plain = read(&theirs().unwrap_or_default()).ok();
    assert!(plain.as_ref().is_some_and(|(found, chunks)| found.len() == LENGTHS.len() && *chunks > 4));
    for compression in [Compression::Lz4, Compression::Zstd] {
        let ours = ours(compression).unwrap_or_default();
        assert!(ours.len() < 200_000, "{compression:?}");
        assert_eq!(read(&ours).ok(), plain, "{compression:?}");
    }
}

/// Takes so many bytes, then refuses.
struct Full(usize);

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0 = self.0.checked_sub(bytes.len()).ok_or(io::ErrorKind::StorageFull)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn behind_a_failed_write_nothing_more_is_written() {
    let Ok(mut w) = FileWriter::new(Full(1 << 20), Compression::None, "tests") else { panic!("it has room") };
    let message = |data| Message { channel: 1, sequence: 0, log_time: 0, publish_time: 0, data };
    let refused = w.message(&message(&[0; 2 << 20])).map_err(|e| e.kind());
    assert_eq!(refused, Err(io::ErrorKind::StorageFull));
    assert!(w.message(&message(&[1; 10])).is_ok(), "it waits in the chunk");
    assert!(w.flush().is_err());
    assert!(w.finish().is_err());
}

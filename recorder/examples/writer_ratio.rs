//! Bytes per CPU-second of the session writer against the bare MCAP writer, same messages and options, interleaved
//! windows: once from samples laid out already as their messages, once from samples in pieces, which costs a copy.
//!
//! `cargo run --release -p stillpoint-recorder --example writer_ratio [none|lz4|zstd]`

use std::io::{self, Write};

use mcap::records::MessageHeader;
use mcap::write::NoSeek;
use stillpoint_recorder::{Compression, Encoded, Opening, PartWriter, Role, TopicInfo};
use stillpoint_samples::{AlignedBytes, CloudShape, HEADER_SIZE, Header, Pieces, PointCloud, Sample};
use zerocopy::IntoBytes;

const WINDOWS: usize = 15;
const MESSAGES: usize = 200;
const POINTS: u32 = 100_000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let compression = match std::env::args().nth(1).as_deref() {
        Some("none") => Compression::None,
        Some("zstd") => Compression::Zstd,
        _ => Compression::Lz4,
    };
    let samples: Vec<AlignedBytes> = (0..8).map(cloud).collect();
    let mut encoded = Vec::new();
    for s in &samples {
        encoded.push(Encoded::new(&topic(), Pieces::split(PointCloud::KIND, s)?, Vec::new())?);
    }
    let (mut from_encoded, mut from_pieces, mut rates) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..WINDOWS {
        let bare = cpu_seconds(|| bare(compression, &encoded))?;
        let laid_out = cpu_seconds(|| laid_out(compression, &encoded))?;
        let pieces = cpu_seconds(|| pieces(compression, &samples))?;
        from_encoded.push(bare / laid_out);
        from_pieces.push(bare / pieces);
        rates.push((MESSAGES * samples[0].len()) as f64 / laid_out);
    }
    let median = |mut of: Vec<f64>| {
        of.sort_by(f64::total_cmp);
        of[WINDOWS / 2]
    };
    writeln!(
        io::stdout(),
        "{compression:?}: {:.2} GB per CPU-second, {:.2} of the bare writer, {:.2} from pieces (medians of {WINDOWS})",
        median(rates) / 1e9,
        median(from_encoded),
        median(from_pieces)
    )?;
    Ok(())
}

/// 1.2 MB of points on a wavy surface with noise in the last bits, as a camera gives them.
fn cloud(n: u32) -> AlignedBytes {
    let kind = PointCloud::KIND;
    let mut bytes = AlignedBytes::zeroed(kind.meta_size() + POINTS as usize * kind.element_size);
    let header = Header { stamp: 1, origin: 1, sequence: n.into(), incarnation: 0, count: POINTS };
    let shape = CloudShape { width: POINTS, height: 1, reserved: 0, length: POINTS };
    bytes[..HEADER_SIZE].copy_from_slice(header.as_bytes());
    bytes[HEADER_SIZE..kind.meta_size()].copy_from_slice(shape.as_bytes());
    let mut random = 1 + u64::from(n);
    for (i, point) in bytes[kind.meta_size()..].chunks_exact_mut(12).enumerate() {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let noise = (random >> 40) as f32 * 1e-10;
        let (x, y) = ((i % 320) as f32 * 0.001, (i / 320) as f32 * 0.001);
        point.copy_from_slice([x, y, 0.5 + x * y + noise].as_bytes());
    }
    bytes
}

fn topic() -> TopicInfo {
    TopicInfo {
        name: "cam.cloud".into(),
        operator: "cam".into(),
        kind: PointCloud::KIND,
        frame: None,
        role: Role::Source,
    }
}

fn laid_out(compression: Compression, samples: &[Encoded]) -> Result<(), Box<dyn std::error::Error>> {
    let mut w = PartWriter::new(io::sink(), compression, &Opening::default())?;
    let id = w.add_topic(topic())?;
    for i in 0..MESSAGES {
        w.write_encoded(id, &samples[i % samples.len()], i as u64)?;
    }
    w.flush()?;
    Ok(())
}

fn pieces(compression: Compression, samples: &[AlignedBytes]) -> Result<(), Box<dyn std::error::Error>> {
    let mut w = PartWriter::new(io::sink(), compression, &Opening::default())?;
    let id = w.add_topic(topic())?;
    for i in 0..MESSAGES {
        w.write(id, Pieces::split(PointCloud::KIND, &samples[i % samples.len()])?, i as u64)?;
    }
    w.flush()?;
    Ok(())
}

fn bare(compression: Compression, samples: &[Encoded]) -> Result<(), Box<dyn std::error::Error>> {
    let compression = match compression {
        Compression::None => None,
        Compression::Lz4 => Some(mcap::Compression::Lz4),
        Compression::Zstd => Some(mcap::Compression::Zstd),
    };
    let options =
        mcap::WriteOptions::new().disable_seeking(true).compression(compression).compression_threads(0);
    let mut w = options.create(NoSeek::new(io::sink()))?;
    let channel_id = w.add_channel(0, "cam.cloud", "cdr", &Default::default())?;
    for i in 0..MESSAGES {
        let header = MessageHeader { channel_id, sequence: i as u32, log_time: i as u64, publish_time: 0 };
        w.write_to_known_channel(&header, samples[i % samples.len()].message())?;
    }
    w.flush()?;
    Ok(())
}

/// CPU time of this process that `work` takes.
fn cpu_seconds(
    work: impl FnOnce() -> Result<(), Box<dyn std::error::Error>>,
) -> Result<f64, Box<dyn std::error::Error>> {
    let before = cpu()?;
    work()?;
    Ok(cpu()? - before)
}

fn cpu() -> Result<f64, Box<dyn std::error::Error>> {
    // Nanoseconds on the CPU stand first.
    let text = std::fs::read_to_string("/proc/self/schedstat")?;
    Ok(text.split_whitespace().next().unwrap_or("0").parse::<f64>()? * 1e-9)
}

//! `stillpoint merge`: sessions of two hosts whose clocks are 3 s apart, on one time axis; and sessions that do not
//! belong together.

use std::collections::BTreeMap;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

use serde_json::Value;
use stillpoint_recorder::{
    Attachment, ClockSample, Closing, Compression, Opening, PartWriter, Role, Session, TopicInfo,
    create_part, create_session,
};
use stillpoint_samples::{AlignedBytes, Diagnostics, Header, Metric, Pieces, Pose, Sample, SampleKind};
use zerocopy::IntoBytes;

use crate::{stillpoint, text};

const PIPELINE: &str = "stillpoint: 1
name: two
operators:
  rig: { use: rig.camera, every: 10 ms, frame: camera, params: { motion: raise, width: 32 px, height: 24 px, focal_length: 28 px } }
  far: { use: sink.null, inputs: { pose: rig.truth } }
  back: { use: sink.null, inputs: { diagnostics: far.counts } }
frames: { camera: { parent: couch, at: [0 mm, 0 mm, 720 mm], rotation: [180 deg, 0 deg, 0 deg] } }
hosts:
  bedside: { listen: 'tcp/127.0.0.1:7447' }
  cluster: { connect: 'tcp/127.0.0.1:7447' }
processes:
  patient: { operators: [rig, back], host: bedside }
  heavy: { operators: [far], host: cluster }
";

const MS: u64 = 1_000_000;
/// When the bedside began, by its own clock.
const BEGUN: u64 = 1_795_219_200_000_000_000;
/// The clock of the cluster is ahead.
const AHEAD: u64 = 3_000 * MS;

/// What a host records.
struct Host<'a> {
    name: &'a str,
    begun: u64,
    pipeline: &'a str,
    /// A topic of poses, and the stamp of each after the beginning, ns.
    poses: (&'a str, &'a [u64]),
    /// The far end that measured a clock, and offset and uncertainty in s.
    measured: Option<(&'a str, [f64; 2])>,
}

impl Host<'_> {
    fn record(&self, path: &Path) {
        create_session(path).unwrap();
        let keep = |name: &str, bytes: &str| Attachment {
            name: name.into(),
            media_type: "text/plain".into(),
            bytes: bytes.into(),
        };
        let sets = match self.name {
            "" => "[]".to_owned(),
            name => format!("[\"host={name}\"]"),
        };
        let opening = Opening {
            attachments: vec![keep("pipeline.yaml", self.pipeline), keep("sets.json", &sets)],
            metadata: BTreeMap::new(),
            frames: Vec::new(),
            clock: Some(ClockSample { logical_ns: self.begun, realtime_ns: self.begun + 7 }),
        };
        let mut part = PartWriter::new(create_part(path).unwrap().1, Compression::Lz4, &opening).unwrap();
        let topic = |name: &str, kind: &'static SampleKind, frame: Option<&str>| TopicInfo {
            name: name.into(),
            operator: name.split('.').next().unwrap().into(),
            kind,
            frame: frame.map(str::to_owned),
            role: Role::Source,
        };
        let poses = part.add_topic(topic(self.poses.0, Pose::KIND, Some("couch"))).unwrap();
        for (sequence, at) in self.poses.1.iter().enumerate() {
            let stamp = self.begun + at;
            let header =
                Header { stamp, origin: stamp - MS, sequence: sequence as u64, incarnation: 0, count: 1 };
            let sample = AlignedBytes::joined(header.as_bytes(), &[0; 43 * 8]);
            part.write(poses, Pieces::split(Pose::KIND, &sample).unwrap(), stamp + 7).unwrap();
        }
        if let Some((far, [offset, uncertainty])) = self.measured {
            let name = format!("{far}.diagnostics");
            let diagnostics = part.add_topic(topic(&name, Diagnostics::KIND, None)).unwrap();
            let metrics =
                [Metric::new("clock_offset_s", offset), Metric::new("clock_uncertainty_s", uncertainty)];
            let (stamp, count) = (self.begun + 500 * MS, 2);
            let header = Header { stamp, origin: stamp, sequence: 0, incarnation: 0, count };
            let sample = AlignedBytes::joined(header.as_bytes(), metrics.as_bytes());
            part.write(diagnostics, Pieces::split(Diagnostics::KIND, &sample).unwrap(), stamp + 7).unwrap();
        }
        part.finish(&Closing::default()).unwrap();
    }
}

const BEDSIDE: Host<'_> = Host {
    name: "bedside",
    begun: BEGUN,
    pipeline: PIPELINE,
    poses: ("rig.truth", &[0, 10 * MS, 20 * MS, 30 * MS]),
    measured: Some(("far_counts_bedside", [3.0, 0.000_2])),
};

/// It began 5 ms after the bedside, and its measurement is better: 20 us beside the truth.
const CLUSTER: Host<'_> = Host {
    name: "cluster",
    begun: BEGUN + AHEAD + 5 * MS,
    pipeline: PIPELINE,
    poses: ("rig_truth_cluster.sample", &[0, 10 * MS, 20 * MS]),
    measured: Some(("rig_truth_cluster", [-3.000_02, 0.000_05])),
};

fn merge(folder: &Path, sessions: &[&str]) -> Result<Value, String> {
    let out = stillpoint(folder, &[&["merge", "--json", "--out", "joined"], sessions].concat());
    match out.status.success() {
        true => Ok(serde_json::from_slice(&out.stdout).unwrap()),
        false => {
            assert!(sessions.contains(&"joined") || !folder.join("joined").exists());
            Err(text(&out.stderr))
        }
    }
}

#[test]
fn two_hosts_come_on_the_time_axis_of_the_first_by_the_surest_measurement() {
    let folder = tempfile::tempdir().unwrap();
    BEDSIDE.record(&folder.path().join("a"));
    CLUSTER.record(&folder.path().join("b"));
    let output_text = merge(folder.path(), &["a", "b"]).unwrap();
    assert_eq!(output_text["left_out"], serde_json::json!([]));
    let [bedside, cluster] = [&output_text["hosts"][0], &output_text["hosts"][1]];
    assert_eq!((&bedside["offset_ns"], &bedside["uncertainty_ns"]), (&0.into(), &0.into()));
    assert_eq!((&bedside["samples"], &cluster["samples"]), (&5.into(), &4.into()));
    assert_eq!(cluster["offset_ns"], 3_000_020_000_u64);
    assert_eq!(cluster["uncertainty_ns"], 50_000);

    let joined = folder.path().join("joined");
    let session = Session::open_any(&joined).unwrap();
    let merged = &session.metadata()["stillpoint.merged"];
    assert_eq!((&*merged["axis"], &*merged["cluster.uncertainty_ns"]), ("bedside", "50000"));
    assert_eq!(merged["cluster.offset_ns"], "3000020000");
    let samples: Vec<_> = session.samples().map(Result::unwrap).collect();
    let of = |name: &str| -> Vec<u64> {
        let number = session.topic_number(name).unwrap();
        let stamp = |bytes: &[u8]| Pieces::split(Pose::KIND, bytes).unwrap().header().stamp - BEGUN;
        samples.iter().filter(|s| s.topic == number).map(|s| stamp(&s.sample)).collect()
    };
    assert_eq!(of("bedside.rig.truth"), [0, 10 * MS, 20 * MS, 30 * MS]);
    // 20 us less than the truth, as measured.
    assert_eq!(
        of("cluster.rig_truth_cluster.sample"),
        [5, 15, 25].map(|ms| ms * MS - 20_000),
        "samples have the time of the bedside"
    );
    assert!(samples.is_sorted_by_key(|s| s.log_time));
    assert_eq!(samples[1].log_time, BEGUN + 5 * MS - 20_000 + 7);
    let mode = |name: &str| std::fs::metadata(joined.join(name)).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(""), mode("part-000.mcap")), (0o700, 0o600));
    // What is joined is no session to replay, and says so.
    let replay = stillpoint(folder.path(), &["replay", "joined"]);
    let why = text(&replay.stderr);
    assert!(
        !replay.status.success() && why.contains("joined from those of the hosts bedside, cluster"),
        "{why}"
    );
    let info = stillpoint(folder.path(), &["info", "joined"]);
    assert!(
        text(&info.stdout).contains("joined from the sessions of several hosts"),
        "{}",
        text(&info.stdout)
    );

    // The other way round, times are those of the cluster.
    std::fs::remove_dir_all(joined).unwrap();
    let output_text = merge(folder.path(), &["b", "a"]).unwrap();
    assert_eq!(output_text["hosts"][1]["offset_ns"], -3_000_020_000_i64);
}

#[test]
fn sessions_that_cannot_be_joined_are_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    BEDSIDE.record(&at("a"));
    CLUSTER.record(&at("b"));
    Host { pipeline: &PIPELINE.replace("every: 10 ms", "every: 11 ms"), ..CLUSTER }.record(&at("other"));
    Host { name: "", ..CLUSTER }.record(&at("whole"));
    Host { measured: None, ..BEDSIDE }.record(&at("silent-a"));
    Host { measured: None, ..CLUSTER }.record(&at("silent-b"));
    Host { measured: Some(("rig_truth_cluster", [f64::NAN, 0.0])), ..CLUSTER }.record(&at("nan"));
    Host { pipeline: "stillpoint: 1\nname: x\n", ..CLUSTER }.record(&at("broken"));
    Host { begun: CLUSTER.begun + 60_000 * MS, ..CLUSTER }.record(&at("next"));
    create_session(&at("empty")).unwrap();
    std::fs::write(at("text"), "this is not a session").unwrap();
    for (sessions, words) in [
        (["a", "a"], "a and a are both sessions of the host `bedside`"),
        (["a", "other"], "a and other are sessions of different pipelines or settings"),
        (["a", "whole"], "whole: this session was not recorded by one of several hosts"),
        (["silent-a", "silent-b"], "silent-b: no session holds the offset of the clock of `cluster`"),
        (["a", "nan"], "nan: a measurement of a clock cannot be read: the offset NaN s"),
        (["a", "next"], "a is 59.505 s apart from the other sessions: it is of another run"),
        (["a", "broken"], "broken: the session's pipeline does not fit this build"),
        (["a", "empty"], "empty: no part-000.mcap is in this folder"),
        (["a", "text"], "text: this is not an MCAP file"),
    ] {
        let output_text = merge(folder.path(), &sessions).unwrap_err();
        assert!(output_text.contains(words), "{sessions:?}: {output_text}");
    }
    // One measurement is enough.
    assert_eq!(merge(folder.path(), &["silent-a", "b"]).unwrap()["hosts"][1]["uncertainty_ns"], 50_000);
    assert!(merge(folder.path(), &["a", "b", "joined"]).is_err());
    let taken = stillpoint(folder.path(), &["merge", "a", "b", "--out", "joined"]);
    assert!(
        !taken.status.success() && text(&taken.stderr).contains("never written over"),
        "{}",
        text(&taken.stderr)
    );
}

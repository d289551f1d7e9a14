//! A session written anew, with something in it changed.

use std::path::Path;

use stillpoint_recorder::{
    Attachment, Closing, Compression, Opening, PartWriter, Role, Session, TopicInfo, create_part,
    create_session,
};
use stillpoint_samples::{AlignedBytes, Pieces};

/// A recorded sample: topic, incarnation, sequence, bytes.
pub struct Sample {
    pub topic: String,
    pub incarnation: u32,
    pub sequence: u64,
    pub bytes: AlignedBytes,
}

/// Writes `from` anew as `to`, as `change` leaves its samples.
pub fn rewrite(from: &Path, to: &Path, change: impl FnOnce(&mut Vec<Sample>)) {
    rewrite_all(from, to, |samples, _| change(samples));
}

/// The same, as `change` leaves its samples and attachments.
pub fn rewrite_all(from: &Path, to: &Path, change: impl FnOnce(&mut Vec<Sample>, &mut Vec<Attachment>)) {
    let session = Session::open(from).unwrap();
    let mut samples: Vec<Sample> = session
        .samples()
        .map(|recorded| {
            let r = recorded.unwrap();
            let topic = session.topics()[r.topic].name.clone();
            Sample { topic, incarnation: r.incarnation, sequence: r.sequence, bytes: r.sample }
        })
        .collect();
    let mut attachments: Vec<Attachment> = session.attachments().values().cloned().collect();
    change(&mut samples, &mut attachments);
    let opening = Opening {
        attachments,
        metadata: session.metadata().clone(),
        frames: session.frames().to_vec(),
        clock: session.clock().first().copied(),
    };
    create_session(to).unwrap();
    let (_, file) = create_part(to).unwrap();
    let mut part = PartWriter::new(file, Compression::None, &opening).unwrap();
    let mut topics = std::collections::BTreeMap::new();
    for topic in session.topics() {
        let kind = *stillpoint_samples::all().iter().find(|k| k.type_name() == topic.type_name).unwrap();
        let role: Role = topic.role.clone();
        let info = TopicInfo {
            name: topic.name.clone(),
            operator: topic.operator.clone(),
            kind,
            frame: topic.frame.clone(),
            role,
        };
        topics.insert(topic.name.clone(), (part.add_topic(info).unwrap(), kind));
    }
    for sample in &samples {
        let (id, kind) = topics[&sample.topic];
        part.write(id, Pieces::split(kind, &sample.bytes).unwrap(), 0).unwrap();
    }
    part.finish(&Closing::default()).unwrap();
}

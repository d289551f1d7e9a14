//! A session of another layout is read where every field of this build stands in it, and refused elsewhere.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test stops at the first surprise"
)]

mod fixture;

use fixture::{entry, header, opening, pieces, reference, topic};
use stillpoint_recorder::{Closing, Compression, PartWriter, Role, Session, SessionError, TopicKind};
use stillpoint_samples::{
    AlignedBytes, Cause, Cluster, ClusterTable, ClusterTableShape, Field, HEADER_SIZE, Journal, Pieces,
    Plane, PlaneElement, Primitive, RefKind, Sample, SampleKind, Shape, fields_size,
};
use zerocopy::IntoBytes;

/// A kind by its fields, as another build had it.
fn kind(of: &SampleKind, body: Vec<Field>, element: Vec<Field>) -> &'static SampleKind {
    let (body, element): (&'static [Field], &'static [Field]) = (body.leak(), element.leak());
    Box::leak(Box::new(SampleKind {
        name: of.name,
        about: of.about,
        shape: of.shape,
        body,
        element,
        bare: of.bare,
        body_size: fields_size(body),
        element_size: fields_size(element),
        element_align: of.element_align,
        hash: of.hash ^ 1,
    }))
}

/// A session with one sample of this kind.
fn session(kind: &'static SampleKind, sample: &[u8]) -> Result<Session, SessionError> {
    let mut w = PartWriter::new(Vec::new(), Compression::Lz4, &opening()).unwrap();
    let id = w.add_topic(topic("a.b", kind, Role::Source)).unwrap();
    w.write(id, pieces(kind, sample), 0).unwrap();
    Session::from_bytes([w.finish(&Closing::default()).unwrap().into()])
}

/// The only sample of a session.
fn only(session: &Session) -> AlignedBytes {
    let mut all = session.samples();
    let sample = all.next().unwrap().unwrap().sample;
    assert!(all.next().is_none());
    sample
}

fn refused(kind: &'static SampleKind) -> String {
    let sample = fixture::sample(kind, header(0), &[1, 2, 3]);
    let error = session(kind, &sample).unwrap_err();
    assert!(matches!(error, SessionError::Layout { .. }), "{error}");
    error.to_string()
}

fn plane() -> PlaneElement {
    PlaneElement {
        normal: [0.25, 0.5, 0.75],
        offset: 0.4,
        rms: 0.001,
        inliers: 10,
        points: 20,
        kept: 1,
        hypotheses: 30,
    }
}

#[test]
fn fields_in_another_order_and_fields_that_went_are_mapped_by_name() {
    let extra = Field::new("tolerance", Primitive::F64, 2, "m");
    let ours = Plane::KIND.element;
    // As they were: a field that this build does not have in front, offset and normal swapped.
    let fields = vec![extra, ours[1], ours[0], ours[2], ours[3], ours[4], ours[5], ours[6]];
    let old = kind(Plane::KIND, Vec::new(), fields);
    let p = plane();
    let mut sample = AlignedBytes::zeroed(old.total_size(1).unwrap());
    sample[..HEADER_SIZE].copy_from_slice(header(0).as_bytes());
    let rest = [7.0, 8.0, p.offset, p.normal[0], p.normal[1], p.normal[2], p.rms];
    sample[HEADER_SIZE..HEADER_SIZE + 56].copy_from_slice(rest.as_bytes());
    sample[HEADER_SIZE + 56..].copy_from_slice([p.inliers, p.points, p.kept, p.hypotheses].as_bytes());
    let session = session(old, &sample).unwrap();
    let TopicKind::Mapped { mapping, .. } = &session.topics()[0].kind else { panic!("it is not mapped") };
    assert_eq!(mapping.left_out(), ["tolerance"]);
    let found = only(&session);
    let view = Pieces::split(Plane::KIND, &found).unwrap().view::<Plane>().unwrap();
    assert_eq!((view.header, view.elements), (header(0), &[p][..]));
    assert_eq!(session.holds(0, 0, 0, &found).unwrap(), Some(true));
}

#[test]
fn a_slice_with_a_body_is_mapped() {
    let ours = ClusterTable::KIND;
    let mut element = ours.element.to_vec();
    element.swap(0, 1);
    let extra = Field::new("seen", Primitive::U64, 0, "");
    let body = [vec![extra], ours.body.to_vec()].concat();
    let old = kind(ours, body, element);
    let (first, second) = (ours.element[0].size(), ours.element[1].size());
    let new = fixture::sample(ours, stillpoint_samples::Header { count: 3, ..header(0) }, &[1, 2, 3, 4, 5]);
    // The same sample as it would have been.
    let mut sample = AlignedBytes::zeroed(old.total_size(3).unwrap());
    sample[..HEADER_SIZE].copy_from_slice(&new[..HEADER_SIZE]);
    sample[HEADER_SIZE + 8..old.meta_size()].copy_from_slice(&new[HEADER_SIZE..ours.meta_size()]);
    let pairs = new[ours.meta_size()..].chunks_exact(size_of::<Cluster>());
    let size = old.element_size;
    for (i, from) in pairs.enumerate() {
        let to = &mut sample[old.meta_size() + i * size..][..size];
        to[..second].copy_from_slice(&from[first..first + second]);
        to[second..second + first].copy_from_slice(&from[..first]);
        to[first + second..].copy_from_slice(&from[first + second..]);
    }
    assert_eq!(ours.body_size, size_of::<ClusterTableShape>());
    assert_eq!(old.shape, Shape::Slice);
    assert_eq!(&*only(&session(old, &sample).unwrap()), &*new);
}

#[test]
fn journals_of_another_layout_are_read() {
    let mut body = Journal::KIND.body.to_vec();
    let extra = Field::new("weather", Primitive::U64, 0, "");
    body.insert(0, extra);
    let old = kind(Journal::KIND, body, Journal::KIND.element.to_vec());
    let new = entry(header(0), 5, Cause::Timer, &[reference(RefKind::Output, 0, 0, 9)]);
    let sample = [&new[..HEADER_SIZE], &[0; 8], &new[HEADER_SIZE..]].concat();
    let mut w = PartWriter::new(Vec::new(), Compression::Lz4, &opening()).unwrap();
    let role = Role::Journal { inputs: Vec::new(), outputs: vec!["a.b".into()] };
    let id = w.add_topic(topic("a.journal", old, role)).unwrap();
    w.write(id, pieces(old, &sample), 0).unwrap();
    let session = Session::from_bytes([w.finish(&Closing::default()).unwrap().into()]).unwrap();
    let found = &session.journals()["a"][0];
    assert_eq!((found.body.index, found.cause(), found.refs[0].first), (5, Some(Cause::Timer), 9));
}

#[test]
fn a_field_that_the_recording_lacks_is_refused_by_name() {
    let ours = Plane::KIND.element;
    let old = kind(Plane::KIND, Vec::new(), [&ours[..2], &ours[3..]].concat());
    assert!(refused(old).contains("only this build has `float64 rms in m`"), "{}", refused(old));
}

#[test]
fn another_unit_type_or_array_is_refused() {
    let ours = Plane::KIND.element;
    let with = |changed: Field| {
        let mut fields = ours.to_vec();
        fields[1] = changed;
        refused(kind(Plane::KIND, Vec::new(), fields))
    };
    let text = with(Field { unit: "mm", ..ours[1] });
    assert!(text.contains("`float64 offset in mm`") && text.contains("`float64 offset in m`"), "{text}");
    with(Field { primitive: Primitive::U64, ..ours[1] });
    with(Field { array: 2, ..ours[1] });
    with(Field { name: "distance", ..ours[1] });
}

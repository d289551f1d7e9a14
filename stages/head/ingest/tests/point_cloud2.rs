//! `sensor_msgs/msg/PointCloud2` from messages written by hand.

#![allow(clippy::unwrap_used, clippy::panic)]

use proptest::prelude::*;
use stillpoint_ingest::point_cloud2::{PointCloud2, PointCloud2Error};

/// A message as a ROS 2 driver writes it.
#[derive(Clone)]
struct Message {
    height: u32,
    width: u32,
    fields: Vec<(&'static str, u32, u8, u32)>,
    is_bigendian: u8,
    point_step: u32,
    row_step: u32,
    data: Vec<u8>,
}

impl Message {
    /// A row of points with a colour between y and z, as many drivers have it.
    fn row(points: &[[f32; 3]]) -> Self {
        let data = points.iter().flat_map(|p| {
            let mut point = [0xee; 24];
            point[4..8].copy_from_slice(&p[0].to_le_bytes());
            point[8..12].copy_from_slice(&p[1].to_le_bytes());
            point[16..20].copy_from_slice(&p[2].to_le_bytes());
            point
        });
        Self {
            height: 1,
            width: points.len() as u32,
            fields: vec![("x", 4, 7, 1), ("y", 8, 7, 1), ("rgb", 12, 6, 1), ("z", 16, 7, 1)],
            is_bigendian: 0,
            point_step: 24,
            row_step: 24 * points.len() as u32,
            data: data.collect(),
        }
    }

    fn bytes(&self, big_endian: bool) -> Vec<u8> {
        let mut out = vec![0, u8::from(!big_endian), 0, 0];
        let word = |out: &mut Vec<u8>, v: u32| {
            out.resize(out.len().next_multiple_of(4), 0);
            out.extend(if big_endian { v.to_be_bytes() } else { v.to_le_bytes() });
        };
        let text = |out: &mut Vec<u8>, t: &str| {
            word(out, t.len() as u32 + 1);
            out.extend(t.as_bytes());
            out.push(0);
        };
        word(&mut out, 12);
        word(&mut out, 34);
        text(&mut out, "camera_link");
        word(&mut out, self.height);
        word(&mut out, self.width);
        word(&mut out, self.fields.len() as u32);
        for (name, offset, datatype, count) in &self.fields {
            text(&mut out, name);
            word(&mut out, *offset);
            out.push(*datatype);
            word(&mut out, *count);
        }
        out.push(self.is_bigendian);
        word(&mut out, self.point_step);
        word(&mut out, self.row_step);
        word(&mut out, self.data.len() as u32);
        out.extend(&self.data);
        out.push(1);
        out
    }
}

const POINTS: [[f32; 3]; 3] = [[0.1, -0.2, 0.9], [1.0, 2.0, 3.0], [-4.0, 0.0, 5.5]];

fn points(bytes: &[u8]) -> Vec<[f32; 3]> {
    PointCloud2::parse(bytes).unwrap().points().collect()
}

fn error(message: &Message) -> PointCloud2Error {
    PointCloud2::parse(&message.bytes(false)).unwrap_err()
}

#[test]
fn points_are_read_between_other_fields_in_both_byte_orders_of_cdr() {
    let message = Message::row(&POINTS);
    assert_eq!(points(&message.bytes(false)), POINTS);
    assert_eq!(points(&message.bytes(true)), POINTS);
}

#[test]
fn data_of_the_other_byte_order_and_of_doubles_is_read() {
    let mut message = Message::row(&POINTS);
    message.is_bigendian = 1;
    message.fields = vec![("z", 16, 8, 1), ("y", 8, 8, 1), ("x", 0, 8, 1)];
    message.data = POINTS.iter().flatten().flat_map(|c| f64::from(*c).to_be_bytes()).collect();
    assert_eq!(points(&message.bytes(false)), POINTS);
}

#[test]
fn rows_may_have_bytes_behind_them() {
    let mut message = Message::row(&POINTS[..2]);
    (message.width, message.height, message.row_step) = (1, 2, 30);
    let (first, second) = message.data.split_at(24);
    message.data = [first, &[0xaa; 6], second].concat();
    let bytes = message.bytes(false);
    let cloud = PointCloud2::parse(&bytes).unwrap();
    assert_eq!((cloud.width(), cloud.height()), (1, 2));
    assert_eq!(cloud.points().collect::<Vec<_>>(), POINTS[..2]);
}

#[test]
fn a_point_that_is_not_finite_is_the_invalid_point() {
    let read = points(&Message::row(&[[f32::INFINITY, 0.0, 1.0]]).bytes(false));
    assert_eq!(read[0].map(f32::to_bits), stillpoint_ingest::INVALID_POINT.map(f32::to_bits));
}

#[test]
fn sizes_that_do_not_fit_are_refused_with_their_numbers() {
    let message = Message::row(&POINTS);
    let short = Message { data: message.data[..71].to_vec(), ..message.clone() };
    assert_eq!(error(&short).to_string(), "3 x 1 points need 72 bytes of data, the message has 71");
    let overlapping = Message { height: 2, row_step: 60, ..message.clone() };
    assert_eq!(
        error(&overlapping).to_string(),
        "row_step is 60, but 3 points of 24 bytes take 72, and 2 such rows do not make the 72 bytes of data"
    );
    let outside = Message { point_step: 18, ..message.clone() };
    assert_eq!(error(&outside).to_string(), "field `z` ends at byte 20 of a point of 18 bytes");
    let huge = Message { width: u32::MAX, height: u32::MAX, row_step: u32::MAX, point_step: 24, ..message };
    assert!(matches!(error(&huge), PointCloud2Error::RowStep { .. } | PointCloud2Error::Data { .. }));
}

#[test]
fn coordinates_that_are_none_are_refused_by_name() {
    let with = |fields: &[(&'static str, u32, u8, u32)]| {
        error(&Message { fields: fields.to_vec(), ..Message::row(&POINTS) }).to_string()
    };
    let missing = with(&[("x", 4, 7, 1), ("y", 8, 7, 1)]);
    assert_eq!(missing, "the message needs exactly one field `z` and has 0");
    let twice = with(&[("x", 4, 7, 1), ("y", 8, 7, 1), ("y", 8, 7, 1), ("z", 16, 7, 1)]);
    assert_eq!(twice, "the message needs exactly one field `y` and has 2");
    let whole = with(&[("x", 4, 5, 1), ("y", 8, 7, 1), ("z", 16, 7, 1)]);
    assert!(whole.starts_with("field `x` is 1 of type 5;"), "{whole}");
}

#[test]
fn rows_without_points_are_refused_rather_than_counted() {
    let message = Message { width: 0, height: u32::MAX, row_step: 0, ..Message::row(&[]) };
    assert!(matches!(error(&message), PointCloud2Error::Data { .. }));
    let empty = Message { height: 0, ..Message::row(&[]) };
    assert_eq!(points(&empty.bytes(false)), [[0.0; 3]; 0]);
}

#[test]
fn another_encapsulation_is_refused_with_its_bytes() {
    let mut bytes = Message::row(&POINTS).bytes(false);
    bytes[1] = 3;
    let error = PointCloud2::parse(&bytes).unwrap_err().to_string();
    assert!(error.starts_with("it starts with [00, 03, 00, 00], which does not mark plain CDR"), "{error}");
}

#[test]
fn a_stamp_or_a_text_that_is_damaged_is_refused_as_the_recorder_refuses_it() {
    let message = Message::row(&POINTS).bytes(false);
    let damaged = |place: usize| {
        let mut bytes = message.clone();
        bytes[place] = 0xff;
        PointCloud2::parse(&bytes).unwrap_err().to_string()
    };
    let no_time = damaged(11);
    assert!(no_time.ends_with(" ns is not a time (the header)"), "{no_time}");
    assert_eq!(damaged(16), "its text at byte 16 is not UTF-8 (the header)");
    let cut = PointCloud2::parse(&message[..30]).unwrap_err().to_string();
    assert_eq!(cut, "it ends at byte 30, and its field at byte 28 needs 4 bytes (height)");
}

proptest! {

    #[test]
    fn broken_bytes_are_read_or_refused_and_never_more(
        cut in any::<prop::sample::Index>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        keep in any::<bool>(),
    ) {
        let mut bytes = Message::row(&POINTS).bytes(false);
        for (place, value) in changes {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        if !keep {
            bytes.truncate(cut.index(bytes.len() + 1));
        }
        if let Ok(cloud) = PointCloud2::parse(&bytes) {
            // A coordinate takes four bytes of its own point.
            prop_assert!(cloud.points().count() <= bytes.len() / 4);
        }
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = PointCloud2::parse(&bytes).map(|cloud| cloud.points().take(1000).count());
    }
}

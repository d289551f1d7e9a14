//! The static frames as `tf2_msgs/msg/TFMessage` on `/tf_static`.

use super::Fault;
use stillpoint_cdr::{Reader, Writer};

/// A frame that does not move in its parent: the transform `parent_from_child`.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticTransform {
    /// Name of the frame that it is given in.
    pub parent: String,
    /// Name of the frame that it places.
    pub child: String,
    /// Translation, m.
    pub translation: [f64; 3],
    /// Unit quaternion, scalar first.
    pub rotation: [f64; 4],
}

/// The message. `stamp` is ns; beyond the range of ROS time it is written as 0.
pub(crate) fn transforms_message(stamp: u64, transforms: &[StaticTransform]) -> Vec<u8> {
    let stamp = if stillpoint_cdr::is_ros_time(stamp) { stamp } else { 0 };
    let mut out = Vec::new();
    let mut w = Writer::new(&mut out);
    w.u32(transforms.len() as u32);
    for t in transforms {
        w.header(stamp, &t.parent);
        w.text(&t.child);
        w.f64s(&t.translation);
        let [qw, qx, qy, qz] = t.rotation;
        w.f64s(&[qx, qy, qz, qw]);
    }
    out
}

/// The transforms of a message.
pub(crate) fn transforms_from(data: &[u8]) -> Result<Vec<StaticTransform>, Fault> {
    let mut r = Reader::new(data)?;
    let count = r.u32()?;
    let mut transforms = Vec::new();
    for _ in 0..count {
        r.u32()?;
        r.u32()?;
        let (parent, child) = (r.text()?.to_owned(), r.text()?.to_owned());
        let translation = [r.f64()?, r.f64()?, r.f64()?];
        let [qx, qy, qz, qw] = [r.f64()?, r.f64()?, r.f64()?, r.f64()?];
        transforms.push(StaticTransform { parent, child, translation, rotation: [qw, qx, qy, qz] });
    }
    Ok(transforms)
}

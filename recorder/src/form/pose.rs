//! `Pose` as `geometry_msgs/msg/PoseWithCovarianceStamped`. ROS puts the scalar of a quaternion last, a sample first.

use stillpoint_samples::{Pieces, PoseElement};
use zerocopy::{FromBytes, IntoBytes};

use super::{Decoded, Envelope, Fault, Shared};
use stillpoint_cdr::{Reader, Writer};

pub(super) fn encode(sample: &Pieces<'_>, frame: &str, out: &mut Vec<u8>) {
    let mut w = Writer::new(out);
    w.header(sample.header().origin, frame);
    if let Ok(pose) = PoseElement::read_from_bytes(sample.payload) {
        let [qw, qx, qy, qz] = pose.orientation;
        w.f64s(&pose.position);
        w.f64s(&[qx, qy, qz, qw]);
        w.f64s(&pose.covariance);
    }
}

pub(super) fn decode(shared: &Shared, envelope: Envelope, data: &[u8]) -> Result<Decoded<'static>, Fault> {
    let mut r = Reader::new(data)?;
    let stamp = r.header()?;
    let mut position = [0.0; 3];
    for p in &mut position {
        *p = r.f64()?;
    }
    let [qx, qy, qz, qw] = [r.f64()?, r.f64()?, r.f64()?, r.f64()?];
    let mut covariance = [0.0; 36];
    for c in &mut covariance {
        *c = r.f64()?;
    }
    let pose = PoseElement { position, orientation: [qw, qx, qy, qz], covariance };
    let header = shared.header(envelope, stamp, 1);
    Ok(Decoded { meta: header.as_bytes().to_vec().into(), payload: pose.as_bytes().to_vec().into() })
}

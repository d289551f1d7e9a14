//! A bag that the Python package `rosbags` wrote is read. `STILLPOINT_PYTHON` names a Python that has it.

#![allow(clippy::unwrap_used)]

use std::process::Command;

use stillpoint_ingest::depth::{Intrinsics, deproject};
use stillpoint_operator::Registry;
use stillpoint_operator::files::DiskFiles;
use stillpoint_samples::PointCloud;
use stillpoint_testing::run;

/// Writes two bags with three depth images 33 ms apart: `bag` as MCAP, `old` as a database.
const WRITE: &str = r#"
import sys
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_HUMBLE)
t = store.types
Header, Time = t['std_msgs/msg/Header'], t['builtin_interfaces/msg/Time']
Image, Info = t['sensor_msgs/msg/Image'], t['sensor_msgs/msg/CameraInfo']
Region = t['sensor_msgs/msg/RegionOfInterest']
counts = np.array([1000, 0, 1234, 65535, 1, 777], dtype='<u2')

def header(number):
    return Header(stamp=Time(sec=5, nanosec=number * 33_000_000), frame_id='camera')

for name, plugin in [('bag', StoragePlugin.MCAP), ('old', StoragePlugin.SQLITE3)]:
    with Writer(f'{sys.argv[1]}/{name}', version=9, storage_plugin=plugin) as writer:
        image = writer.add_connection('/depth/image_raw', Image.__msgtype__, typestore=store)
        info = writer.add_connection('/depth/camera_info', Info.__msgtype__, typestore=store)
        k = np.array([500.0, 0, 1, 0, 400, 0.5, 0, 0, 1])
        p = np.array([500.0, 0, 1, 0, 0, 400, 0.5, 0, 0, 0, 1, 0])
        camera = Info(header=header(0), height=2, width=3, distortion_model='plumb_bob', d=np.zeros(5), k=k, r=np.eye(3).ravel(), p=p, binning_x=0, binning_y=0,
            roi=Region(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False))
        for number in range(3):
            stamp = 6_000_000_000 + number * 40_000_000
            writer.write(info, stamp, store.serialize_cdr(camera, Info.__msgtype__))
            depth = Image(header=header(number), height=2, width=3, encoding='16UC1', is_bigendian=0, step=6, data=(counts + number * (counts > 0)).astype('<u2').view(np.uint8))
            writer.write(image, stamp, store.serialize_cdr(depth, Image.__msgtype__))
"#;

#[test]
fn a_bag_that_rosbags_wrote_is_read() {
    let python = std::env::var("STILLPOINT_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let probe =
        Command::new(&python).args(["-c", "import numpy, rosbags.rosbag2 as r; r.StoragePlugin"]).output();
    if !probe.is_ok_and(|probe| probe.status.success()) {
        eprintln!("skipped: {python} has no rosbags; STILLPOINT_PYTHON names another one");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = Command::new(python).args(["-c", WRITE]).arg(folder.path()).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let files = DiskFiles::next_to(&folder.path().join("pipeline.yaml"));
    let of = |bag: &str| {
        let text = format!(
            "stillpoint: 1\nname: bags\nframes: {{ camera: {{ parent: couch, at: [0 m, 0 m, 1 m] }} }}\noperators:\n  \
             it: {{ use: ingest.mcap, every: 1 ms, frame: camera, params: {{ file: {bag}, topic: /depth/image_raw, pace: recorded }} }}\n"
        );
        run(&text, &Registry::new(&[stillpoint_ingest::STAGES]), &files, 200)
    };
    let run = of("bag").unwrap();
    let sent = run.samples::<PointCloud>("it.cloud");
    let times: Vec<u64> =
        sent.iter().map(|c| (c.header.origin - sent[0].header.origin) / 1_000_000).collect();
    assert_eq!(times, [0, 33, 66]);
    let camera = Intrinsics { fx: 500.0, fy: 400.0, cx: 1.0, cy: 0.5, metres_per_count: 1e-3 };
    for (number, cloud) in sent.iter().enumerate() {
        let counts = [1000, 0, 1234, 65535, 1, 777_u16]
            .map(|c| if c == 0 { 0 } else { c.wrapping_add(number as u16) });
        let mut points = [[0.0; 3]; 6];
        deproject(&counts, 3, 2, &camera, &mut points).unwrap();
        let found: Vec<_> = cloud.elements.iter().map(|p| p.xyz.map(f32::to_bits)).collect();
        assert_eq!(found, points.map(|p| p.map(f32::to_bits)), "{number}");
    }
    let Err(database) = of("old") else { unreachable!("a database was read") };
    assert!(database.contains("its storage is sqlite3"), "{database}");
}

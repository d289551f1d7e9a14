//! What a detection takes from the heap, from image to image.

#![allow(clippy::unwrap_used)]

use stillpoint_detect::{DetectParams, FaceDetector, Top};
use stillpoint_testing::reference;

/// The most bytes that a detection holds at once, and the most pieces that it takes, of images that come round and round.
fn of_rounds(images: &[Vec<u8>], width: usize, params: &DetectParams) -> [u64; 2] {
    let mut detector = FaceDetector::new().unwrap();
    let mut most = [0; 2];
    for round in 0..3 {
        for image in images {
            let mut found = Vec::new();
            let taken = allocation_counter::measure(|| found = detector.find(image, width, params));
            let retained = (found.capacity() * size_of::<stillpoint_detect::Face>()) as i64;
            // The first round grows the detector's own buffers.
            assert!(round == 0 || taken.bytes_current == retained, "it grows in round {round}: {taken:?}");
            if round > 0 {
                most = [most[0].max(taken.bytes_max), most[1].max(taken.count_total)];
            }
        }
    }
    most
}

#[test]
fn a_detection_keeps_nothing_and_what_it_takes_is_bounded() {
    let noise = |seed: u32| -> Vec<u8> {
        (0..320 * 240_u32).map(|i| ((i ^ seed).wrapping_mul(1_103_515_245) >> 16) as u8).collect()
    };
    let params = DetectParams { top: Top::Up, smallest: 40, largest: 120, least_score: 2.0 };
    let [bytes, pieces] = of_rounds(&[noise(0), noise(77), vec![128; 320 * 240]], 320, &params);
    eprintln!("noise of 320 x 240: {bytes} bytes at once, {pieces} pieces");
    assert!(bytes < 6_000_000 && pieces < 6_000);
    let Some(root) = reference::folder("perception/real") else { return };
    let file = std::fs::read(root.join("ensenso_ir_face_1.png")).unwrap();
    let image = stillpoint_ingest::grey::decode_png(&file).unwrap();
    let params = DetectParams { top: Top::Left, smallest: 80, largest: 640, least_score: 2.0 };
    let [bytes, pieces] = of_rounds(&[image.pixels], image.width, &params);
    eprintln!("photograph of 1280 x 1024: {bytes} bytes at once, {pieces} pieces");
    assert!(bytes < 20_000_000 && pieces < 64_000);
}

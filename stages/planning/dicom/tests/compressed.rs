//! An image that another program compressed: GDCM 3 and, to JPEG 2000, OpenJPEG 2.5; from 12 x 9 words of 12 bits.

use dicom_core::value::{PixelFragmentSequence, Value};
use dicom_core::{DataElement, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;

use crate::fixture::{COUNTS, ct, file_as, put};

const JPEG: &str = "\
ffd8ffc3000b100009000c01011100ffc4001b0001010101010101010000000000000000060c0b090a08050fffda0008010100010000fe\
000dfbc952a5f9cbed74a952f2e7b21db54a97801e9252a54be51fd81254bdbcf11deeed2a54b9eae8e8952a5cc73b78952a5c98f5e64a\
952e355b4fa5ede25c3c77584a952e071408a54a97116a3292a54b3635306952a59836a3ca9852a59552af54a952c9375d7254bdbc8f8a\
c674a952c653690254a96270ede254a961b7ba492a54b07f5e9697ffd9";
const RLE: &str = "\
0200000040000000a200000000000000000000000000000000000000000000000000000000000000000000000000000000000000000000\
000000000000000000fa00fe01010001ff01010200fd020000fe030603000303040400fd040000fd05010005fe060000ff0602060700fd\
070000fd0805000808090900fd0901000afe0a01000afe0b0000fe0b010c00fd0c0000fd0d0000000dfe0e0000fe0e010f00ff0f0b0725\
4a6f9407de03284d07970bbce1060750759abf07092e530b7807c2e70c31077ba0c5ea070b34597ea307ed12375c07a6cb0bf015075f84\
a9ce07183d62870b07d1f61b40078aafd4f907430b688db207fc21466b07b5daff0b24076e93b8dd07274c7196070be0052a4f0799bee3\
0807527700";

const JPEG2000: &str = "\
ff4fff51002900000000000c0000000900000000000000000000000c00000009000000000000000000010b0101ff52000c000000010000\
04040001ff5c00044060ff640025000143726561746564206279204f70656e4a5045472076657273696f6e20322e352e34ff90000a0000\
000000b30001ff93cfe6a2111df667f1164c0fe920e8063afaea25f28d3d033a9634006afb78f211df7314cb99c5d93d03bf8efa900a8b\
2e9fb2456acfda4c62b884b635683dee796f60fc0287a11ff394d290459cc0b1967415bcf07735d3ac3f16ecbe3a24f7a88e2fca571699\
e7f88476678c7ffeee361432ebaaff71990f049c6eba647baac77586bf8108676085fe11f036bbf3565c77c53780bb4bed7286d1e4862b\
ceb3b6777f02b915ffd9";
/// The words less 2048, as signed ones.
const JPEG2000_SIGNED: &str = "\
ff4fff51002900000000000c0000000900000000000000000000000c00000009000000000000000000018b0101ff52000c000000010000\
04040001ff5c00044060ff640025000143726561746564206279204f70656e4a5045472076657273696f6e20322e352e34ff90000a0000\
000000b30001ff93cfe6a2111df667f1164c0fe920e8063afaea25f28d3d033a9634006afb78f211df7314cb99c5d93d03bf8efa900a8b\
2e9fb2456acfda4c62b884b635683dee796f60fc0287a11ff394d290459cc0b1967415bcf07735d3ac3f16ecbe3a24f7a88e2fca571699\
e7f88476678c7ffeee361432ebaaff71990f049c6eba647baac77586bf8108676085fe11f036bbf3565c77c53780bb4bed7286d1e4862b\
ceb3b6777f02b915ffd9";

/// The words that were compressed.
pub fn words() -> impl Iterator<Item = u16> {
    (0..(COUNTS[0] * COUNTS[1]) as u16).map(|i| if i % 5 == 0 { 7 } else { i * 37 % 4096 })
}

/// Transfer syntaxes with the compressed image.
pub fn pieces() -> [(&'static str, Vec<u8>); 4] {
    let jpeg = bytes(JPEG);
    [
        (uids::JPEG_LOSSLESS, jpeg.clone()),
        (uids::JPEG_LOSSLESS_SV1, jpeg),
        (uids::RLE_LOSSLESS, bytes(RLE)),
        (uids::JPEG2000_LOSSLESS, bytes(JPEG2000)),
    ]
}

/// JPEG 2000 with signed words, each less by 2048 than that of [`words`].
pub fn signed_piece() -> Vec<u8> {
    bytes(JPEG2000_SIGNED)
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|i| u8::from_str_radix(&hex[2 * i..2 * i + 2], 16).unwrap()).collect()
}

/// The file of the image at this place with these compressed pixels.
pub fn image(slice: usize, syntax: &str, piece: &[u8]) -> Vec<u8> {
    let mut object = ct(slice);
    put(&mut object, tags::RESCALE_SLOPE, VR::DS, "1");
    put(&mut object, tags::RESCALE_INTERCEPT, VR::DS, "-1024");
    put_piece(&mut object, piece);
    file_as(&object, syntax)
}

pub fn put_piece(object: &mut InMemDicomObject, piece: &[u8]) {
    let pieces = PixelFragmentSequence::new_fragments(vec![piece.to_vec()]);
    object.put(DataElement::new(tags::PIXEL_DATA, VR::OB, Value::from(pieces)));
}

//! The fields of MCAP records, appended to bytes.

use std::collections::BTreeMap;

/// Appends fields as MCAP has them: little-endian, texts and maps with their length in bytes before them.
pub(super) trait Put {
    fn u16(&mut self, v: u16);
    fn u32(&mut self, v: u32);
    fn u64(&mut self, v: u64);
    fn text(&mut self, text: &str);
    /// What `inside` appends, with its length in bytes before it.
    fn sized(&mut self, inside: impl FnOnce(&mut Self));
    fn texts(&mut self, map: &BTreeMap<String, String>) {
        self.sized(|out| {
            for (key, value) in map {
                out.text(key);
                out.text(value);
            }
        });
    }
    /// A channel's number and a count or an offset, for each channel.
    fn numbers(&mut self, map: &BTreeMap<u16, u64>);
}

impl Put for Vec<u8> {
    fn u16(&mut self, v: u16) {
        self.extend_from_slice(&v.to_le_bytes());
    }

    fn u32(&mut self, v: u32) {
        self.extend_from_slice(&v.to_le_bytes());
    }

    fn u64(&mut self, v: u64) {
        self.extend_from_slice(&v.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32);
        self.extend_from_slice(text.as_bytes());
    }

    fn sized(&mut self, inside: impl FnOnce(&mut Self)) {
        let start = self.len();
        self.u32(0);
        inside(self);
        let length = (self.len() - start - 4) as u32;
        self[start..start + 4].copy_from_slice(&length.to_le_bytes());
    }

    fn numbers(&mut self, map: &BTreeMap<u16, u64>) {
        self.sized(|out| {
            for (channel, number) in map {
                out.u16(*channel);
                out.u64(*number);
            }
        });
    }
}

/// Appends a record: its opcode, its length, and the body that `body` appends.
pub(super) fn record(out: &mut Vec<u8>, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) {
    let start = out.len();
    out.push(opcode);
    out.u64(0);
    body(out);
    let length = (out.len() - start - super::record::RECORD_HEADER) as u64;
    out[start + 1..start + super::record::RECORD_HEADER].copy_from_slice(&length.to_le_bytes());
}

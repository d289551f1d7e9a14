//! Files with random damage are read whole or refused: never a panic. `PROPTEST_CASES` sets how many.

use proptest::prelude::*;
use proptest::sample::Index;
use stillpoint_plan::measured::read;

use crate::depth_dose_table;

const WORDS: [&str; 14] = [
    "nan",
    "inf",
    "-1",
    "1e308",
    "1e-308",
    "99999",
    ",",
    ";",
    "\n",
    "<",
    ">",
    "$ENOM\n",
    "END_DATA\n",
    "\u{e9}",
];

fn harmed(text: &str, harms: &[(Index, u8, usize)]) -> Vec<u8> {
    let mut bytes = text.as_bytes().to_vec();
    for (at, kind, number) in harms {
        if bytes.is_empty() {
            break;
        }
        let at = at.index(bytes.len());
        match kind % 5 {
            0 => bytes.truncate(at),
            1 => bytes[at] = *number as u8,
            2 => drop(bytes.drain(at..(at + number % 40).min(bytes.len()))),
            3 => drop(bytes.splice(at..at, WORDS[number % WORDS.len()].bytes())),
            _ => {
                let piece = bytes[at..(at + number % 60).min(bytes.len())].to_vec();
                bytes.splice(at..at, piece);
            }
        }
    }
    bytes
}

/// What is read has the order and the numbers that a fit needs.
fn is_whole(bytes: &[u8]) {
    let Ok(measured) = read("broken", bytes) else { return };
    for curve in &measured.curves {
        assert!(curve.points.windows(2).all(|two| two[0].at_mm < two[1].at_mm));
        assert!(curve.points.iter().all(|point| point.value.is_finite() && point.value >= 0.0));
        assert!(curve.greatest().value > 0.0);
    }
}

fn harms() -> impl Strategy<Value = Vec<(Index, u8, usize)>> {
    prop::collection::vec((any::<Index>(), any::<u8>(), any::<usize>()), 1..4)
}

fn config() -> ProptestConfig {
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(200);
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn tables(harms in harms()) {
        is_whole(&harmed(&depth_dose_table(10.0), &harms));
    }

    #[test]
    fn w2cad_files(harms in harms()) {
        is_whole(&harmed(&crate::w2cad::whole(), &harms));
    }

    #[test]
    fn mcc_files(harms in harms()) {
        is_whole(&harmed(crate::mcc::PROFILES, &harms));
    }
}

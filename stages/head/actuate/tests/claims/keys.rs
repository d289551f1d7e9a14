//! Keys and their files.

use stillpoint_actuate::{Key, KeyError};
use stillpoint_operator::activation::RandomKey;

use super::sent::key;

const DIGITS: &str = "00112233445566778899aabbccddeeff0123456789ABCDEF0123456789abcdef";

#[test]
fn a_key_is_read_with_remarks_and_line_breaks() {
    let text = format!("# for the mannequin\r\n{}\n  {}\n", &DIGITS[..32], &DIGITS[32..]);
    assert_eq!(Key::parse(text.as_bytes()).unwrap().code(b"x"), key().code(b"x"));
}

#[test]
fn what_is_wrong_with_a_key_file_is_said_with_its_place() {
    let fault = |text: &str| Key::parse(text.as_bytes()).unwrap_err();
    assert_eq!(fault(""), KeyError::Length { found: 0 });
    assert_eq!(fault(&DIGITS[1..]), KeyError::Length { found: 63 });
    assert_eq!(fault(&format!("{DIGITS}0")), KeyError::Length { found: 65 });
    assert_eq!(fault(&format!("# key\n{}g", &DIGITS[1..])), KeyError::Digit { line: 2, column: 64 });
    assert_eq!(fault(&"7".repeat(64)), KeyError::Uniform);
    assert_eq!(
        fault("0 1").to_string(),
        "the key file has 2 hexadecimal digits, but a key is 64 of them (32 bytes)"
    );
}

#[test]
fn a_key_does_not_print_itself() {
    assert_eq!(format!("{:?}", key()), "Key(..)");
}

#[test]
fn the_code_is_that_of_rfc_4231() {
    // Test case 1, with its key of 20 bytes filled up with the zeros that HMAC adds itself.
    let text = format!("{}{}", "0b".repeat(20), "00".repeat(12));
    let code = Key::parse(text.as_bytes()).unwrap().code(b"Hi There");
    let hex: String = code.iter().map(|b| format!("{b:02x}")).collect();
    assert_eq!(hex, "b0344c61d8db38535ca8afceaf0bf12b881dc200c9833da726e9376c2e32cff7");
}

#[test]
fn nonces_differ_with_everything_that_makes_a_session_another() {
    let begun = |started: u64, seed: u64, operator: u64, incarnation: u32| {
        let random = RandomKey { seed, operator, incarnation };
        stillpoint_actuate::Session::begun(&key(), started, &random).nonce
    };
    let nonces =
        [begun(5, 1, 2, 0), begun(6, 1, 2, 0), begun(5, 2, 2, 0), begun(5, 1, 3, 0), begun(5, 1, 2, 1)];
    for (i, a) in nonces.iter().enumerate() {
        assert!(nonces.iter().skip(i + 1).all(|b| a != b));
    }
    assert_eq!(nonces[0], begun(5, 1, 2, 0));
}

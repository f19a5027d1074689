//! The header of a firmware image, and serial numbers.

use plantar::protocol::update::Header;
use plantar::protocol::{Serial, decode, encode};

/// The numbers of a version: three decimal numbers below 65,536 with points between them, optionally followed by a plus sign
/// and any text; `None` for a text of another form.
fn numbers(version: &str) -> Option<[u16; 3]> {
    let release: String = version.chars().take_while(|&c| c != '+').collect();
    let numbers: Vec<u16> = release
        .split('.')
        .map(|digits| {
            let is_number = !digits.is_empty() && digits.chars().all(|c| c.is_ascii_digit());
            let value =
                digits.chars().try_fold(0u64, |value, c| value.checked_mul(10)?.checked_add(c.to_digit(10)?.into()));
            value.filter(|&value| is_number && value <= 65_535).map(|value| value as u16)
        })
        .collect::<Option<_>>()?;
    numbers.try_into().ok()
}

/// The numbers of a version, a text of at most 16 bytes, are read as they are written. A text of another form has no numbers,
/// and a header that contains it is not accepted.
pub fn version(version: &str) {
    let header = Header::new("board", version);
    assert_eq!((header.board(), header.version()), ("board", version));
    assert_eq!(header.number(), numbers(version), "{version}");
    assert_eq!(Header::read(&header.bytes()), numbers(version).map(|_| header));
}

/// The bytes are a header if and only if they begin with the magic number of a header, and the text of the version, up to its
/// first zero, is a valid version.
pub fn header(bytes: &[u8; Header::BYTES]) {
    // Eight bytes of the magic number, 16 of the board, and 16 of the version.
    let (start, version) = bytes.split_at(24);
    let text = version.split(|byte| *byte == 0).next().and_then(|text| str::from_utf8(text).ok()).unwrap_or_default();
    let expected = numbers(text).filter(|_| start.starts_with(b"plantar1"));
    let read = Header::read(bytes);
    assert_eq!(read.and_then(|header| header.number()), expected);
    assert!(read.is_none_or(|header| header.bytes() == *bytes));
}

/// A serial number is a text of up to 16 printable ASCII characters without spaces, and it is encoded as this text, followed by
/// zeros.
pub fn serial(text: &str) {
    let serial = Serial::new(text);
    let is_printable = text.chars().all(|c| ('!'..='~').contains(&c));
    assert_eq!(serial.is_some(), is_printable && text.len() <= 16);
    if let Some(serial) = serial {
        assert!(serial.is_valid() && serial.as_str() == text);
        let mut bytes = [0; 16];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        assert!(encode(&serial, &mut [0; 16]).is_ok_and(|encoded| encoded == bytes));
    }
}

/// 16 bytes are a valid serial number if and only if they are printable ASCII characters without spaces, followed by zeros only.
pub fn serial_bytes(bytes: [u8; 16]) {
    let serial: Serial = decode(&bytes).expect("any 16 bytes");
    let end = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    assert_eq!(serial.is_valid(), bytes[..end].iter().all(|byte| (b'!'..=b'~').contains(byte)));
}

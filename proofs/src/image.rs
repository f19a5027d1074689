//! The header of a firmware image.

use plantar::protocol::update::Header;

/// The numbers of a version: three decimal numbers of 16 bits with points between them, and anything after a plus sign.
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

/// The numbers of a version of at most 16 bytes are read as they are written, and a version of another form has none.
pub fn version(version: &str) {
    let header = Header::new("board", version);
    assert_eq!((header.board(), header.version()), ("board", version));
    assert_eq!(header.number(), numbers(version), "{version}");
    assert_eq!(Header::read(&header.bytes()), numbers(version).map(|_| header));
}

/// The bytes are a header if and only if they begin with the mark of a header, and the text up to the first zero of the version is
/// one.
pub fn header(bytes: &[u8; Header::BYTES]) {
    let (start, version) = bytes.split_at(24);
    let text = version.split(|byte| *byte == 0).next().and_then(|text| str::from_utf8(text).ok()).unwrap_or_default();
    let expected = numbers(text).filter(|_| start.starts_with(b"plantar1"));
    let read = Header::read(bytes);
    assert_eq!(read.and_then(|header| header.number()), expected);
    assert!(read.is_none_or(|header| header.bytes() == *bytes));
}

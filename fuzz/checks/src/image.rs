//! A firmware image, as `plantar update` reads it, and its header, as an insole reads it: each is refused, or has the same bytes
//! when it is encoded again.

use firmware_image::Image;
use plantar::protocol::update::Header;
use std::path::Path;

/// Checks one input.
pub fn check(data: &[u8]) {
    if let Some(header) = data.first_chunk().and_then(Header::read) {
        assert_eq!(header.bytes(), data[..Header::BYTES]);
    }
    if let Ok(image) = Image::parse(data, Path::new("fuzzed")) {
        assert_eq!(image.file(), data);
    }
}

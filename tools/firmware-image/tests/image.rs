//! Tests of signed images and keys: a signed file can be read, a changed one is detected.

use firmware_image::{DEVELOPMENT_KEY, Error, Image, SigningKey, development_key, flash_image, read_signing_key};
use plantar::protocol::mcuboot::FRONT;
use plantar::protocol::update::{CHUNK, Header};
use plantar::storage::flash_map::{HEADER, MAX_IMAGE};
use plantar::storage::update::KEY;
use std::path::Path;

/// An image of ten chunks of random bytes with a valid header.
fn image(key: &SigningKey) -> Image {
    image_of(10, key)
}

/// As [`image`], with this number of chunks.
fn image_of(chunks: usize, key: &SigningKey) -> Image {
    let mut bytes: Vec<u8> = std::iter::repeat_with(|| fastrand::u8(..)).take(chunks * CHUNK).collect();
    let header = Header::new("emulated", "1.2.3").bytes();
    bytes[HEADER as usize..][..header.len()].copy_from_slice(&header);
    Image::sign(bytes, key).expect("it has a header")
}

#[test]
fn a_file_contains_the_image_and_any_change_of_it_is_detected() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("image.bin");
    let image = image(&SigningKey::from_bytes(&[7; 32]));
    let file = image.file();
    std::fs::write(&path, &file).expect("written");
    let read = Image::read(&path).expect("a valid image");
    assert_eq!(read, image);
    assert_eq!((read.header().board(), read.header().version(), read.offer().chunks), ("emulated", "1.2.3", 10));
    let chunks: Vec<u8> = (0..10).flat_map(|number| image.chunk(number).as_flattened().to_vec()).collect();
    assert_eq!(chunks, image.bytes());

    for bit in (0..8 * file.len()).step_by(97) {
        let mut flipped = file.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        std::fs::write(&path, &flipped).expect("written");
        assert!(Image::read(&path).is_err(), "bit {bit}");
    }
    for len in [0, 1, FRONT - 1, FRONT, HEADER as usize, file.len() - CHUNK, file.len() - 1] {
        std::fs::write(&path, &file[..len]).expect("written");
        let error = Image::read(&path).expect_err("it is cut short").to_string();
        assert!(error.contains("cut short") && error.contains("image.bin"), "{error}");
    }
}

#[test]
fn an_image_is_accepted_up_to_the_space_for_it() {
    let (key, path) = (SigningKey::from_bytes(&[7; 32]), Path::new("image.bin"));
    let largest = MAX_IMAGE as usize / CHUNK;
    let parse = |chunks: usize| Image::parse(&image_of(chunks, &key).file(), path).map(|image| image.bytes().len());
    assert_eq!(parse(largest).ok(), Some(MAX_IMAGE as usize));
    let error = parse(largest + 1).expect_err("it is too large").to_string();
    assert!(error.contains("image.bin") && error.contains(&format!("at most {MAX_IMAGE} bytes")), "{error}");
}

/// The texts of the header are printed. Someone else may have signed the file: it is refused before its signature is verified.
#[test]
fn an_image_with_a_control_character_in_its_header_is_refused() {
    let path = Path::new("image.bin");
    let file = image(&SigningKey::from_bytes(&[7; 32])).file();
    let header = Header::new("emulated", "1.2.3").bytes();
    let place =
        |within: &[u8], of: &[u8]| within.windows(of.len()).position(|bytes| bytes == of).expect("it is contained");
    // A file has the header twice: at its beginning and in the image.
    let first = place(&file, &header);
    let second = first + 1 + place(&file[first + 1..], &header);
    for text in ["emulated", "1.2.3"] {
        let last = place(&header, text.as_bytes()) + text.len() - 1;
        let mut changed = file.clone();
        (changed[first + last], changed[second + last]) = (0x1b, 0x1b);
        assert!(matches!(Image::parse(&changed, path), Err(Error::NotAnImage(_))), "{text}");
    }
    assert!(Image::parse(&file, path).is_ok());
}

#[test]
fn firmware_that_is_too_large_is_named_as_such() {
    let len = MAX_IMAGE + 1;
    // An ELF file for Arm with one program header, at 52, of a segment at 84 that is loaded to 0x0800_0000.
    let mut elf = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0\x02\0\x28\0".to_vec();
    for word in [1, 0, 52, 0, 0, 32 << 16 | 52, 40 << 16 | 1, 0] {
        elf.extend(u32::to_le_bytes(word));
    }
    for word in [1, 84, 0x0800_0000, 0x0800_0000, len, len, 5, 4] {
        elf.extend(u32::to_le_bytes(word));
    }
    elf.resize(84 + len as usize, 0);
    let header = Header::new("emulated", "1.2.3").bytes();
    elf[84 + HEADER as usize..][..header.len()].copy_from_slice(&header);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("firmware");
    std::fs::write(&path, elf).expect("written");
    let error = flash_image(&path).expect_err("it is too large").to_string();
    assert!(error.contains(&format!("{len} bytes")) && error.contains("smaller firmware"), "{error}");
}

#[test]
fn errors_for_invalid_firmware_and_key_files_name_the_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("firmware");
    assert!(matches!(flash_image(&path), Err(Error::Read(..))));
    std::fs::write(&path, b"\x7fELF").expect("written");
    assert!(flash_image(&path).expect_err("it is not firmware").to_string().contains("cargo xtask build"));
    assert!(read_signing_key(&path).expect_err("it is not a key").to_string().contains("cargo xtask key"));
    std::fs::write(&path, DEVELOPMENT_KEY).expect("written");
    assert_eq!(read_signing_key(&path).ok(), development_key());
}

#[test]
fn firmware_accepts_the_development_key_unless_it_is_built_with_another_key() {
    if option_env!("PLANTAR_UPDATE_KEY").is_none() {
        assert_eq!(development_key().map(|key| key.verifying_key().to_bytes()), Some(KEY));
    }
}

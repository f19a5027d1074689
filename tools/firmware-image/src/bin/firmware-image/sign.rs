//! Makes signed firmware images, and keys for signing.

use anyhow::{Context, Result, bail};
use firmware_image::{Image, SigningKey, development_key, flash_image, hex, read_signing_key};
use plantar::storage::update::KEY;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

/// Signs firmware, an ELF file from the linker, and writes the image.
pub fn sign(firmware: &Path, key: Option<&Path>, out: &Path) -> Result<()> {
    let key = signing_key(key)?;
    let image = Image::sign(flash_image(firmware)?, &key).context("the firmware has no header")?;
    std::fs::write(out, image.file()).with_context(|| format!("cannot write {}", out.display()))?;
    let (board, version, bytes) = (image.header().board(), image.header().version(), image.bytes().len());
    println!("{}: {board} {version}, {bytes} bytes", out.display());
    Ok(())
}

/// Returns the signing key: that in `file` or, without a file, the key for development. Refuses a key whose images the firmware
/// of this build does not accept.
fn signing_key(file: Option<&Path>) -> Result<SigningKey> {
    let key = match file {
        Some(file) => read_signing_key(file)?,
        None => development_key().context("tools/firmware-image/development.key is damaged: restore it with git")?,
    };
    let public = key.verifying_key();
    // KEY is the key that firmware accepts if it is built with the same PLANTAR_UPDATE_KEY as this program.
    if public.to_bytes() != KEY {
        bail!(
            "this program and the firmware are built for another key: set PLANTAR_UPDATE_KEY={}, and build both again",
            hex(public.as_bytes())
        );
    }
    if file.is_none() {
        println!("signed with the published key for development: use --key for insoles that other people wear");
    }
    Ok(key)
}

/// Makes a key for signing, and prints how to build firmware that accepts it.
pub fn make_key(out: &Path) -> Result<()> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).context("the operating system provides no random numbers")?;
    let key = SigningKey::from_bytes(&bytes);
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(out).with_context(|| format!("cannot create {}", out.display()))?;
    writeln!(
        file,
        "# Secret key for Plantar firmware. Its owner can replace the firmware of every insole that accepts it.\n{}",
        hex(&bytes)
    )
    .with_context(|| format!("cannot write {}", out.display()))?;
    println!("{}: keep it secret, and back it up in a safe place", out.display());
    println!("build firmware that accepts it with PLANTAR_UPDATE_KEY={}", hex(key.verifying_key().as_bytes()));
    Ok(())
}

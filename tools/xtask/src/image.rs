//! Signed firmware images, and the keys for them.

use anyhow::{Context, Result, bail};
use firmware_image::{Image, Secret, development, hex, raw, secret};
use plantar::storage::update::KEY;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::Path;

/// The key to sign with; without a file the one for development.
pub fn key(file: Option<&Path>) -> Result<Secret> {
    let secret = match file {
        Some(file) => secret(file)?,
        None => development().context("the key for development is damaged")?,
    };
    let public = secret.verifying_key();
    // Firmware that is built now takes the key that this program was built with.
    if public.to_bytes() != KEY {
        bail!(
            "the firmware would not take its own next image: build with PLANTAR_UPDATE_KEY={}",
            hex(public.as_bytes())
        );
    }
    if file.is_none() {
        println!("signed with the key for development, which everybody knows: give --key for insoles that others wear");
    }
    Ok(secret)
}

/// Signs what the linker wrote.
pub fn make(firmware: &Path, secret: &Secret, out: &Path) -> Result<()> {
    let image = Image::sign(raw(firmware)?, secret).context("the firmware says nothing of itself")?;
    std::fs::write(out, image.file()).with_context(|| format!("cannot write {}", out.display()))?;
    let (board, version, bytes) = (image.header().board(), image.header().version(), image.bytes().len());
    println!("{}: {board} {version}, {bytes} bytes", out.display());
    Ok(())
}

/// Makes a key.
pub fn make_key(out: &Path) -> Result<()> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).context("this computer gives no random numbers")?;
    let secret = Secret::from_bytes(&bytes);
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(out).with_context(|| format!("cannot make {}", out.display()))?;
    writeln!(file, "# Signs Plantar firmware. Whoever has it can change every insole that takes it.\n{}", hex(&bytes))?;
    println!("{}: keep it secret, and a copy of it safe", out.display());
    println!("build firmware that takes it with PLANTAR_UPDATE_KEY={}", hex(secret.verifying_key().as_bytes()));
    Ok(())
}

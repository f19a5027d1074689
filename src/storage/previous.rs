//! The return to the previous image, once, if a confirmed image crashes again and again.
//!
//! After a swap the previous image is in [`OTHER`], one sector after the beginning. A note in [`PREVIOUS`] has the header of the
//! image that replaced it, and the checksum of the previous image. The note is written before the new image is confirmed, and
//! erased before anything is written over the previous image. So the note guards against two dangers: an image that was received
//! and never verified must not be swapped in, and neither must an arbitrarily old image (`docs/update.md`).

use super::flash_map::{HEADER, MAX_IMAGE, OTHER, PREVIOUS, SECTOR, STATE};
use super::partition::{STATE_WORD, is_on_trial};
use crate::checksum::CRC;
use crate::protocol::update::{CHUNK, Header, Refusal};
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind};

/// Beginning of the previous image.
const IMAGE: u32 = OTHER.start + SECTOR;
/// Length of the note, bytes: the header of the image that replaced the previous one, and the checksum of the previous one.
const NOTE: usize = Header::BYTES + 4;
/// Every byte of the word that makes the bootloader continue a swap. `embassy-boot` does not export it; tests
/// check that it recognises this word.
const SWAP: u8 = 0xf0;

/// Computes the note about the previous image in the chip, which the image with the header `running` replaced.
async fn note<F: NorFlash>(flash: &mut F, running: &Header) -> Result<[u8; NOTE], NorFlashErrorKind> {
    let mut note = [0; NOTE];
    note[..Header::BYTES].copy_from_slice(&running.bytes());
    let (mut digest, mut page) = (CRC.digest(), [0; CHUNK]);
    for address in (IMAGE..IMAGE + MAX_IMAGE).step_by(CHUNK) {
        flash.read(address, &mut page).await.map_err(|error| error.kind())?;
        digest.update(&page);
        yield_now().await;
    }
    note[Header::BYTES..].copy_from_slice(&digest.finalize().to_le_bytes());
    Ok(note)
}

/// Reads the stored note; all bytes are 0xff without one.
async fn stored<F: NorFlash>(flash: &mut F) -> Result<[u8; NOTE], NorFlashErrorKind> {
    let mut note = [0; NOTE];
    flash.read(PREVIOUS.start, &mut note).await.map_err(|error| error.kind())?;
    Ok(note)
}

/// Stores the note about the previous image. To be called while the running image is on trial.
pub(super) async fn remember<F: NorFlash>(flash: &mut F, running: &Header) -> Result<(), NorFlashErrorKind> {
    let note = note(flash, running).await?;
    forget(flash).await?;
    flash.write(PREVIOUS.start, &note).await.map_err(|error| error.kind())
}

/// Erases the note, so that the previous image is not swapped back any more.
///
/// # Errors
/// If the chip fails.
pub async fn forget<F: NorFlash>(flash: &mut F) -> Result<(), NorFlashErrorKind> {
    if stored(flash).await? != [0xff; NOTE] {
        flash.erase(PREVIOUS.start, PREVIOUS.end).await.map_err(|error| error.kind())?;
    }
    Ok(())
}

/// Marks the previous image for the bootloader, which swaps it back at the next start. Returns false, and changes nothing, if the
/// running image is on trial, or the chip does not contain the image that `running` replaced.
///
/// # Errors
/// [`Refusal::Chip`] if the chip fails.
pub async fn swap_back<F: NorFlash>(flash: &mut F, running: &Header) -> Result<bool, Refusal> {
    let mut header = [0; Header::BYTES];
    flash.read(IMAGE + HEADER, &mut header).await.map_err(|error| error.kind())?;
    let is_of_board = Header::read(&header).is_some_and(|header| header.board == running.board);
    if !is_of_board || is_on_trial(flash).await? || stored(flash).await? != note(flash, running).await? {
        return Ok(false);
    }
    // The bootloader finds a swap of which all sectors are complete and that nobody has confirmed, so it swaps back. The first
    // word of [`STATE`] is the operation, and the second one remains erased, which means that the progress is valid. Two words
    // for each sector follow.
    let progress = STATE.start + 2 * STATE_WORD as u32;
    let end = progress + 2 * (MAX_IMAGE / SECTOR) * STATE_WORD as u32;
    flash.erase(STATE.start, STATE.end).await.map_err(|error| error.kind())?;
    for address in (progress..end).step_by(STATE_WORD) {
        flash.write(address, &[0; STATE_WORD]).await.map_err(|error| error.kind())?;
    }
    // This word is written last: after a loss of power before it, the running image remains.
    flash.write(STATE.start, &[SWAP; STATE_WORD]).await.map_err(|error| error.kind())?;
    Ok(true)
}

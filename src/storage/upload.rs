//! Receives an image as a file in the format of MCUboot ([`crate::protocol::mcuboot`]), part by part. The transfer has the same
//! state and the same checks as one with [`Update::handle`].

use super::flash_map::OTHER;
use super::partition::is_on_trial;
use super::update::{File, Update};
use crate::protocol::mcuboot::{FRONT, TRAILER, front, read_front, read_trailer};
use crate::protocol::update::{CHUNK, Header, Offer, Refusal};
use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::{NorFlash, NorFlashError};
use mcumgr::{Sha256, Upload};
use sha2::Digest;

/// An image that was received as a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// The header of the image.
    pub header: Header,
    /// The SHA-256 that names the image: that of its file without the trailer.
    pub sha256: Sha256,
    /// The image is marked for the bootloader, which swaps it in at the next start.
    pub is_pending: bool,
}

impl Update {
    /// Receives a part of a file; `running` is the header of the running image. Returns the offset of the part that is expected
    /// next; after the last part, this is the length of the file. Bytes before the expected offset are skipped, and a part that
    /// begins after it is ignored, so a lost, repeated or overlapping part does no harm; but without a checksum of the file, its
    /// first part always begins a new transfer. The bytes before the image ([`FRONT`]) and those after it ([`TRAILER`]) must each
    /// be whole in one part, because they are not stored.
    ///
    /// # Errors
    /// The [`Refusal`] to send to the host.
    pub async fn upload<F: NorFlash>(
        &mut self,
        flash: &mut F,
        running: &Header,
        part: &Upload,
    ) -> Result<u32, Refusal> {
        if part.offset == 0 {
            self.begin_file(flash, running, part).await?;
        }
        let offer = self.offer.ok_or(Refusal::NotBegun)?;
        let image_bytes = u32::from(offer.chunks) * CHUNK as u32;
        let expected = FRONT as u32 + self.received;
        let skipped = expected.checked_sub(part.offset).map(|skipped| skipped as usize);
        let new_bytes = skipped.and_then(|skipped| part.data.get(skipped..)).unwrap_or_default();
        if self.file.is_some() {
            return Ok(expected + TRAILER as u32);
        }
        if self.received < image_bytes {
            let mut unwritten = &new_bytes[..new_bytes.len().min((image_bytes - self.received) as usize)];
            while !unwritten.is_empty() {
                // Number of bytes to the end of this page of the chip.
                let room = CHUNK - self.received as usize % CHUNK;
                let (page, rest) = unwritten.split_at(unwritten.len().min(room));
                self.write(flash, page).await?;
                unwritten = rest;
            }
            return Ok(FRONT as u32 + self.received);
        }
        if new_bytes.is_empty() {
            return Ok(expected);
        }
        let (name, signature, _) = read_trailer(new_bytes).ok_or(Refusal::Incomplete)?;
        if *name != sha256(&offer.header, image_bytes, Place::Chip(flash)).await? {
            *self = Self::new();
            return Err(Refusal::Signature);
        }
        let (signature, _) = signature.as_chunks();
        // The signature takes the place of the checksum.
        self.file = Some(File { name: *name, checksum: offer.signature[0] });
        self.offer = Some(Offer { signature: [signature[0], signature[1]], ..offer });
        Ok(expected + TRAILER as u32)
    }

    /// Begins the transfer of a file, or continues that of the same file, which may be complete.
    async fn begin_file<F: NorFlash>(&mut self, flash: &mut F, running: &Header, part: &Upload) -> Result<(), Refusal> {
        let (header, image_bytes) = read_front(&part.data).ok_or(Refusal::Header)?;
        let chunks = u16::try_from(image_bytes / CHUNK as u32).map_err(|_| Refusal::Length)?;
        if part.file_bytes != Some((FRONT + TRAILER) as u32 + image_bytes) {
            return Err(Refusal::Length);
        }
        // `Update::begin` always refuses an older version. If the image must be newer, the same version is refused as well.
        if part.must_be_newer && header.number() == running.number() {
            return Err(Refusal::Older);
        }
        let is_same = |file: &File| part.sha256 == Some(file.checksum) && !self.is_pending;
        if self.file.as_ref().is_some_and(is_same) {
            return Ok(());
        }
        // The signature is at the end of the file. Until it arrives, the checksum of the file takes its place, so that another
        // transfer of the same file is recognised.
        let placeholder = [part.sha256.unwrap_or_default(); 2];
        self.begin(flash, running, &Offer { header, chunks, signature: placeholder }).await?;
        if part.sha256.is_none() {
            // Without a checksum this may be another file, so the transfer starts from the beginning.
            self.received = 0;
        }
        Ok(())
    }

    /// Verifies the signature of the image that was received as a file, and marks the image for the bootloader.
    ///
    /// # Errors
    /// The [`Refusal`] to send to the host. The received image is then discarded, unless it is incomplete or the chip
    /// has failed.
    pub async fn mark<F: NorFlash>(&mut self, flash: &mut F, key: &[u8; 32]) -> Result<(), Refusal> {
        if self.is_pending {
            return Ok(());
        }
        let (offer, received, file) = (self.offer, self.received, self.file);
        self.finish(flash, key).await?;
        *self = Self { offer, received, file, is_pending: true };
        Ok(())
    }

    /// Discards the image that is being received or was received.
    ///
    /// # Errors
    /// [`Refusal::OnTrial`] if the received image is marked for the bootloader, or if the running image is on trial, because
    /// the chip then contains the previous image; [`Refusal::Chip`] if the chip fails.
    pub async fn discard<F: NorFlash>(&mut self, flash: &mut F) -> Result<(), Refusal> {
        if is_on_trial(flash).await? {
            return Err(Refusal::OnTrial);
        }
        *self = Self::new();
        Ok(())
    }

    /// The image that was received as a file; `None` before its last part was received.
    pub fn received(&self) -> Option<Received> {
        let (offer, file) = (self.offer?, self.file?);
        Some(Received { header: offer.header, sha256: file.name, is_pending: self.is_pending })
    }
}

/// The place from which an image is read.
enum Place<'a, F> {
    /// The image that is being received, in the flash chip.
    Chip(&'a mut F),
    /// The running image, in the controller's own flash.
    Memory(&'a [u8]),
}

/// The SHA-256 that names an image with this header and length. Other tasks can run after each chunk.
async fn sha256<F: NorFlash>(header: &Header, image_bytes: u32, mut place: Place<'_, F>) -> Result<Sha256, Refusal> {
    let mut digest = sha2::Sha256::new_with_prefix(front(header, image_bytes));
    for offset in (0..image_bytes).step_by(CHUNK) {
        let mut chunk = [0xff; CHUNK];
        match &mut place {
            Place::Chip(flash) => {
                flash.read(OTHER.start + offset, &mut chunk).await.map_err(|error| error.kind())?;
            }
            Place::Memory(image) => {
                let from_offset = image.get(offset as usize..).unwrap_or_default();
                chunk.iter_mut().zip(from_offset).for_each(|(byte, image_byte)| *byte = *image_byte);
            }
        }
        digest.update(chunk);
        yield_now().await;
    }
    Ok(digest.finalize().into())
}

/// The SHA-256 that names the running image. As in the file of the image, `image` is padded with 0xff to whole chunks. The
/// first argument only states `F`, so that the function `sha256` is compiled for one type of chip only.
pub async fn sha256_of_running<F: NorFlash>(_: &F, header: &Header, image: &[u8]) -> Sha256 {
    let image_bytes = image.len().next_multiple_of(CHUNK) as u32;
    // Reading memory does not fail.
    sha256(header, image_bytes, Place::<F>::Memory(image)).await.unwrap_or_default()
}

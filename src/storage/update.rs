//! Receives a firmware image, verifies its signature, and marks it for the bootloader to swap with the running image.
//!
//! The bootloader, `embassy-boot`, swaps the images at the next start, and swaps them back at the start after that, unless the
//! new image has confirmed itself. `docs/update.md` has the whole procedure.

use super::flash_map::{HEADER, MAX_IMAGE, OTHER, SECTOR};
pub use super::partition::is_on_trial;
use super::partition::{Partition, STATE_WORD, state_partition};
use super::previous;
use crate::protocol::update::{CHUNK, Chunk, Header, Offer, Progress, Refusal, Request};
use embassy_boot::{FirmwareState, FirmwareUpdater, FirmwareUpdaterConfig, FirmwareUpdaterError};
use embassy_futures::yield_now;
use embassy_sync::mutex::Mutex;
use embedded_storage_async::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind};
use mcumgr::Sha256;
use salty::{PublicKey, Sha512};

/// The public development key, in hex. Its private key is published (`docs/security.md`).
pub const DEVELOPMENT_KEY: &str = "68335e1b188bb8cd9c390c584b54e2ad61f1604f71091415177d09ab23c3970c";

/// The public key with which the signatures of images are checked: the build reads it from `PLANTAR_UPDATE_KEY`, in hex. The
/// default is that of the development key.
pub const KEY: [u8; 32] = from_hex(match option_env!("PLANTAR_UPDATE_KEY") {
    Some(key) => key,
    None => DEVELOPMENT_KEY,
});

/// Identifies a key by its first four bytes.
pub const fn key_id(key: &[u8; 32]) -> u32 {
    u32::from_be_bytes([key[0], key[1], key[2], key[3]])
}

/// The identifier of the development key.
pub const DEVELOPMENT_KEY_ID: u32 = key_id(&from_hex(DEVELOPMENT_KEY));

const fn from_hex(text: &str) -> [u8; 32] {
    const fn digit(digit: u8) -> u8 {
        match (digit as char).to_digit(16) {
            Some(value) => value as u8,
            None => panic!("PLANTAR_UPDATE_KEY holds a character that is not a hex digit"),
        }
    }
    let (digits, mut bytes, mut i) = (text.as_bytes(), [0; 32], 0);
    assert!(digits.len() == 64, "PLANTAR_UPDATE_KEY must have 64 hex digits");
    while i < bytes.len() {
        bytes[i] = digit(digits[2 * i]) << 4 | digit(digits[2 * i + 1]);
        i += 1;
    }
    bytes
}

/// A file that was received completely ([`Update::upload`]).
#[derive(Clone, Copy, Debug)]
pub(super) struct File {
    /// The SHA-256 that names the image.
    pub name: Sha256,
    /// The SHA-256 of the whole file, with its trailer, as its first part has stated it; zeros if this part stated none.
    pub checksum: Sha256,
}

/// The state of a transfer.
#[derive(Debug, Default)]
pub struct Update {
    /// The image that is being received. The signature of a file ([`Update::upload`]) is known at its end; until then, the
    /// checksum of the file takes its place.
    pub(super) offer: Option<Offer>,
    /// Number of bytes of the image that were received.
    pub(super) received: u32,
    /// The file of the image, once all of it was received.
    pub(super) file: Option<File>,
    /// The image was received as a file and is marked for the bootloader.
    pub(super) is_pending: bool,
}

impl Update {
    /// The state before the first transfer.
    pub const fn new() -> Self {
        Self { offer: None, received: 0, file: None, is_pending: false }
    }

    /// Executes a request. `running` is the header of the running image, `key` the public key for verifying the signature.
    ///
    /// # Errors
    /// The [`Refusal`] to send to the host.
    pub async fn handle<F: NorFlash>(
        &mut self,
        flash: &mut F,
        running: &Header,
        key: &[u8; 32],
        request: &Request,
    ) -> Result<Progress, Refusal> {
        match request {
            Request::Begin(offer) => self.begin(flash, running, offer).await,
            Request::Chunk { number, chunk } => self.chunk(flash, *number, chunk).await,
            Request::Finish => self.finish(flash, key).await,
            // The trial is observed, and ended, by the caller.
            Request::Confirm if is_on_trial(flash).await? => Err(Refusal::OnTrial),
            Request::Confirm => Ok(Progress::Confirmed),
        }
    }

    pub(super) async fn begin<F: NorFlash>(
        &mut self,
        flash: &mut F,
        running: &Header,
        offer: &Offer,
    ) -> Result<Progress, Refusal> {
        if offer.header.board != running.board {
            return Err(Refusal::Board);
        }
        if offer.header.number() < running.number() {
            return Err(Refusal::Older);
        }
        // The signature must cover the header.
        let least = HEADER + Header::BYTES as u32;
        if !(least..=MAX_IMAGE).contains(&(u32::from(offer.chunks) * CHUNK as u32)) {
            return Err(Refusal::Length);
        }
        // During a trial, the previous image is at the address to which the new image would be written.
        if is_on_trial(flash).await? {
            return Err(Refusal::OnTrial);
        }
        if self.offer.as_ref() != Some(offer) {
            *self = Self { offer: Some(*offer), ..Self::new() };
        }
        Ok(self.next())
    }

    /// The chunk that is expected next.
    fn next(&self) -> Progress {
        Progress::Next((self.received / CHUNK as u32) as u16)
    }

    async fn chunk<F: NorFlash>(&mut self, flash: &mut F, number: u16, chunk: &Chunk) -> Result<Progress, Refusal> {
        let offer = self.offer.as_ref().ok_or(Refusal::NotBegun)?;
        // A chunk with any other number is ignored: it is stored already, or an earlier chunk was lost.
        if u32::from(number) * CHUNK as u32 == self.received && number < offer.chunks {
            self.write(flash, chunk.as_flattened()).await?;
        }
        Ok(self.next())
    }

    /// Writes the next bytes of the image, which must not extend beyond the present page ([`CHUNK`] bytes) of the chip.
    pub(super) async fn write<F: NorFlash>(&mut self, flash: &mut F, bytes: &[u8]) -> Result<(), Refusal> {
        let address = OTHER.start + self.received;
        if self.received == 0 {
            previous::forget(flash).await?;
        }
        if address.is_multiple_of(SECTOR) {
            flash.erase(address, address + SECTOR).await.map_err(|error| error.kind())?;
        }
        flash.write(address, bytes).await.map_err(|error| error.kind())?;
        self.received += bytes.len() as u32;
        Ok(())
    }

    pub(super) async fn finish<F: NorFlash>(&mut self, flash: &mut F, key: &[u8; 32]) -> Result<Progress, Refusal> {
        let offer = self.offer.ok_or(Refusal::NotBegun)?;
        if self.received < u32::from(offer.chunks) * CHUNK as u32 {
            return Err(Refusal::Incomplete);
        }
        let accepted = accept(flash, key, &offer).await;
        // A failure of the chip, as with a low supply, may be temporary: the complete image remains, and the host can request the
        // end again. More chunks could not correct any other error.
        if accepted != Err(Refusal::Chip) {
            *self = Self::new();
        }
        accepted
    }
}

/// Verifies the received image, and marks it for the bootloader.
async fn accept<F: NorFlash>(flash: &mut F, key: &[u8; 32], offer: &Offer) -> Result<Progress, Refusal> {
    let mut header = [0; Header::BYTES];
    flash.read(OTHER.start + HEADER, &mut header).await.map_err(|error| error.kind())?;
    if Header::read(&header) != Some(offer.header) {
        return Err(Refusal::Header);
    }
    let signature = *offer.signature.as_flattened().as_array().ok_or(Refusal::Signature)?;
    let len = u32::from(offer.chunks) * CHUNK as u32;
    // A disturbance of the supply can make the core skip instructions. The signature is verified here and again by
    // `embassy-boot`, so that skipping a branch of one check does not accept an image.
    if !is_signed(flash, len, key, &signature).await? {
        return Err(Refusal::Signature);
    }
    let chip = Mutex::new(flash);
    let mut word = [0; STATE_WORD];
    let config = FirmwareUpdaterConfig { dfu: Partition::<_, CHUNK>::new(&chip, OTHER), state: state_partition(&chip) };
    FirmwareUpdater::new(config, &mut word).verify_and_mark_updated(key, &signature, len).await?;
    Ok(Progress::Accepted)
}

/// True if this is the signature of the first `len` bytes of the received image, a multiple of [`CHUNK`], by the private key that
/// belongs to `key`.
async fn is_signed<F: NorFlash>(
    flash: &mut F,
    len: u32,
    key: &[u8; 32],
    signature: &[u8; 64],
) -> Result<bool, NorFlashErrorKind> {
    let (mut digest, mut page) = (Sha512::new(), [0; CHUNK]);
    for address in (OTHER.start..OTHER.start + len).step_by(CHUNK) {
        flash.read(address, &mut page).await.map_err(|error| error.kind())?;
        digest.update(&page);
        yield_now().await;
    }
    let is_valid = |key: PublicKey| key.verify(&digest.finalize(), &signature.into()).is_ok();
    Ok(PublicKey::try_from(key).is_ok_and(is_valid))
}

/// Confirms the running image, of which `running` is the header.
///
/// # Errors
/// [`Refusal::Chip`] if the chip fails.
pub async fn confirm<F: NorFlash>(flash: &mut F, running: &Header) -> Result<(), Refusal> {
    previous::remember(flash, running).await?;
    let (chip, mut word) = (Mutex::new(flash), [0; STATE_WORD]);
    Ok(FirmwareState::new(state_partition(&chip), &mut word).mark_booted().await?)
}

impl From<NorFlashErrorKind> for Refusal {
    fn from(_: NorFlashErrorKind) -> Self {
        Self::Chip
    }
}

impl From<FirmwareUpdaterError> for Refusal {
    fn from(error: FirmwareUpdaterError) -> Self {
        match error {
            FirmwareUpdaterError::Flash(_) => Self::Chip,
            FirmwareUpdaterError::Signature(_) => Self::Signature,
            FirmwareUpdaterError::BadState => Self::OnTrial,
        }
    }
}

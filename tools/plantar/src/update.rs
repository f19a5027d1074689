//! `plantar update`: sends a signed image to an insole, and waits until the insole runs the image and has confirmed it.

use crate::carrier::{Connection, InsoleLink};
use anyhow::{Context, Result, anyhow, bail};
use clap::Args;
use client::{Error, ReconnectPolicy};
use firmware_image::Image;
use indicatif::{ProgressBar, ProgressStyle};
use plantar::protocol;
use plantar::protocol::Hello;
use plantar::protocol::update::{CHUNK, Header, Progress, Refusal, Request};
use plantar::storage::update::DEVELOPMENT_KEY_ID;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Longest time that an insole needs to check a new image that works.
const TRIAL_TIMEOUT: Duration = Duration::from_secs(30);

/// Sends signed firmware to an insole, and waits until the insole runs the firmware and has confirmed it.
///
/// The insole continues to measure during the transfer and restarts after it. It refuses an image that is not signed with the
/// accepted key, is older than the running firmware, is for another board or is cut short. If the new firmware does not work,
/// the insole restores the previous firmware.
#[derive(Args)]
pub struct Update {
    /// The signed image: plantar-BOARD-VERSION.bin of a release, or a file from `cargo xtask image`.
    file: PathBuf,
    #[command(flatten)]
    connection: Connection,
}

impl Update {
    pub fn run(&self) -> Result<()> {
        let image = Image::read(&self.file)?;
        let mut insole = self.connection.open(ReconnectPolicy::RESTART)?;
        let hello = insole.client().hello();
        let before = hello.firmware.clone();
        self.check_board_and_version(&image, hello)?;
        if insole.client().status()?.update_key == DEVELOPMENT_KEY_ID {
            eprintln!(
                "warning: anyone can sign an update for this insole, because it accepts the public development key: flash firmware \
                 that was built with PLANTAR_UPDATE_KEY before others use the insole"
            );
        }
        println!(
            "the insole runs {before}; {} is {}, {} KiB",
            self.file.display(),
            image.header().version(),
            image.bytes().len() / 1024
        );
        let is_answered = send(&image, &mut insole)?;
        match is_answered {
            true => println!("the signature is valid: the insole restarts"),
            false => println!("the image is sent, but the insole did not answer: waiting until the new version runs"),
        }
        self.wait_for_restart(&image, &mut insole, &before, is_answered)?;
        wait_for_trial(&image, &mut insole)?;
        println!("the insole now runs {} (before: {before}), and has confirmed it", image.header().version());
        if before == image.header().version() {
            eprintln!(
                "note: the previous image has the same version, so it is not known which of the two runs: if the new image did \
                 not work, the insole has swapped back"
            );
        }
        Ok(())
    }

    /// Returns an error for an image that the insole would refuse because of its board or version, before anything is sent.
    fn check_board_and_version(&self, image: &Image, hello: &Hello) -> Result<()> {
        let header = image.header();
        let file = self.file.display();
        if header.board() != hello.board {
            bail!(
                "{file} is for the board {}, but this insole has the board {}: choose the image for that board",
                header.board(),
                hello.board
            );
        }
        if header.number() < Header::new("", &hello.firmware).number() {
            bail!(
                "{file} has version {}, but the insole runs {}, which is newer: choose a newer image",
                header.version(),
                hello.firmware
            );
        }
        Ok(())
    }

    /// Waits until the insole has restarted with the new image; `before` is the version that ran before. If the insole did not
    /// answer the request to install the image, only another version shows that it has installed it.
    fn wait_for_restart(&self, image: &Image, insole: &mut InsoleLink, before: &str, is_answered: bool) -> Result<()> {
        let version = image.header().version();
        let outcome = |hello: &Hello, was_silent: bool| {
            // Without an answer, the link may have failed before the insole received the request, so silence is no evidence of a
            // restart.
            let has_restarted = was_silent && is_answered;
            match hello.firmware == version {
                // If old and new version are equal, the version does not show that the insole restarted; its silence does.
                true => (has_restarted || before != version).then_some(Ok(())),
                false => has_restarted.then(|| {
                    Err(anyhow!(
                        "the new image did not work, so the insole swapped back to {}: report this to the supplier of {}",
                        hello.firmware,
                        self.file.display()
                    ))
                }),
            }
        };
        insole.wait_for_restart(outcome).context(
            "it is not known whether the new image runs: switch the insole off and on; `plantar insole show` then prints the \
             version that runs",
        )?
    }
}

/// Asks the insole repeatedly to confirm the new image, until it does. Returns an error if it is still checking the image after
/// [`TRIAL_TIMEOUT`].
fn wait_for_trial(image: &Image, insole: &mut InsoleLink) -> Result<()> {
    let start = Instant::now();
    loop {
        match insole.client().update(Request::Confirm) {
            Ok(_) => return Ok(()),
            Err(Error::Refused(protocol::Refusal::Update(Refusal::OnTrial))) if start.elapsed() < TRIAL_TIMEOUT => {
                std::thread::sleep(ReconnectPolicy::RESTART.retry);
            }
            Err(Error::Refused(protocol::Refusal::Update(Refusal::OnTrial))) => bail!(
                "{} runs, but is not confirmed. Either it did not pass all checks (measuring, storing, answering by radio): \
                 unless it passes them later, the insole restores the previous version within 15 minutes. Or the insole could \
                 not store the confirmation, for example with an empty battery: charge it, and the insole repeats the attempt \
                 each minute. If it is switched off before, it restores the previous version at once",
                image.header().version()
            ),
            Err(error @ Error::Refused(_)) => return Err(error.into()),
            Err(error) => {
                return Err(error).context(
                    "the new image stopped answering before it was confirmed, so the insole may have restored the previous one: \
                     `plantar insole show` prints the version that runs",
                );
            }
        }
    }
}

/// Sends an image in chunks, and a request to check and install it. Returns false if this request was not answered: the insole
/// may have installed the image and restarted.
fn send(image: &Image, insole: &mut InsoleLink) -> Result<bool> {
    let offer = image.offer();
    let bar = ProgressBar::new(image.bytes().len() as u64);
    // The template is a valid constant, so the default is never used.
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {bytes}/{total_bytes}, {eta} left")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let client = insole.client();
    let mut progress = client.update(Request::Begin(offer))?;
    while let Progress::Next(number) = progress {
        bar.set_position(u64::from(number) * CHUNK as u64);
        let request =
            if number < offer.chunks { Request::Chunk { number, chunk: image.chunk(number) } } else { Request::Finish };
        progress = match client.update(request) {
            Err(Error::LostAnswer(..) | Error::Carrier(_)) if request == Request::Finish => {
                bar.finish_and_clear();
                return Ok(false);
            }
            progress => progress?,
        };
    }
    bar.finish_and_clear();
    Ok(true)
}

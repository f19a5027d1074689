//! `plantar update`: a signed image to an insole, until it runs there and stays.

use crate::carrier::{Carrier, Session};
use anyhow::{Result, bail};
use clap::Args;
use client::Error;
use firmware_image::Image;
use indicatif::{ProgressBar, ProgressStyle};
use plantar::protocol;
use plantar::protocol::update::{CHUNK, Header, Progress, Refusal, Request};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The bootloader of a real board needs some fifteen seconds.
const RESTART: Duration = Duration::from_secs(60);
/// A new image proves itself within this time, or not at all.
const TRIAL: Duration = Duration::from_secs(30);
/// Between two looks.
const PAUSE: Duration = Duration::from_millis(500);

/// Sends signed firmware to an insole, and waits until it runs there and stays.
///
/// The insole goes on measuring meanwhile, and restarts at the end. An image that is not signed with the key that the insole
/// takes, that is older than what runs, for another board or cut short is refused; one that does not work is swapped back.
#[derive(Args)]
pub struct Update {
    /// The image, from `cargo xtask image`.
    file: PathBuf,
    #[command(flatten)]
    carrier: Carrier,
}

impl Update {
    pub fn run(&self) -> Result<()> {
        let image = Image::read(&self.file)?;
        let mut session = self.carrier.connect()?;
        let before = session.hello().firmware.clone();
        self.check(&image, &session)?;
        println!(
            "the insole runs {before}; {} is {}, {} KiB",
            self.file.display(),
            image.header().version(),
            image.bytes().len() / 1024
        );
        send(&image, &mut session)?;
        println!("the signature is right: the insole restarts");
        self.wait(&image, &mut session, &before)?;
        self.wait_for_trial(&image, &mut session)?;
        println!("the insole runs {}, {before} before, and stays with it", image.header().version());
        Ok(())
    }

    /// Refuses early what the insole would refuse.
    fn check(&self, image: &Image, session: &Session) -> Result<()> {
        let (header, hello) = (image.header(), session.hello());
        let file = self.file.display();
        if header.board() != hello.board {
            bail!(
                "{file} is for the board {}, and this insole is a {}: choose the image made for it",
                header.board(),
                hello.board
            );
        }
        if header.number() < Header::new("", &hello.firmware).number() {
            bail!(
                "{file} is {}, and the insole runs {}, which is newer: choose a newer one",
                header.version(),
                hello.firmware
            );
        }
        Ok(())
    }

    /// Waits until the new image answers.
    fn wait(&self, image: &Image, session: &mut Session, before: &str) -> Result<()> {
        let start = Instant::now();
        let mut was_silent = false;
        while start.elapsed() < RESTART {
            let answered = session.reconnect(2 * PAUSE).is_ok() || {
                was_silent = true;
                self.carrier.reconnect(session).is_ok()
            };
            let runs_new = session.hello().firmware == image.header().version();
            match answered {
                true if runs_new && (was_silent || before != image.header().version()) => return Ok(()),
                true if was_silent && !runs_new => bail!(
                    "the new image did not start, and the insole swapped back: it runs {}; ask the maker of {}",
                    session.hello().firmware,
                    self.file.display()
                ),
                // It has not restarted yet, or not heard.
                _ => std::thread::sleep(PAUSE),
            }
        }
        bail!("the insole does not answer since its restart: switch it off and on, and look with `plantar monitor`")
    }

    /// Waits until the new image stays. While it is on trial no other is taken.
    fn wait_for_trial(&self, image: &Image, session: &mut Session) -> Result<()> {
        let start = Instant::now();
        loop {
            match session.update(Request::Begin(image.offer())) {
                Ok(_) => return Ok(()),
                Err(Error::Refused(protocol::Refusal::Update(Refusal::OnTrial))) if start.elapsed() < TRIAL => {
                    std::thread::sleep(PAUSE);
                }
                Err(Error::Refused(protocol::Refusal::Update(Refusal::OnTrial))) => bail!(
                    "{} runs and does not measure: the insole goes back to the version before when it is switched off and on",
                    image.header().version()
                ),
                Err(error) => return Err(error.into()),
            }
        }
    }
}

fn send(image: &Image, session: &mut Session) -> Result<()> {
    let offer = image.offer();
    let bar = ProgressBar::new(image.bytes().len() as u64);
    // A template of this program, so it is a good one.
    bar.set_style(
        ProgressStyle::with_template("{bar:40} {bytes}/{total_bytes}, {eta} left")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let mut progress = session.update(Request::Begin(offer))?;
    while let Progress::Next(number) = progress {
        bar.set_position(u64::from(number) * CHUNK as u64);
        let request =
            if number < offer.chunks { Request::Chunk { number, chunk: image.chunk(number) } } else { Request::Finish };
        progress = session.update(request)?;
    }
    bar.finish_and_clear();
    Ok(())
}

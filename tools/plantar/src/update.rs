//! `plantar update`: sends a signed image to an insole, and waits until it runs there and is confirmed.

use crate::carrier::{Connection, Insole};
use anyhow::{Result, anyhow, bail};
use clap::Args;
use client::{Error, ReconnectPolicy};
use firmware_image::Image;
use indicatif::{ProgressBar, ProgressStyle};
use plantar::protocol;
use plantar::protocol::Hello;
use plantar::protocol::update::{CHUNK, Header, Progress, Refusal, Request};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The trial of a new image ends within this time.
const TRIAL: Duration = Duration::from_secs(30);

/// Sends signed firmware to an insole, and waits until it runs there and is confirmed.
///
/// The insole continues to measure meanwhile, and restarts at the end. An image is refused if it is not signed with the key that
/// the insole accepts, older than the firmware that runs, for another board, or cut short; one that does not work is rolled back.
#[derive(Args)]
pub struct Update {
    /// The image, from `cargo xtask image`.
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
        self.check(&image, hello)?;
        println!(
            "the insole runs {before}; {} is {}, {} KiB",
            self.file.display(),
            image.header().version(),
            image.bytes().len() / 1024
        );
        send(&image, &mut insole)?;
        println!("the signature is valid: the insole restarts");
        self.wait_for_restart(&image, &mut insole, &before)?;
        wait_for_trial(&image, &mut insole)?;
        println!("the insole runs {}, {before} before; the new image is confirmed", image.header().version());
        Ok(())
    }

    /// Refuses early an image that the insole would refuse.
    fn check(&self, image: &Image, hello: &Hello) -> Result<()> {
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

    fn wait_for_restart(&self, image: &Image, insole: &mut Insole, before: &str) -> Result<()> {
        let version = image.header().version();
        let check = |hello: &Hello, was_silent: bool| match hello.firmware == version {
            // With equal versions, an answer proves nothing unless the insole was silent, and so restarted, before it.
            true => (was_silent || before != version).then_some(Ok(())),
            false => was_silent.then(|| {
                Err(anyhow!(
                    "the new image did not start, so the insole swapped back to {}: report this to the supplier of {}",
                    hello.firmware,
                    self.file.display()
                ))
            }),
        };
        insole.wait_for_restart(check).unwrap_or_else(|_| {
            bail!("the insole has not answered since its restart: switch it off and on, then run `plantar monitor`")
        })
    }
}

/// Waits until the new image is confirmed: while it is on trial, the insole accepts no other one.
fn wait_for_trial(image: &Image, insole: &mut Insole) -> Result<()> {
    let start = Instant::now();
    loop {
        match insole.client().update(Request::Begin(image.offer())) {
            Ok(_) => return Ok(()),
            Err(Error::Refused(protocol::Refusal::Update(Refusal::OnTrial))) if start.elapsed() < TRIAL => {
                std::thread::sleep(ReconnectPolicy::RESTART.retry);
            }
            Err(Error::Refused(protocol::Refusal::Update(Refusal::OnTrial))) => bail!(
                "{} runs but does not measure: switch the insole off and on, which restores the previous version",
                image.header().version()
            ),
            Err(error) => return Err(error.into()),
        }
    }
}

fn send(image: &Image, insole: &mut Insole) -> Result<()> {
    let offer = image.offer();
    let bar = ProgressBar::new(image.bytes().len() as u64);
    // The template is a constant, and valid.
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
        progress = client.update(request)?;
    }
    bar.finish_and_clear();
    Ok(())
}

//! Measures the identification through the insole: walkers are identified from their recordings, and from the messages that the
//! emulated insole sends when their recordings are played into its matrix.

use anyhow::{Context, Result, ensure};
use bench::{Figures, raise};
use client::{Client, Framed, StartedCells};
use emulation::EmulatorConfig;
use emulator::{Board, Recorded, Time};
use fit::live::LiveSteps;
use fit::{Options, Study};
use parameters::InsoleSize;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{CellStream, Resolution, ToDevice, ToHost};
use recording::{Recording, StreamedCells, VirtualInsole, jiku};
use std::path::Path;
use std::time::{Duration, Instant};

/// Number of walkers.
const WALKERS: usize = 3;
/// Number of trials of each walker. In this data set, each trial is one step.
const TRIALS: usize = 30;
/// The device's usual number of cells.
const CELLS: usize = 240;
/// The device's usual number of frames per second.
const RATE_HZ: f64 = 100.0;
const CONTACT: ContactRule = ContactRule::COVERED;
/// Time within which the insole must answer, and after which a silent insole has sent everything.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(20);

/// The data that an insole sent during a walk.
struct Sent {
    cells: Recording,
    live: LiveSteps,
    /// Number of frames of cells that were lost or dropped.
    lost: u32,
}

/// Measures the predicted error of the parameters from the cells and from the live stream, relative to that of the parameters
/// from the recording, and the number of lost frames of cells.
pub fn measure(firmware: &Path, data: &Path, figures: &mut Figures) -> Result<()> {
    let (mut worst, mut lost, mut frames) = ([0.0f64; 2], 0, 0);
    for walker in 0..WALKERS {
        let walk = jiku::import(data, walker, 0..TRIALS, &mut |_, _| ())?.at_rate(RATE_HZ)?.binned(CELLS)?;
        let sent = play(firmware, &walk)?;
        let from_file = predicted(|study| add(study, &walk))?;
        let from_cells = predicted(|study| add(study, &sent.cells))?;
        let from_live = predicted(|study| {
            let side = walk.side;
            Ok(study.add_live("live stream".into(), String::new(), side, &sent.live)?)
        })?;
        raise(&mut worst[0], from_cells / from_file);
        raise(&mut worst[1], from_live / from_file);
        lost += sent.lost;
        frames += sent.cells.frames();
    }
    for (name, ratio) in ["cells", "live"].into_iter().zip(worst) {
        figures.add(
            &format!("loop_nrmse_over_file.{name}"),
            (ratio * 1000.0).round() / 1000.0,
            &format!(
                "at most 1.05: predicted error with parameters from the insole's messages, relative to that with \
                 parameters from the recording, worst of {WALKERS} walkers"
            ),
        );
    }
    figures.add("cells_lost", lost, &format!("0: frames of all cells that were lost or dropped, of {frames}"));
    Ok(())
}

/// Adds a recording to a study.
fn add(study: &mut Study, recording: &Recording) -> Result<()> {
    let insole = VirtualInsole::new(recording, CONTACT, StanceRule::ADAPTIVE);
    Ok(study.add("recording".into(), recording, &insole, &mut |_| ())?)
}

/// The predicted error: the NRMSE of each step with parameters fitted to the other steps, mean of the steps and regions.
fn predicted(add: impl FnOnce(&mut Study) -> Result<()>) -> Result<f64> {
    let mut study = Study::new("walker".into(), CONTACT, Options::usual(InsoleSize::default().thickness_m()));
    add(&mut study)?;
    study.fit(&|_| ());
    let errors: Vec<f64> = study.fits.iter().flatten().filter_map(|fit| fit.quality.predicted).collect();
    ensure!(!errors.is_empty(), "no region could be fitted");
    Ok(errors.iter().sum::<f64>() / errors.len() as f64)
}

/// Plays a walk into the emulated board, and receives live frames, steps and all cells.
fn play(firmware: &Path, walk: &Recording) -> Result<Sent> {
    let insole = VirtualInsole::new(walk, CONTACT, StanceRule::ADAPTIVE);
    let (config, scans) = (EmulatorConfig::new(insole.setup), insole.frames(walk) as u32);
    let played = Recorded::new(walk.clone(), insole.clone());
    let board = Board::start(firmware, &config, &insole.cells, Time::Fastest, played)?;
    let mut link = board.link()?;
    link.set_read_timeout(Some(client::READ_TIMEOUT))?;
    let mut client = Client::connect(Framed::new(link), ANSWER_TIMEOUT)?;
    let stream = CellStream { resolution: Resolution::Converter, every: 1 };
    let StartedCells { setup, cells, mut receiver } = client.start_cells(stream)?;
    client.stream()?;
    let (mut streamed, mut live) = (StreamedCells::new(setup, cells, stream.every), LiveSteps::new());
    board.play();
    let mut last_message = Instant::now();
    loop {
        let message = client.receive()?;
        if message.is_some() {
            last_message = Instant::now();
        }
        match message {
            Some(ToHost::Cells(frame)) if receiver.frame(&frame) && streamed.is_continued_by(frame.scan) => {
                streamed.push(frame.scan, receiver.codes());
                if frame.scan + 1 == scans {
                    client.send(ToDevice::GetStatus)?;
                }
            }
            Some(ToHost::Live(frame)) => live.frame(&frame),
            Some(ToHost::Step(step)) => {
                client.send(ToDevice::Acknowledge { number: step.step })?;
                live.step(&step);
            }
            Some(ToHost::Bout(bout)) => client.send(ToDevice::Acknowledge { number: bout.number })?,
            // Requested after the last scan. The insole sends it after all messages that were due before.
            Some(ToHost::Status(_)) => break,
            Some(_) => {}
            // The last scan was lost. A short silence has no meaning, because a busy computer can pause the emulator.
            None if last_message.elapsed() > ANSWER_TIMEOUT => break,
            None => {}
        }
    }
    live.finish();
    let cells = streamed.take("Recorded from the emulated insole").context("no cells arrived")?;
    // The receiver counts lost frames only if a later one arrives.
    let missing = scans.saturating_sub(cells.frames() as u32);
    Ok(Sent { cells, live, lost: missing.max(receiver.lost + receiver.dropped) })
}

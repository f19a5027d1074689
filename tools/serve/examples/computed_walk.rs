//! Writes the example recording of the page, a computed walk of both feet: `cargo run -p serve --example computed_walk -- FILE`.
//! A second argument sets the number of steps of each foot, which is otherwise six.

use parameters::{InsoleSize, Parameters};
use plantar::Side;
use plantar::insole::Insole;
use plantar::pipeline::contact::ContactRule;
use plantar::pipeline::setup::DEVICE_CELLS;
use plantar::pipeline::stance_rule::StanceRule;
use plantar::protocol::{Bout, ContactEllipse, Ellipses, Hello, Live, MAJOR, MINOR, Reset, SETUP_CELLS, Step, ToHost};
use recording::VirtualInsole;
use recording::synthetic::{SyntheticWalk, walk};
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write};

/// Number of steps of each foot, unless the second argument names another number.
const STEPS: usize = 6;
/// Duration of a stride, s; the right foot strikes half a stride after the left foot.
const STRIDE_S: f64 = 1.05;
/// Number of frames between two messages with the time of the insole, by which a host converts the times of both feet to one
/// clock.
const TIME_FRAMES: usize = 25;
/// Number of frames between two messages with ellipses: 20 Hz at 100 frames per second, which keeps the page small.
const ELLIPSE_FRAMES: usize = 5;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("no file to write: pass FILE [STEPS]")?;
    let steps = std::env::args().nth(2).map_or(Ok(STEPS), |steps| steps.parse())?;
    let left = messages(Side::Left, steps, 0.0, 760.0, 1)?;
    let right = messages(Side::Right, steps, STRIDE_S / 2.0, 800.0, 2)?;
    let mut both: Vec<_> = left.into_iter().map(|m| (m, 0)).chain(right.into_iter().map(|m| (m, 1))).collect();
    both.sort_by_key(|((t_ms, _), _)| *t_ms);
    let mut out = BufWriter::new(File::create(path)?);
    for ((t_ms, message), insole) in both {
        client::append(&mut out, t_ms, insole, &message)?;
    }
    Ok(out.flush()?)
}

/// The messages of an insole, each with its time in ms, during a walk that starts `lag_s` after time 0. `peak_n` is the peak
/// force on the foot, N, and `seed` determines the random variation of the steps.
fn messages(
    side: Side,
    steps: usize,
    lag_s: f64,
    peak_n: f64,
    seed: u64,
) -> Result<Vec<(u32, ToHost)>, Box<dyn Error>> {
    let recording = walk(&SyntheticWalk { side, steps, peak_n, seed, ..SyntheticWalk::default() }).recording;
    let virtual_insole = VirtualInsole::new(&recording, ContactRule::COUNTED, StanceRule::ADAPTIVE);
    let tissue = Parameters::typical(InsoleSize::default()).tissue();
    let mut insole = Box::new(Insole::<f32, DEVICE_CELLS>::new());
    insole.set_up(virtual_insole.setup, virtual_insole.cells.iter().copied())?;
    insole.set_tissue(&tissue)?;
    let hello = Hello {
        major: MAJOR,
        minor: MINOR,
        firmware: env!("CARGO_PKG_VERSION").try_into().unwrap_or_default(),
        board: "computed".try_into().unwrap_or_default(),
        side,
        layout_id: virtual_insole.setup.layout_id,
        cells: virtual_insole.cells.len() as u16,
        period_us: virtual_insole.setup.period_us,
        tissue_id: tissue.id,
        contact_rule: virtual_insole.setup.contact,
        reset: Reset::Power,
        fault: None,
    };
    let mut messages = vec![(0, ToHost::Hello(hello))];
    messages.extend(virtual_insole.cells.chunks(SETUP_CELLS).enumerate().map(|(i, cells)| {
        (0, ToHost::SetupCells { first: (i * SETUP_CELLS) as u16, cells: cells.iter().copied().collect() })
    }));
    let mut codes = vec![0; virtual_insole.cells.len()];
    for frame in 0..virtual_insole.frames(&recording) {
        virtual_insole.codes_of(&recording, frame, &mut codes);
        let is_step_complete = insole.frame(frame as u32, &codes);
        let t_us = frame as u64 * u64::from(virtual_insole.setup.period_us);
        let t_ms = (t_us as f64 / 1e3 + lag_s * 1e3).round() as u32;
        if frame % TIME_FRAMES == 0 {
            messages.push((t_ms, ToHost::Time { host_us: t_us + (lag_s * 1e6) as u64, device_us: t_us }));
        }
        messages.push((
            t_ms,
            ToHost::Live(Live::new(frame as u32, t_us, insole.loads(), insole.masked(), insole.foot_centre_mm())),
        ));
        if frame % ELLIPSE_FRAMES == 0 {
            let regions = std::array::from_fn(|region| ContactEllipse::new(insole.ellipse(region)));
            let sequence = (frame / ELLIPSE_FRAMES) as u32;
            messages.push((t_ms, ToHost::Ellipses(Ellipses { sequence, t_us, regions })));
        }
        if is_step_complete && let Some(step) = insole.whole_step() {
            messages.push((t_ms, ToHost::Step(Step::new(&step))));
        }
        if let Some(bout) = insole.take_bout() {
            messages.push((t_ms, ToHost::Bout(Bout::new(&bout))));
        }
    }
    Ok(messages)
}

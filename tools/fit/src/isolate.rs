//! Extraction of the steps of a recording by the code of the insole. Contacts that are not complete steps are excluded and listed
//! with the reason.

use crate::contacts::Contacts;
use crate::steps::{ExcludedContact, FootEllipse, FrameLoads, exclude_partial, frame_curves, peak_n};
use crate::{RegionCurves, Step};
use plantar::insole::Insole;
use plantar::pipeline::setup::SetupError;
use plantar::protocol;
use recording::{MAX_CELLS, Scans, VirtualInsole};

/// The steps of a recording and its excluded contacts. `insole` is the virtual insole of the recording, and `scans` are its
/// scans. `index` is the index of the recording in the study. `progress` receives the number of frames that have been processed.
///
/// # Errors
/// Fails if the insole cannot be set up, or if a file with the scans cannot be read.
pub fn isolate(
    insole: &VirtualInsole,
    mut scans: Scans<'_>,
    index: usize,
    progress: &mut dyn FnMut(usize),
) -> Result<(Vec<Step>, Vec<ExcludedContact>), IsolateError> {
    let mut device = Box::new(Insole::<f64, MAX_CELLS>::new());
    device.set_up(insole.setup, insole.cells.iter().copied())?;
    let (mut steps, mut excluded) = (Vec::new(), Vec::new());
    let (mut contacts, mut frames) = (Contacts::default(), Vec::<FrameLoads>::new());
    let period_s = f64::from(insole.setup.period_us) * 1e-6;
    let mut first_s = 0.0;
    let longest_frames = insole.longest_step_frames();
    // The number of cells of each region.
    let mut cells = [0; 8];
    insole.cells.iter().for_each(|cell| cells[cell.region as usize] += 1);
    while let Some(scan) = scans.next_scan()? {
        let i = scan.index;
        if i == 0 {
            first_s = scan.t_s.unwrap_or(0.0);
        }
        let t_s = scan.t_s.unwrap_or(first_s + i as f64 * period_s);
        let was_on_ground = device.on_ground();
        let toe_off = device.frame(i as u32, scan.codes);
        if device.on_ground() && !was_on_ground {
            frames.clear();
        }
        // The insole rejects a contact that is longer than the longest step, so further frames of it are not needed.
        if device.on_ground() && frames.len() <= longest_frames {
            frames.push(loads(&device));
        }
        if let Some(reason) = contacts.frame(t_s, toe_off, &device) {
            excluded.push(ExcludedContact { recording: index, at_s: contacts.start_s(), reason });
        }
        if toe_off && let Some(record) = device.whole_step() {
            let count = (record.duration_us / insole.setup.period_us) as usize;
            let frames = &frames[..count.min(frames.len())];
            let message = protocol::Step::new(&record);
            let regions = std::array::from_fn(|region| {
                let curves = frame_curves(frames, region, period_s);
                let (area_mm2, force_n, sample_s) = device.curves(region);
                RegionCurves {
                    area_mm2: area_mm2.to_vec(),
                    force_n: force_n.to_vec(),
                    sample_s,
                    saturated: record.saturated >> region & 1 == 1,
                    has_single_cell: cells[region] == 1,
                    record: message.regions[region],
                    ..curves
                }
            });
            steps.push(Step {
                recording: index,
                number: record.step,
                side: record.side,
                start_s: contacts.start_s(),
                duration_s: f64::from(record.duration_us) * 1e-6,
                peak_n: peak_n(frames),
                regions,
            });
        }
        // As on the insole, steps and load bouts are numbered in one sequence. Taking a bout advances the number of the next
        // step.
        device.take_bout();
        if i % 1024 == 0 {
            progress(i);
        }
    }
    if let Some(reason) = contacts.end(&device) {
        excluded.push(ExcludedContact { recording: index, at_s: contacts.start_s(), reason });
    }
    exclude_partial(&mut steps, &mut excluded);
    Ok((steps, excluded))
}

/// The reason why the steps of a recording could not be extracted.
#[derive(Debug, thiserror::Error)]
pub enum IsolateError {
    /// An insole cannot be set up for the recording, for example because of its cells or its rate.
    #[error(transparent)]
    Setup(#[from] SetupError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] recording::Error),
}

/// The loads of the frame that `insole` processed last.
fn loads(insole: &Insole<f64, MAX_CELLS>) -> FrameLoads {
    std::array::from_fn(|region| {
        let frame = &insole.loads()[region].frame;
        let ellipse = insole.ellipse(region).map(|e| FootEllipse {
            x_mm: e.x_mm,
            y_mm: e.y_mm,
            r_a_mm: e.r_a_mm,
            r_b_mm: e.r_b_mm,
            angle_deg: f64::from(e.angle_deg()),
        });
        (frame.area.area_mm2(), frame.force.force_n, ellipse)
    })
}
